//! Numbers to test with that look drawn: the same for the same seed, on every machine.

use geoerr_core::least_squares::Matrix;

/// SplitMix64: a few lines instead of a dependency, and good from any seed on, 0 and neighbours of each other too.
pub struct Draws(u64);

impl Draws {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Evenly in [0, 1).
    pub fn fraction(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Evenly in [−1, 1).
    pub fn symmetric(&mut self) -> f64 {
        2.0 * self.fraction() - 1.0
    }

    /// Standard normal, by Box and Muller.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.fraction()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.fraction()).cos()
    }

    /// One of the numbers from 0 to `count` − 1.
    pub fn below(&mut self, count: usize) -> usize {
        (self.fraction() * count as f64) as usize
    }

    /// Evenly in a cube of half edge `half` about the origin.
    pub fn three(&mut self, half: f64) -> [f64; 3] {
        std::array::from_fn(|_| half * self.symmetric())
    }

    /// As many in [−1, 1).
    pub fn column(&mut self, n_rows: usize) -> Vec<f64> {
        (0..n_rows).map(|_| self.symmetric()).collect()
    }

    /// Entries in [−1, 1).
    pub fn matrix(&mut self, n_rows: usize, n_columns: usize) -> Matrix {
        Matrix::from_fn(n_rows, n_columns, |_, _| self.symmetric())
    }
}
