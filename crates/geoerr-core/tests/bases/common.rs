//! Any basis, and integrals the long way.

use geoerr_core::bases::Basis;
use proptest::prelude::*;

/// Points and weights of Gauss's rule of five points on (−1, 1): exact for polynomials up to degree 9.
const GAUSS: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (0.906_179_845_938_664, 0.236_926_885_056_189_08),
];

/// Rising positions with steps from 0.5 to 60 mm, from anywhere on a machine.
pub fn any_nodes(most: usize) -> impl Strategy<Value = Vec<f64>> {
    (-500.0..500.0_f64, prop::collection::vec(0.5..60.0_f64, 1..most)).prop_map(|(start, steps)| {
        let mut positions = vec![start];
        positions.extend(steps.iter().scan(start, |x, step| {
            *x += step;
            Some(*x)
        }));
        positions
    })
}

/// Splines with inner knots repeated as often as the degree allows.
pub fn any_bspline() -> impl Strategy<Value = Basis> {
    (any_nodes(12), 0..=4_usize, prop::collection::vec(1..=4_usize, 12)).prop_map(
        |(nodes, degree, repeats)| {
            let last = nodes.len() - 1;
            let knots = nodes.iter().enumerate().flat_map(|(index, &node)| {
                let is_end = index == 0 || index == last;
                std::iter::repeat_n(node, if is_end { 1 } else { repeats[index].min(degree.max(1)) })
            });
            Basis::bspline(knots.collect(), degree).unwrap()
        },
    )
}

pub fn any_elements() -> impl Strategy<Value = Basis> {
    (any_nodes(13), any::<bool>()).prop_map(|(mut nodes, is_quadratic)| {
        if !is_quadratic || nodes.len() < 3 {
            return Basis::linear_elements(nodes).unwrap();
        }
        if nodes.len() % 2 == 0 {
            nodes.pop();
        }
        Basis::quadratic_elements(nodes).unwrap()
    })
}

pub fn any_polynomial() -> impl Strategy<Value = Basis> {
    (-500.0..500.0_f64, 1.0..800.0_f64, 0..=12_usize)
        .prop_map(|(low, length, degree)| Basis::polynomial(low, low + length, degree).unwrap())
}

pub fn any_fourier() -> impl Strategy<Value = Basis> {
    (-500.0..500.0_f64, 1.0..800.0_f64, 0.05..3.0_f64, 0..=5_usize).prop_map(
        |(low, length, periods, order)| Basis::fourier(low, low + length, length * periods, order).unwrap(),
    )
}

/// Any basis but a tangent integral.
pub fn any_plain() -> impl Strategy<Value = Basis> {
    prop_oneof![any_bspline(), any_elements(), any_polynomial(), any_fourier()]
}

/// Any basis.
pub fn any_basis() -> impl Strategy<Value = Basis> {
    (any_plain(), any::<bool>()).prop_map(|(basis, is_integrated)| {
        if is_integrated { Basis::tangent_integral(basis).unwrap() } else { basis }
    })
}

pub fn length(basis: &Basis) -> f64 {
    basis.range().1 - basis.range().0
}

/// The shortest wave or the range: what a difference's step and a quadrature's cells are measured by.
pub fn finest_mm(basis: &Basis) -> f64 {
    use geoerr_core::bases::BasisKind as K;
    match basis.kind() {
        K::BSpline { knots_mm: positions_mm, .. }
        | K::LinearElements { nodes_mm: positions_mm }
        | K::QuadraticElements { nodes_mm: positions_mm } => {
            let steps = positions_mm.windows(2).map(|pair| pair[1] - pair[0]).filter(|&step| step > 0.0);
            steps.fold(f64::INFINITY, f64::min)
        }
        K::Polynomial { low_mm, high_mm, degree } => (high_mm - low_mm) / (degree * degree + 1) as f64,
        K::Fourier { low_mm, high_mm, period_mm, order } => {
            (period_mm / (*order).max(1) as f64).min(high_mm - low_mm)
        }
        K::TangentIntegral { of } => finest_mm(of),
    }
}

/// Positions between which all functions are smooth: knots and nodes, and enough cells between them.
fn smooth_cells(basis: &Basis) -> Vec<f64> {
    use geoerr_core::bases::BasisKind as K;
    let (low, high) = basis.range();
    let mut positions = match basis.kind() {
        K::BSpline { knots_mm: positions, .. }
        | K::LinearElements { nodes_mm: positions }
        | K::QuadraticElements { nodes_mm: positions } => positions.clone(),
        K::TangentIntegral { of } => return smooth_cells(of),
        _ => {
            // Five Gauss points in a sixteenth of the shortest wave leave (2π/32)^10 of it.
            let n = (16.0 * (high - low) / finest_mm(basis)).ceil() as usize;
            (0..=n).map(|i| low + (high - low) * i as f64 / n as f64).collect()
        }
    };
    positions.dedup();
    positions
}

/// `∫ weight(q) B_j dq` from the low end up to `end` by Gauss's rule in every smooth cell.
pub fn quadrature(basis: &Basis, end: f64, weight: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut sums = vec![0.0; basis.len()];
    let mut values = vec![0.0; basis.len()];
    for cell in smooth_cells(basis).windows(2) {
        let (start, stop) = (cell[0], cell[1].min(end));
        if stop <= start {
            break;
        }
        for (place, share) in GAUSS {
            let q = start + (stop - start) * 0.5 * (place + 1.0);
            basis.evaluate_into(q, &mut values);
            for (sum, value) in sums.iter_mut().zip(&values) {
                *sum += 0.5 * (stop - start) * share * weight(q) * value;
            }
        }
    }
    sums
}

pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values
        .into_iter()
        .fold(0.0, |largest, value| if value.is_nan() { value } else { largest.max(value.abs()) })
}

pub fn differ(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    largest(a.iter().zip(b).map(|(x, y)| x - y))
}

/// How large the functions become: 1, or for tangent integrals up to half the range.
pub fn size(basis: &Basis) -> f64 {
    match basis.kind() {
        geoerr_core::bases::BasisKind::TangentIntegral { .. } => length(basis),
        _ => 1.0,
    }
}
