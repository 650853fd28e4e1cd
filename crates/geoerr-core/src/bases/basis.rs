//! A basis: its description, its checks, its functions at a position, and the functionals that pose a gauge.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::cells::{LEAST_STEP_MM, check_rising};
use super::curve::Curve;
use super::fourier::Fourier;
use super::legendre::Legendre;
use super::local::LocalFunctions;
use super::order::{Depth, Order};
use super::pieces::{CellPolynomial, Pieces, Waves};
use super::{BasisError, curve};

/// Highest degree of B-splines.
const MOST_SPLINE_DEGREE: usize = 4;
/// Highest degree of polynomials: beyond it, powers lose more than four digits against Legendre polynomials.
const MOST_POLYNOMIAL_DEGREE: usize = 12;
/// Highest order of a Fourier basis.
const MOST_ORDER: usize = 64;
/// Most functions of a basis: matrices of rows by functions stay of a size that memory holds.
const MOST_FUNCTIONS: usize = 4096;
/// Longest period in lengths of the range: a longer wave is a parabola with four digits lost.
const MOST_LENGTHS: f64 = 100.0;

/// What a basis is made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum BasisKind {
    /// B-splines of degree 0 to 4, clamped: the first function alone is not 0 at the low end, the last at the high end.
    BSpline {
        /// Rising knots, the first and last once (they are repeated internally); an inner knot may be repeated up
        /// to `degree` times, each time with one continuous derivative less.
        knots_mm: Vec<f64>,
        /// Degree: 0 to 4.
        degree: usize,
    },
    /// Legendre polynomials of `(2q − low − high)/(high − low)` up to a degree: well-conditioned where powers are not.
    Polynomial {
        /// Low end of the range.
        low_mm: f64,
        /// High end of the range.
        high_mm: f64,
        /// Degree: 0 to 12.
        degree: usize,
    },
    /// `1, cos kωq, sin kωq` for k = 1 ... order, in this order, with `ω = 2π/period`.
    Fourier {
        /// Low end of the range.
        low_mm: f64,
        /// High end of the range.
        high_mm: f64,
        /// Period of the first wave.
        period_mm: f64,
        /// Number of waves.
        order: usize,
    },
    /// One-dimensional two-node elements: straight lines between nodes; coefficients are the values at the nodes.
    LinearElements {
        /// Rising nodes, at least two.
        nodes_mm: Vec<f64>,
    },
    /// One-dimensional three-node elements: parabolas through nodes 0, 1, 2; then 2, 3, 4; ...; coefficients are the
    /// values at the nodes.
    QuadraticElements {
        /// Rising nodes, an odd number of at least three; an element's middle node need not be in its middle.
        nodes_mm: Vec<f64>,
    },
    /// The integral of each function of an angle from the low end, less its least-squares line over the range, 0 at the
    /// low end: the straightness of a carriage that follows its guideway's tangent (Li Eq. 19).
    ///
    /// A constant angle has none: where the angle's functions can make a constant, these are linearly dependent.
    TangentIntegral {
        /// The basis of the angle.
        of: Box<Basis>,
    },
}

/// Functions of one axis position.
///
/// | symbol | code | meaning | unit |
/// |---|---|---|---|
/// | `$q$` | `q_mm` | axis position | mm |
/// | `$B_j(q)$` | [`evaluate_into`](Self::evaluate_into) | functions, j = 0 ... [`len`](Self::len) − 1 | - |
/// | `$\int_{low}^q B_j$` | [`integral_into`](Self::integral_into) | their integrals | mm |
/// | `$b_j$` | [`slope_row`](Self::slope_row) | slope of the line that fits `$B_j$` best over the range | 1/mm |
///
/// Every position is allowed: beyond the range functions and integrals are those of its nearer end, derivatives 0; at the
/// two ends themselves derivatives are those from inside, at inner kinks those to the right. NaN gives NaN.
///
/// ```
/// # use geoerr_core::bases::Basis;
/// let basis = Basis::linear_elements(vec![0.0, 100.0, 400.0])?;
/// let mut values = [0.0; 3];
/// basis.evaluate_into(325.0, &mut values);
/// assert_eq!(values, [0.0, 0.25, 0.75]);
/// let curve = basis.curve(&[0.0, 4e-3, 8e-3])?;
/// assert!((curve.value(325.0) - 7e-3).abs() < 1e-17);
/// # Ok::<(), geoerr_core::bases::BasisError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "BasisKind", into = "BasisKind")]
pub struct Basis {
    kind: BasisKind,
    low_mm: f64,
    high_mm: f64,
    functions: Functions,
    /// For tangent integrals of `functions`: the slope of each integral's least-squares line.
    removed_slopes: Option<Vec<f64>>,
}

impl TryFrom<BasisKind> for Basis {
    type Error = BasisError;

    fn try_from(kind: BasisKind) -> Result<Self, BasisError> {
        Self::new(kind)
    }
}

impl From<Basis> for BasisKind {
    fn from(basis: Basis) -> Self {
        basis.kind
    }
}

#[derive(Debug, Clone, PartialEq)]
enum Functions {
    Local(Arc<LocalFunctions>),
    Legendre(Legendre),
    Fourier(Fourier),
}

impl Basis {
    /// The basis that `kind` describes.
    ///
    /// # Errors
    /// [`BasisError`] for positions that do not rise, too few of them, repeated knots, and degrees, orders or periods
    /// that cannot be held to rounding.
    pub fn new(kind: BasisKind) -> Result<Self, BasisError> {
        let (low_mm, high_mm, functions) = match &kind {
            BasisKind::BSpline { knots_mm, degree } => {
                let clamped_mm = clamped(knots_mm, *degree)?;
                ends(knots_mm, Functions::Local(Arc::new(LocalFunctions::bspline(&clamped_mm, *degree))))
            }
            BasisKind::LinearElements { nodes_mm } => {
                check_nodes(nodes_mm, 2)?;
                let clamped_mm = clamped(nodes_mm, 1)?;
                ends(nodes_mm, Functions::Local(Arc::new(LocalFunctions::bspline(&clamped_mm, 1))))
            }
            BasisKind::QuadraticElements { nodes_mm } => {
                check_nodes(nodes_mm, 3)?;
                if nodes_mm.len().is_multiple_of(2) {
                    return Err(BasisError::EvenNodes { found: nodes_mm.len() });
                }
                ends(nodes_mm, Functions::Local(Arc::new(LocalFunctions::quadratic_elements(nodes_mm))))
            }
            &BasisKind::Polynomial { low_mm, high_mm, degree } => {
                check_rising("end of the range", &[low_mm, high_mm])?;
                check_most("degree", degree, MOST_POLYNOMIAL_DEGREE)?;
                (low_mm, high_mm, Functions::Legendre(Legendre { low_mm, high_mm, degree }))
            }
            &BasisKind::Fourier { low_mm, high_mm, period_mm, order } => {
                check_rising("end of the range", &[low_mm, high_mm])?;
                check_most("order", order, MOST_ORDER)?;
                let length_mm = high_mm - low_mm;
                let is_wave = period_mm >= LEAST_STEP_MM * order.max(1) as f64;
                if !is_wave || period_mm > MOST_LENGTHS * length_mm {
                    return Err(BasisError::Period {
                        period_mm,
                        order,
                        length_mm,
                        least_mm: LEAST_STEP_MM,
                        most_lengths: MOST_LENGTHS,
                    });
                }
                (low_mm, high_mm, Functions::Fourier(Fourier { low_mm, high_mm, period_mm, order }))
            }
            BasisKind::TangentIntegral { of } => {
                if of.removed_slopes.is_some() {
                    return Err(BasisError::NestedTangentIntegral);
                }
                let removed_slopes = Some(of.integrals_slopes());
                let (low_mm, high_mm, functions) = (of.low_mm, of.high_mm, of.functions.clone());
                return Ok(Self { kind, low_mm, high_mm, functions, removed_slopes });
            }
        };
        Ok(Self { kind, low_mm, high_mm, functions, removed_slopes: None })
    }

    /// Clamped B-splines: see [`BasisKind::BSpline`].
    ///
    /// # Errors
    /// As [`Basis::new`].
    pub fn bspline(knots_mm: Vec<f64>, degree: usize) -> Result<Self, BasisError> {
        Self::new(BasisKind::BSpline { knots_mm, degree })
    }

    /// Legendre polynomials: see [`BasisKind::Polynomial`].
    ///
    /// # Errors
    /// As [`Basis::new`].
    pub fn polynomial(low_mm: f64, high_mm: f64, degree: usize) -> Result<Self, BasisError> {
        Self::new(BasisKind::Polynomial { low_mm, high_mm, degree })
    }

    /// A constant and waves: see [`BasisKind::Fourier`].
    ///
    /// # Errors
    /// As [`Basis::new`].
    pub fn fourier(low_mm: f64, high_mm: f64, period_mm: f64, order: usize) -> Result<Self, BasisError> {
        Self::new(BasisKind::Fourier { low_mm, high_mm, period_mm, order })
    }

    /// Two-node elements: see [`BasisKind::LinearElements`].
    ///
    /// # Errors
    /// As [`Basis::new`].
    pub fn linear_elements(nodes_mm: Vec<f64>) -> Result<Self, BasisError> {
        Self::new(BasisKind::LinearElements { nodes_mm })
    }

    /// Three-node elements: see [`BasisKind::QuadraticElements`].
    ///
    /// # Errors
    /// As [`Basis::new`].
    pub fn quadratic_elements(nodes_mm: Vec<f64>) -> Result<Self, BasisError> {
        Self::new(BasisKind::QuadraticElements { nodes_mm })
    }

    /// Straightness from an angle: see [`BasisKind::TangentIntegral`].
    ///
    /// # Errors
    /// [`BasisError::NestedTangentIntegral`].
    pub fn tangent_integral(of: Self) -> Result<Self, BasisError> {
        Self::new(BasisKind::TangentIntegral { of: Box::new(of) })
    }

    /// What the basis is made of.
    pub fn kind(&self) -> &BasisKind {
        &self.kind
    }

    /// Number of functions.
    #[allow(clippy::len_without_is_empty, reason = "a basis has at least one function")]
    pub fn len(&self) -> usize {
        match &self.functions {
            Functions::Local(local) => local.n_functions(),
            Functions::Legendre(legendre) => legendre.degree + 1,
            Functions::Fourier(fourier) => 2 * fourier.order + 1,
        }
    }

    /// Low and high end of the range.
    pub fn range(&self) -> (f64, f64) {
        (self.low_mm, self.high_mm)
    }

    /// Rising positions where some function's value or slope is not continuous, the two ends of the range among them.
    pub fn kinks(&self) -> Vec<f64> {
        let ends = vec![self.low_mm, self.high_mm];
        match &self.kind {
            BasisKind::BSpline { knots_mm, degree } => kinks_of_spline(knots_mm, *degree, 0),
            BasisKind::LinearElements { nodes_mm } => nodes_mm.clone(),
            BasisKind::QuadraticElements { nodes_mm } => nodes_mm.iter().step_by(2).copied().collect(),
            BasisKind::Polynomial { .. } | BasisKind::Fourier { .. } => ends,
            BasisKind::TangentIntegral { of } => match &of.kind {
                BasisKind::BSpline { knots_mm, degree } => kinks_of_spline(knots_mm, *degree, 1),
                _ => ends,
            },
        }
    }

    /// Most functions that [`support`](Self::support) gives.
    pub fn most_support(&self) -> usize {
        match (&self.functions, &self.removed_slopes) {
            (Functions::Local(local), None) => local.n_local(),
            _ => self.len(),
        }
    }

    /// The functions that may be other than 0 at `q_mm`: the first one's index and their number, their values in `out`.
    ///
    /// # Panics
    /// If `out` is shorter than [`most_support`](Self::most_support).
    #[inline]
    pub fn support(&self, q_mm: f64, out: &mut [f64]) -> (usize, usize) {
        match (&self.functions, &self.removed_slopes) {
            (Functions::Local(local), None) => {
                let first = local.support(Depth::Value, self.within(q_mm), out);
                (first, local.n_local())
            }
            _ => {
                let n_functions = self.len();
                self.evaluate_into(q_mm, &mut out[..n_functions]);
                (0, n_functions)
            }
        }
    }

    /// All functions at `q_mm`.
    ///
    /// # Panics
    /// If `out` has not [`len`](Self::len) places; so do the next two.
    pub fn evaluate_into(&self, q_mm: f64, out: &mut [f64]) {
        self.fill(Order::Value, q_mm, out);
    }

    /// All derivatives at `q_mm`, per mm; 0 outside the range.
    pub fn derivative_into(&self, q_mm: f64, out: &mut [f64]) {
        self.fill(Order::Derivative, q_mm, out);
    }

    /// All integrals from the low end to `q_mm`, times mm; beyond the range those to its nearer end.
    pub fn integral_into(&self, q_mm: f64, out: &mut [f64]) {
        self.fill(Order::Integral, q_mm, out);
    }

    /// One row of functions for each position: position by position.
    pub fn rows(&self, order: Order, q_mm: &[f64]) -> Vec<f64> {
        let n_functions = self.len();
        let mut rows = vec![0.0; q_mm.len() * n_functions];
        for (q_mm, row) in q_mm.iter().zip(rows.chunks_exact_mut(n_functions)) {
            self.fill(order, *q_mm, row);
        }
        rows
    }

    /// The functions at a position: the coefficients' weights in the sum's value there.
    pub fn value_row(&self, q_mm: f64) -> Vec<f64> {
        self.rows(Order::Value, &[q_mm])
    }

    /// The functions' means over the range: the coefficients' weights in the mean of the sum.
    pub fn mean_row(&self) -> Vec<f64> {
        let length_mm = self.high_mm - self.low_mm;
        let [mut means, first, _] = self.functions.moments();
        means.iter_mut().for_each(|mean| *mean /= length_mm);
        if let Some(slopes) = &self.removed_slopes {
            // ∫F = L/2 ∫f − ∫(q − middle) f by parts, less the line's own mean.
            for ((mean, first), slope) in means.iter_mut().zip(&first).zip(slopes) {
                *mean = 0.5 * length_mm * (*mean - slope) - first / length_mm;
            }
        }
        means
    }

    /// The slopes of the functions' least-squares lines over the range, per mm: the coefficients' weights in that of the
    /// sum's line, which passes through the mean in the middle of the range.
    ///
    /// ```math
    /// b_j = \frac{12}{L^3}\int (q - \bar q)\, B_j\,dq
    /// ```
    pub fn slope_row(&self) -> Vec<f64> {
        if self.removed_slopes.is_some() {
            // By construction.
            return vec![0.0; self.len()];
        }
        let [_, mut slopes, _] = self.functions.moments();
        slopes.iter_mut().for_each(|slope| *slope *= 12.0 / (self.high_mm - self.low_mm).powi(3));
        slopes
    }

    /// The slopes of the least-squares lines of the functions' integrals.
    ///
    /// ```math
    /// \frac{12}{L^3}\int (q - \bar q) F\,dq = \frac{12}{L^3}\Bigl(\frac{L^2}{8}\int f\,dq - \frac12\int (q-\bar q)^2 f\,dq\Bigr),
    /// \qquad F(q) = \int_{low}^q f
    /// ```
    fn integrals_slopes(&self) -> Vec<f64> {
        let length_mm = self.high_mm - self.low_mm;
        let [whole, _, second] = self.functions.moments();
        let slopes = whole.iter().zip(&second);
        slopes.map(|(whole, second)| (1.5 * whole - 6.0 * second / length_mm.powi(2)) / length_mm).collect()
    }

    /// The sum of the functions times `coefficients`, for fast evaluation.
    ///
    /// # Errors
    /// [`BasisError::Count`] and [`BasisError::NotFinite`].
    pub fn curve(&self, coefficients: &[f64]) -> Result<Curve, BasisError> {
        curve::check_values("coefficient", "coefficients", coefficients, self.len())?;
        let removed_slope = self.removed_slopes.as_ref().map(|slopes| {
            let terms = slopes.iter().zip(coefficients).map(|(slope, coefficient)| slope * coefficient);
            terms.sum::<f64>()
        });
        let (low_mm, high_mm) = self.range();
        let half_mm = 0.5 * (high_mm - low_mm);
        let mut waves = Vec::new();
        let mut cells = match &self.functions {
            Functions::Local(local) => {
                let cells = local.breaks_mm().windows(2).enumerate().map(|(cell, ends)| CellPolynomial {
                    start_mm: ends[0],
                    end_mm: ends[1],
                    origin_mm: ends[0],
                    unit_mm: ends[1] - ends[0],
                    coefficients: local.combination(cell, coefficients),
                });
                cells.collect()
            }
            Functions::Legendre(_) => {
                let coefficients = Legendre::combination(coefficients);
                vec![CellPolynomial {
                    start_mm: low_mm,
                    end_mm: high_mm,
                    origin_mm: low_mm + half_mm,
                    unit_mm: half_mm,
                    coefficients,
                }]
            }
            Functions::Fourier(fourier) => {
                let mut amplitudes = fourier.combination(coefficients);
                if removed_slope.is_some() {
                    // ∫ a cos + b sin = (a sin − b cos) / kω; the constant of integration comes below.
                    for (amplitude, harmonic) in amplitudes.iter_mut().zip(1..) {
                        let wave = fourier.wave_per_mm(harmonic);
                        *amplitude = [-amplitude[1] / wave, amplitude[0] / wave];
                    }
                }
                waves.push(Waves { low_mm, high_mm, wave_per_mm: fourier.wave_per_mm(1), amplitudes });
                vec![CellPolynomial {
                    start_mm: low_mm,
                    end_mm: high_mm,
                    origin_mm: low_mm,
                    unit_mm: high_mm - low_mm,
                    coefficients: vec![coefficients[0]],
                }]
            }
        };
        if let Some(slope) = removed_slope {
            // 0 at the low end, where the waves have their own value.
            let mut start_value = -waves.iter().map(|waves| waves.value_and_slope(low_mm).0).sum::<f64>();
            for cell in &mut cells {
                cell.integrate(slope, start_value);
                start_value = cell.value(cell.end_mm);
            }
        }
        // From the functions themselves, so that clamped splines and elements keep their end coefficients bit for bit.
        let held = [low_mm, high_mm].map(|end_mm| {
            let row = self.value_row(end_mm);
            let sum: f64 = row.iter().zip(coefficients).map(|(value, coefficient)| value * coefficient).sum();
            sum - waves.iter().map(|waves| waves.value_and_slope(end_mm).0).sum::<f64>()
        });
        Ok(Curve::new(Pieces::from_cells(&cells, held), waves, self.kinks()))
    }

    fn within(&self, q_mm: f64) -> f64 {
        q_mm.clamp(self.low_mm, self.high_mm)
    }

    fn fill(&self, order: Order, q_mm: f64, out: &mut [f64]) {
        assert_eq!(out.len(), self.len(), "one place for each function");
        if q_mm.is_nan() {
            out.fill(f64::NAN);
            return;
        }
        let held_mm = self.within(q_mm);
        if order == Order::Derivative && held_mm != q_mm {
            out.fill(0.0);
            return;
        }
        let Some(slopes) = &self.removed_slopes else {
            self.functions.fill(order.depth(), held_mm, out);
            return;
        };
        self.functions.fill(order.depth_of_integrand(), held_mm, out);
        let into_mm = held_mm - self.low_mm;
        let line = match order {
            Order::Derivative => 1.0,
            Order::Value => into_mm,
            Order::Integral => 0.5 * into_mm * into_mm,
        };
        for (value, slope) in out.iter_mut().zip(slopes) {
            *value -= slope * line;
        }
    }
}

impl Functions {
    fn fill(&self, depth: Depth, q_mm: f64, out: &mut [f64]) {
        match self {
            Self::Local(local) => local.fill(depth, q_mm, out),
            Self::Legendre(legendre) => legendre.fill(depth, q_mm, out),
            Self::Fourier(fourier) => fourier.fill(depth, q_mm, out),
        }
    }

    /// `∫ (q − middle)^p B_j` over the range for p = 0, 1, 2.
    fn moments(&self) -> [Vec<f64>; 3] {
        match self {
            Self::Local(local) => local.moments(),
            Self::Legendre(legendre) => legendre.moments(),
            Self::Fourier(fourier) => fourier.moments(),
        }
    }
}

/// Ends of checked positions, with the functions over them.
fn ends(positions_mm: &[f64], functions: Functions) -> (f64, f64, Functions) {
    (positions_mm[0], positions_mm[positions_mm.len() - 1], functions)
}

fn check_most(what: &'static str, found: usize, most: usize) -> Result<(), BasisError> {
    if found > most { Err(BasisError::TooHigh { what, found, most }) } else { Ok(()) }
}

fn check_nodes(nodes_mm: &[f64], needed: usize) -> Result<(), BasisError> {
    check_count("nodes", nodes_mm.len(), needed)?;
    check_rising("node", nodes_mm)
}

fn check_count(what: &'static str, found: usize, needed: usize) -> Result<(), BasisError> {
    if found < needed {
        return Err(BasisError::TooFew { what, found, needed });
    }
    if found > MOST_FUNCTIONS {
        return Err(BasisError::TooManyFunctions { found, most: MOST_FUNCTIONS });
    }
    Ok(())
}

/// Different positions with how often each is given.
fn repeats(knots_mm: &[f64]) -> impl Iterator<Item = (f64, usize)> {
    knots_mm.chunk_by(|a, b| a == b).map(|equal| (equal[0], equal.len()))
}

/// Checked knots with the ends repeated degree + 1 times.
fn clamped(knots_mm: &[f64], degree: usize) -> Result<Vec<f64>, BasisError> {
    check_most("degree", degree, MOST_SPLINE_DEGREE)?;
    let (distinct_mm, counts): (Vec<f64>, Vec<usize>) = repeats(knots_mm).unzip();
    check_count("different knots", distinct_mm.len(), 2)?;
    check_rising("knot", &distinct_mm)?;
    let last = distinct_mm.len() - 1;
    let mut clamped_mm = Vec::new();
    for (index, (&position_mm, &found)) in distinct_mm.iter().zip(&counts).enumerate() {
        let is_end = index == 0 || index == last;
        let most = if is_end { 1 } else { degree.max(1) };
        if found > most {
            return Err(BasisError::KnotRepeated { position_mm, found, most });
        }
        clamped_mm.extend(std::iter::repeat_n(position_mm, if is_end { degree + 1 } else { found }));
    }
    let n_functions = clamped_mm.len() - degree - 1;
    if n_functions > MOST_FUNCTIONS {
        return Err(BasisError::TooManyFunctions { found: n_functions, most: MOST_FUNCTIONS });
    }
    Ok(clamped_mm)
}

/// Ends, and inner knots at which a spline of the degree, integrated so often, has no continuous slope.
fn kinks_of_spline(knots_mm: &[f64], degree: usize, n_integrations: usize) -> Vec<f64> {
    let distinct: Vec<(f64, usize)> = repeats(knots_mm).collect();
    let last = distinct.len() - 1;
    let kinks = distinct.iter().enumerate().filter(|(index, (_, found))| {
        let is_end = *index == 0 || *index == last;
        is_end || found + 1 > degree + n_integrations
    });
    kinks.map(|(_, &(position_mm, _))| position_mm).collect()
}
