//! Piecewise polynomials, N at once over common cells, and waves: what curves are evaluated from.

use super::cells::Search;

/// One polynomial over one cell, in `s = (q − origin)/unit`, while a curve is built.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CellPolynomial {
    pub(super) start_mm: f64,
    pub(super) end_mm: f64,
    pub(super) origin_mm: f64,
    pub(super) unit_mm: f64,
    pub(super) coefficients: Vec<f64>,
}

impl CellPolynomial {
    pub(super) fn value(&self, q_mm: f64) -> f64 {
        let s = (q_mm - self.origin_mm) / self.unit_mm;
        self.coefficients.iter().rev().fold(0.0, |sum, c| sum * s + c)
    }

    /// Replaces the polynomial by its integral less a line of the given slope, with the given value at the cell's start.
    pub(super) fn integrate(&mut self, removed_slope: f64, start_value: f64) {
        let terms = self.coefficients.iter().enumerate();
        let mut integral: Vec<f64> = terms.map(|(power, c)| self.unit_mm * c / (power + 1) as f64).collect();
        integral[0] -= removed_slope * self.unit_mm;
        integral.insert(0, 0.0);
        self.coefficients = integral;
        self.coefficients[0] = start_value - self.value(self.start_mm);
    }
}

/// N piecewise polynomials over common cells, with their end values outside.
///
/// Positions cut the line into one piece more than there are positions; the first and the last piece are constants.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pieces<const N: usize> {
    search: Search,
    /// Where each piece's polynomials count from: its start where all are lines, so that nodes keep their values bit for
    /// bit, else its middle, so that powers stay small.
    origins_mm: Vec<f64>,
    n_coefficients: usize,
    /// By piece and power, in 1/mm^power.
    coefficients: Vec<[f64; N]>,
}

impl<const N: usize> Pieces<N> {
    /// Values and slopes; at a position between pieces those of the piece to the right. NaN for NaN.
    #[inline]
    pub(super) fn values_and_slopes(&self, q_mm: f64) -> ([f64; N], [f64; N]) {
        let positions_mm = self.search.positions_mm();
        let piece = self.search.count(q_mm);
        let held_mm = match (positions_mm.first(), positions_mm.last()) {
            (Some(&low_mm), Some(&high_mm)) => q_mm.clamp(low_mm, high_mm),
            _ if q_mm.is_nan() => q_mm,
            _ => 0.0,
        };
        let into_mm = held_mm - self.origins_mm[piece];
        let coefficients = &self.coefficients[piece * self.n_coefficients..][..self.n_coefficients];
        // Lines, cubics and integrals of cubics get loops of known length.
        match coefficients.len() {
            2 => horner(coefficients.first_chunk::<2>().unwrap_or(&[[0.0; N]; 2]), into_mm),
            4 => horner(coefficients.first_chunk::<4>().unwrap_or(&[[0.0; N]; 4]), into_mm),
            5 => horner(coefficients.first_chunk::<5>().unwrap_or(&[[0.0; N]; 5]), into_mm),
            _ => horner(coefficients, into_mm),
        }
    }

    /// Positions between pieces.
    pub(super) fn positions_mm(&self) -> &[f64] {
        self.search.positions_mm()
    }

    /// The sums of several curves' pieces, N of them, on the union of their positions.
    pub(super) fn sums(terms: &[Vec<&Pieces<1>>; N]) -> Self {
        let every = || terms.iter().flatten();
        let mut positions_mm: Vec<f64> = every().flat_map(|pieces| pieces.positions_mm()).copied().collect();
        positions_mm.sort_by(f64::total_cmp);
        positions_mm.dedup();
        let n_coefficients = every().map(|pieces| pieces.n_coefficients).max().unwrap_or(1);
        let n_pieces = positions_mm.len() + 1;
        let mut origins_mm = Vec::with_capacity(n_pieces);
        let mut coefficients = vec![[0.0; N]; n_pieces * n_coefficients];
        for (piece, sums) in coefficients.chunks_exact_mut(n_coefficients).enumerate() {
            let origin_mm = origin(&positions_mm, piece, n_coefficients);
            for (n, terms) in terms.iter().enumerate() {
                for term in terms {
                    let source = match piece {
                        0 => 0,
                        _ => term.search.count(positions_mm[piece - 1]),
                    };
                    let mut shifted: Vec<f64> = term.coefficients[source * term.n_coefficients..]
                        [..term.n_coefficients]
                        .iter()
                        .map(|[c]| *c)
                        .collect();
                    shift(&mut shifted, origin_mm - term.origins_mm[source]);
                    for (sum, c) in sums.iter_mut().zip(shifted) {
                        sum[n] += c;
                    }
                }
            }
            origins_mm.push(origin_mm);
        }
        Self { search: Search::new(positions_mm), origins_mm, n_coefficients, coefficients }
    }
}

impl Pieces<1> {
    /// The same value everywhere.
    pub(super) fn constant(value: f64) -> Self {
        let (search, origins_mm) = (Search::default(), vec![0.0]);
        Self { search, origins_mm, n_coefficients: 1, coefficients: vec![[value]] }
    }

    /// Cells that follow one another, and the values that are held before and after them.
    pub(super) fn from_cells(cells: &[CellPolynomial], held: [f64; 2]) -> Self {
        let n_coefficients = cells.iter().map(|cell| cell.coefficients.len()).max().unwrap_or(1);
        let starts = cells.iter().map(|cell| cell.start_mm);
        let positions_mm: Vec<f64> = starts.chain(cells.last().map(|cell| cell.end_mm)).collect();
        let origins_mm: Vec<f64> =
            (0..=positions_mm.len()).map(|piece| origin(&positions_mm, piece, n_coefficients)).collect();
        let mut coefficients = vec![[0.0]; origins_mm.len() * n_coefficients];
        let mut pieces = coefficients.chunks_exact_mut(n_coefficients).zip(&origins_mm);
        if let Some((before, _)) = pieces.next() {
            before[0] = [held[0]];
        }
        for (cell, (piece, &origin_mm)) in cells.iter().zip(&mut pieces) {
            let mut shifted = cell.coefficients.clone();
            shift(&mut shifted, (origin_mm - cell.origin_mm) / cell.unit_mm);
            for (power, (target, c)) in piece.iter_mut().zip(shifted).enumerate() {
                *target = [c / cell.unit_mm.powi(power as i32)];
            }
        }
        if let Some((after, _)) = pieces.next() {
            after[0] = [held[1]];
        }
        Self { search: Search::new(positions_mm), origins_mm, n_coefficients, coefficients }
    }
}

/// Where the polynomials of a piece count from.
fn origin(positions_mm: &[f64], piece: usize, n_coefficients: usize) -> f64 {
    let after = positions_mm.get(piece).copied();
    let before = piece.checked_sub(1).and_then(|index| positions_mm.get(index)).copied();
    match (before, after) {
        (Some(before_mm), Some(after_mm)) if n_coefficients > 2 => before_mm + 0.5 * (after_mm - before_mm),
        (Some(before_mm), _) => before_mm,
        (None, after) => after.unwrap_or(0.0),
    }
}

/// A polynomial of s as one of `s − by`: Taylor's shift by repeated synthetic division.
fn shift(coefficients: &mut [f64], by: f64) {
    if by == 0.0 {
        return;
    }
    let degree = coefficients.len() - 1;
    for lowest in 0..degree {
        for power in (lowest..degree).rev() {
            coefficients[power] += by * coefficients[power + 1];
        }
    }
}

#[inline(always)]
fn horner<C, const N: usize>(coefficients: &C, into_mm: f64) -> ([f64; N], [f64; N])
where
    C: AsRef<[[f64; N]]> + ?Sized,
{
    let (mut values, mut slopes) = ([0.0; N], [0.0; N]);
    for coefficients in coefficients.as_ref().iter().rev() {
        for n in 0..N {
            slopes[n] = slopes[n] * into_mm + values[n];
            values[n] = values[n] * into_mm + coefficients[n];
        }
    }
    (values, slopes)
}

/// `Σ a_k cos kωd + b_k sin kωd` with `d = q − low`, with its end values outside.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Waves {
    pub(super) low_mm: f64,
    pub(super) high_mm: f64,
    /// ω, rad/mm.
    pub(super) wave_per_mm: f64,
    /// `[a_k, b_k]` for k = 1, 2, ...
    pub(super) amplitudes: Vec<[f64; 2]>,
}

impl Waves {
    pub(super) fn value_and_slope(&self, q_mm: f64) -> (f64, f64) {
        let into_mm = q_mm.clamp(self.low_mm, self.high_mm) - self.low_mm;
        let (sin, cos) = (self.wave_per_mm * into_mm).sin_cos();
        let (mut sin_k, mut cos_k) = (sin, cos);
        let (mut value, mut slope, mut wave) = (0.0, 0.0, self.wave_per_mm);
        for [a, b] in &self.amplitudes {
            value += a * cos_k + b * sin_k;
            slope += wave * (b * cos_k - a * sin_k);
            (sin_k, cos_k) = (sin_k * cos + cos_k * sin, cos_k * cos - sin_k * sin);
            wave += self.wave_per_mm;
        }
        // To the right, as everywhere.
        if q_mm < self.low_mm || q_mm >= self.high_mm { (value, 0.0) } else { (value, slope) }
    }
}
