//! Functions that are polynomials in each cell, and not 0 in a few neighbouring cells only: splines and elements.

use super::cells::Search;
use super::order::Depth;

/// Functions by cell: in each, the same number of consecutive functions is not 0, each a polynomial of
/// `u = (q − cell's start) / cell's length`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct LocalFunctions {
    search: Search,
    n_functions: usize,
    /// Functions that are not 0 in a cell.
    n_local: usize,
    /// Coefficients of each: 1, u, u², ...
    n_coefficients: usize,
    /// The first function that is not 0 in each cell.
    first: Vec<usize>,
    /// By cell, function, power.
    coefficients: Vec<f64>,
    /// Integral and double integral of each cell's functions from the low end up to the cell.
    before: Vec<[f64; 2]>,
    /// By function: from where on it is 0, and its integral and double integral up to there.
    after: Vec<After>,
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct After {
    from_mm: f64,
    integral: f64,
    double_integral: f64,
}

/// Cells' starts and polynomials while a basis is built.
struct CellFunctions {
    first: Vec<usize>,
    coefficients: Vec<f64>,
}

impl LocalFunctions {
    /// B-splines of a knot vector whose ends are repeated degree + 1 times.
    ///
    /// Cox and de Boor's recursion over polynomials instead of numbers, in each cell's own coordinate.
    pub(super) fn bspline(clamped_knots_mm: &[f64], degree: usize) -> Self {
        let n_functions = clamped_knots_mm.len() - degree - 1;
        let n_coefficients = degree + 1;
        let mut breaks_mm = clamped_knots_mm.to_vec();
        breaks_mm.dedup();
        let mut cells = CellFunctions { first: Vec::new(), coefficients: Vec::new() };
        for span in degree..n_functions {
            let (start_mm, end_mm) = (clamped_knots_mm[span], clamped_knots_mm[span + 1]);
            if start_mm == end_mm {
                continue;
            }
            let mut functions = vec![vec![1.0]];
            for level in 1..=degree {
                let mut next = vec![vec![0.0; level + 1]; level + 1];
                for (index, function) in functions.iter().enumerate() {
                    let left_mm = clamped_knots_mm[span + 1 - level + index];
                    let right_mm = clamped_knots_mm[span + 1 + index];
                    let width_mm = right_mm - left_mm;
                    let rise = (end_mm - start_mm) / width_mm;
                    let (up, down) = ((start_mm - left_mm) / width_mm, (right_mm - start_mm) / width_mm);
                    for (power, value) in function.iter().enumerate() {
                        next[index + 1][power] += up * value;
                        next[index + 1][power + 1] += rise * value;
                        next[index][power] += down * value;
                        next[index][power + 1] -= rise * value;
                    }
                }
                functions = next;
            }
            cells.first.push(span - degree);
            cells.coefficients.extend(functions.iter().flatten());
        }
        Self::assemble(breaks_mm, n_functions, degree + 1, n_coefficients, cells)
    }

    /// Three-node elements: Lagrange's parabolas through nodes 0, 1, 2; then 2, 3, 4; ...
    ///
    /// With `m = (x₂ − x₁)/(x₃ − x₁)`: `N₁ = (u − m)(u − 1)/m`, `N₂ = u(u − 1)/(m(m − 1))`,
    /// `N₃ = u(u − m)/(1 − m)`.
    pub(super) fn quadratic_elements(nodes_mm: &[f64]) -> Self {
        let breaks_mm: Vec<f64> = nodes_mm.iter().step_by(2).copied().collect();
        let mut cells = CellFunctions { first: Vec::new(), coefficients: Vec::new() };
        for (element, nodes) in nodes_mm.windows(3).step_by(2).enumerate() {
            let length_mm = nodes[2] - nodes[0];
            // Both from differences: an element's middle node may lie near either end.
            let (middle, rest) = ((nodes[1] - nodes[0]) / length_mm, (nodes[2] - nodes[1]) / length_mm);
            cells.first.push(2 * element);
            cells.coefficients.extend([1.0, -(1.0 + middle) / middle, 1.0 / middle]);
            cells.coefficients.extend([0.0, 1.0 / (middle * rest), -1.0 / (middle * rest)]);
            cells.coefficients.extend([0.0, -middle / rest, 1.0 / rest]);
        }
        Self::assemble(breaks_mm, nodes_mm.len(), 3, 3, cells)
    }

    fn assemble(
        breaks_mm: Vec<f64>,
        n_functions: usize,
        n_local: usize,
        n_coefficients: usize,
        cells: CellFunctions,
    ) -> Self {
        let CellFunctions { first, coefficients } = cells;
        let mut before = Vec::with_capacity(first.len() * n_local);
        let mut after = vec![After::default(); n_functions];
        for (cell, (&first, functions)) in
            first.iter().zip(coefficients.chunks_exact(n_local * n_coefficients)).enumerate()
        {
            let length_mm = breaks_mm[cell + 1] - breaks_mm[cell];
            for (function, after) in functions.chunks_exact(n_coefficients).zip(&mut after[first..]) {
                before.push([after.integral, after.double_integral]);
                let (integral, double_integral) = integrals(function, 1.0, length_mm);
                after.double_integral += after.integral * length_mm + double_integral;
                after.integral += integral;
                after.from_mm = breaks_mm[cell + 1];
            }
        }
        Self {
            search: Search::new(breaks_mm),
            n_functions,
            n_local,
            n_coefficients,
            first,
            coefficients,
            before,
            after,
        }
    }

    pub(super) fn n_functions(&self) -> usize {
        self.n_functions
    }

    pub(super) fn n_local(&self) -> usize {
        self.n_local
    }

    pub(super) fn breaks_mm(&self) -> &[f64] {
        self.search.positions_mm()
    }

    /// The functions that are not 0 at `q_mm` (within the range): the first one's index, values or derivatives in `out`.
    #[inline]
    pub(super) fn support(&self, depth: Depth, q_mm: f64, out: &mut [f64]) -> usize {
        let cell = self.search.cell(q_mm);
        let (start_mm, length_mm) = self.extent(cell);
        let u = (q_mm - start_mm) / length_mm;
        for (function, value) in self.functions(cell).zip(&mut out[..self.n_local]) {
            *value = match depth {
                Depth::Derivative => {
                    let powers = function.iter().enumerate().skip(1).rev();
                    powers.fold(0.0, |sum, (power, c)| sum * u + power as f64 * c) / length_mm
                }
                _ => function.iter().rev().fold(0.0, |sum, c| sum * u + c),
            };
        }
        self.first[cell]
    }

    /// All functions at `q_mm` (within the range).
    pub(super) fn fill(&self, depth: Depth, q_mm: f64, out: &mut [f64]) {
        out.fill(0.0);
        let cell = self.search.cell(q_mm);
        let first = self.first[cell];
        if matches!(depth, Depth::Derivative | Depth::Value) {
            self.support(depth, q_mm, &mut out[first..]);
            return;
        }
        for (after, value) in self.after[..first].iter().zip(out.iter_mut()) {
            *value = match depth {
                Depth::Integral => after.integral,
                _ => after.double_integral + after.integral * (q_mm - after.from_mm),
            };
        }
        let (start_mm, length_mm) = self.extent(cell);
        let into_mm = q_mm - start_mm;
        let before = &self.before[cell * self.n_local..];
        for ((function, before), value) in self.functions(cell).zip(before).zip(&mut out[first..]) {
            let (integral, double_integral) = integrals(function, into_mm / length_mm, length_mm);
            *value = match depth {
                Depth::Integral => before[0] + integral,
                _ => before[1] + before[0] * into_mm + double_integral,
            };
        }
    }

    /// `∫ (q − middle)^p B_j` over the range for p = 0, 1, 2.
    pub(super) fn moments(&self) -> [Vec<f64>; 3] {
        let breaks_mm = self.search.positions_mm();
        let middle_mm = 0.5 * (breaks_mm[0] + breaks_mm[breaks_mm.len() - 1]);
        let mut moments = [(); 3].map(|()| vec![0.0; self.n_functions]);
        for (cell, &first) in self.first.iter().enumerate() {
            let (start_mm, length_mm) = self.extent(cell);
            let from_middle = start_mm - middle_mm;
            for (function, index) in self.functions(cell).zip(first..) {
                let [m0, m1, m2] = [1, 2, 3].map(|shift| {
                    let terms = function.iter().enumerate().map(|(power, c)| c / (power + shift) as f64);
                    terms.sum::<f64>() * length_mm.powi(shift as i32)
                });
                moments[0][index] += m0;
                moments[1][index] += from_middle * m0 + m1;
                moments[2][index] += from_middle * (from_middle * m0 + 2.0 * m1) + m2;
            }
        }
        moments
    }

    /// The sum of the functions times `weights` in one cell: coefficients of 1, u, u², ...
    pub(super) fn combination(&self, cell: usize, weights: &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; self.n_coefficients];
        for (function, weight) in self.functions(cell).zip(&weights[self.first[cell]..]) {
            for (sum, c) in sum.iter_mut().zip(function) {
                *sum += weight * c;
            }
        }
        sum
    }

    fn extent(&self, cell: usize) -> (f64, f64) {
        let breaks_mm = self.search.positions_mm();
        (breaks_mm[cell], breaks_mm[cell + 1] - breaks_mm[cell])
    }

    fn functions(&self, cell: usize) -> impl Iterator<Item = &[f64]> {
        let size = self.n_local * self.n_coefficients;
        self.coefficients[cell * size..(cell + 1) * size].chunks_exact(self.n_coefficients)
    }
}

/// Integral and double integral of a cell's polynomial from its start to `u`.
fn integrals(function: &[f64], u: f64, length_mm: f64) -> (f64, f64) {
    let (mut integral, mut double_integral) = (0.0, 0.0);
    for (power, c) in function.iter().enumerate().rev() {
        integral = integral * u + c / (power + 1) as f64;
        double_integral = double_integral * u + c / ((power + 1) * (power + 2)) as f64;
    }
    (integral * u * length_mm, double_integral * (u * length_mm).powi(2))
}
