//! Products of everything at a pixel with everything else, summed over pixels.

use super::lanes::{Lanes, WIDTH};
use crate::least_squares::set_gram;

/// Pixels whose sums are in single precision: their columns stay in the cache.
const SOME: usize = 16 * WIDTH;

/// Sums of products of everything with everything: of some pixels in single precision, of all of them in double.
pub(super) struct Products<const N: usize> {
    /// Column after column.
    some: Vec<f32>,
    n_some: usize,
    all: [[f64; N]; N],
}

impl<const N: usize> Products<N> {
    pub(super) fn new() -> Self {
        Self { some: vec![0.0; N * SOME], n_some: 0, all: [[0.0; N]; N] }
    }

    #[inline(always)]
    pub(super) fn add(&mut self, all: &[Lanes; N]) {
        let first = self.n_some;
        for (column, lanes) in self.some.chunks_exact_mut(SOME).zip(all) {
            column[first..first + WIDTH].copy_from_slice(&lanes.0);
        }
        self.n_some += WIDTH;
        if self.n_some == SOME {
            self.flush();
        }
    }

    fn flush(&mut self) {
        for column in self.some.chunks_exact_mut(SOME) {
            column[self.n_some..].fill(0.0);
        }
        let mut products = vec![0.0; N * N];
        set_gram(&mut products, &self.some, SOME);
        for (sums, products) in self.all.iter_mut().zip(products.chunks_exact(N)) {
            for (sum, &product) in sums.iter_mut().zip(products) {
                *sum += f64::from(product);
            }
        }
        self.n_some = 0;
    }

    pub(super) fn finished(mut self) -> [[f64; N]; N] {
        self.flush();
        self.all
    }
}
