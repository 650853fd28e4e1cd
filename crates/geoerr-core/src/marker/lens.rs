//! A lens that bends rays, and its inverse.

/// Steps of Newton's method: a lens that has an inverse at a pixel needs five.
const STEPS: usize = 12;
/// What is left when nothing more is to be gained, and what is no inverse.
const ROUNDED: f64 = 1e-15;
const NO_INVERSE: f64 = 1e-12;

/// A camera's lens: Brown's model with rational radial terms and thin prisms, in OpenCV's order
/// `k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Focal lengths along u and v, px.
    pub focal_px: [f64; 2],
    /// Where the optical axis meets the picture, px.
    pub principal_point_px: [f64; 2],
    /// Distortion coefficients; 0 where there are fewer.
    pub distortion: [f64; 12],
}

impl Lens {
    /// Bends a ray (x/z, y/z), and gives the derivative of what comes out.
    #[must_use]
    pub fn bent(&self, [x, y]: [f64; 2]) -> ([f64; 2], [[f64; 2]; 2]) {
        let k = &self.distortion;
        let r2 = x * x + y * y;
        let numerator = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
        let numerator_slope = k[0] + r2 * (2.0 * k[1] + 3.0 * r2 * k[4]);
        let denominator = 1.0 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]));
        let denominator_slope = k[5] + r2 * (2.0 * k[6] + 3.0 * r2 * k[7]);
        let g = numerator / denominator;
        let g_slope = (numerator_slope - g * denominator_slope) / denominator;
        let xy2 = 2.0 * x * y;
        let bent = [
            x * g + k[2] * xy2 + k[3] * (r2 + 2.0 * x * x) + r2 * (k[8] + r2 * k[9]),
            y * g + k[2] * (r2 + 2.0 * y * y) + k[3] * xy2 + r2 * (k[10] + r2 * k[11]),
        ];
        let prism = [2.0 * (k[8] + 2.0 * r2 * k[9]), 2.0 * (k[10] + 2.0 * r2 * k[11])];
        let across = xy2 * g_slope + 2.0 * k[2] * x + 2.0 * k[3] * y;
        let slope = [
            [
                g + 2.0 * x * x * g_slope + 2.0 * k[2] * y + 6.0 * k[3] * x + prism[0] * x,
                across + prism[0] * y,
            ],
            [
                across + prism[1] * x,
                g + 2.0 * y * y * g_slope + 6.0 * k[2] * y + 2.0 * k[3] * x + prism[1] * y,
            ],
        ];
        (bent, slope)
    }

    /// The ray that a pixel sees; `None` where the lens model has no inverse.
    #[must_use]
    pub fn ray(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        let wanted = [0, 1].map(|c| (pixel[c] - self.principal_point_px[c]) / self.focal_px[c]);
        if self.distortion.iter().all(|&k| k == 0.0) {
            return Some(wanted);
        }
        let mut ray = wanted;
        for _ in 0..STEPS {
            let (bent, [[a, b], [c, d]]) = self.bent(ray);
            let missing = [wanted[0] - bent[0], wanted[1] - bent[1]];
            let determinant = a * d - b * c;
            if missing.iter().all(|value| value.abs() < ROUNDED) {
                break;
            }
            ray[0] += (d * missing[0] - b * missing[1]) / determinant;
            ray[1] += (a * missing[1] - c * missing[0]) / determinant;
        }
        let (bent, [[a, b], [c, d]]) = self.bent(ray);
        let is_inverse = (0..2).all(|c| (bent[c] - wanted[c]).abs() < NO_INVERSE) && a * d - b * c > 0.0;
        is_inverse.then_some(ray)
    }

    /// The pixel at which a lens without distortion would show a ray.
    #[must_use]
    pub fn undistorted_pixel(&self, ray: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|c| ray[c] * self.focal_px[c] + self.principal_point_px[c])
    }
}
