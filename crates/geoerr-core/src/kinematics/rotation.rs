//! Exact rotations by small vectors, without the digits that `R − I` formed from `R` would lose.

use super::vec3::{Vec3, add, cross, dot, scale};

/// A rotation with the coefficients of Rodrigues' formula at its angle θ.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rotation {
    /// The rotation vector ε, rad.
    vector: Vec3,
    /// θ².
    t2: f64,
    /// sin θ / θ.
    s1: f64,
    /// (1 − cos θ) / θ².
    s2: f64,
}

/// Below this θ² the series to θ⁸ are exact to the last digit: the next term is under 3e-18 of the sum.
const SERIES_BELOW: f64 = 0.01;

/// `1/first! − t2/(first+2)! + t2²/(first+4)! − ...`: the series of sin θ / θ and its kin.
#[inline]
fn series(t2: f64, inverse_factorials: [f64; 5]) -> f64 {
    let [a, b, c, d, e] = inverse_factorials;
    a - t2 * (b - t2 * (c - t2 * (d - t2 * e)))
}

impl Rotation {
    #[inline]
    pub(crate) fn new(vector: &Vec3) -> Self {
        let t2 = dot(vector, vector);
        let (s1, s2) = if t2 < SERIES_BELOW {
            (
                series(t2, [1.0, 1.0 / 6.0, 1.0 / 120.0, 1.0 / 5040.0, 1.0 / 362_880.0]),
                series(t2, [0.5, 1.0 / 24.0, 1.0 / 720.0, 1.0 / 40_320.0, 1.0 / 3_628_800.0]),
            )
        } else {
            let t = t2.sqrt();
            let half = (0.5 * t).sin();
            (t.sin() / t, 2.0 * half * half / t2)
        };
        Self { vector: *vector, t2, s1, s2 }
    }

    /// (θ − sin θ) / θ³.
    #[inline]
    fn s3(&self) -> f64 {
        if self.t2 < SERIES_BELOW {
            series(self.t2, [1.0 / 6.0, 1.0 / 120.0, 1.0 / 5040.0, 1.0 / 362_880.0, 1.0 / 39_916_800.0])
        } else {
            (1.0 - self.s1) / self.t2
        }
    }

    /// The rotation by −ε.
    #[inline]
    pub(super) fn inverse(&self) -> Self {
        Self { vector: scale(-1.0, &self.vector), ..*self }
    }

    /// `(R − I) v`; exactly 0 for ε = 0.
    #[inline]
    pub(super) fn displacement(&self, v: &Vec3) -> Vec3 {
        let once = cross(&self.vector, v);
        add(&scale(self.s1, &once), &scale(self.s2, &cross(&self.vector, &once)))
    }

    /// `R v`; exactly `v` for ε = 0.
    #[inline]
    pub(super) fn apply(&self, v: &Vec3) -> Vec3 {
        add(v, &self.displacement(v))
    }

    /// Angular velocity ω with `d(R v)/dq = ω × (R v)` where ε changes at `rate` (rad for each mm).
    #[inline]
    pub(super) fn velocity(&self, rate: &Vec3) -> Vec3 {
        let once = cross(&self.vector, rate);
        let twice = cross(&self.vector, &once);
        add(rate, &add(&scale(self.s2, &once), &scale(self.s3(), &twice)))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Vector3};

    use super::*;

    #[test]
    fn against_nalgebra_on_both_sides_of_the_series() {
        let axis = Vector3::new(0.3, -0.7, 0.2).normalize();
        let v = Vector3::new(211.0, -95.0, 140.0);
        for angle in [1e-9, 1e-4, 0.0999, 0.1001, 1.3, 3.0] {
            let vector: Vec3 = (axis * angle).into();
            let expected = Rotation3::from_scaled_axis(axis * angle) * v;
            let got = Vector3::from(Rotation::new(&vector).apply(&v.into()));
            assert!((got - expected).norm() < 2e-13, "angle {angle}: {}", (got - expected).norm());
        }
    }

    #[test]
    fn series_and_closed_form_meet() {
        let (below, above) =
            (Rotation::new(&[0.1 - 1e-12, 0.0, 0.0]), Rotation::new(&[0.1 + 1e-12, 0.0, 0.0]));
        assert!((below.s1 - above.s1).abs() < 1e-13);
        assert!((below.s2 - above.s2).abs() < 1e-13);
        assert!((below.s3() - above.s3()).abs() < 1e-13);
    }

    #[test]
    fn velocity_against_differences() {
        let (at, rate) = ([0.02, -0.05, 0.04], [1e-3, 2e-3, -3e-3]);
        for scale_up in [1.0, 20.0] {
            let at = scale(scale_up, &at);
            let v = [10.0, 20.0, 30.0];
            let rotated = |h: f64| Rotation::new(&add(&at, &scale(h, &rate))).apply(&v);
            let rotation = Rotation::new(&at);
            let analytic = cross(&rotation.velocity(&rate), &rotation.apply(&v));
            for (c, analytic) in analytic.into_iter().enumerate() {
                let difference = (rotated(1e-3)[c] - rotated(-1e-3)[c]) / 2e-3;
                assert!((difference - analytic).abs() < 1e-10, "{difference} {analytic}");
            }
        }
    }

    #[test]
    fn no_rotation_is_exact() {
        let none = Rotation::new(&[0.0; 3]);
        assert_eq!(none.apply(&[0.1, 1e9, -3.0]), [0.1, 1e9, -3.0]);
        assert_eq!(none.velocity(&[0.0; 3]), [0.0; 3]);
    }
}
