//! Products of everything at a pixel with everything else, summed over pixels.

use super::lanes::{Lanes, WIDTH};
use crate::arithmetic::{Arithmetic, Kernel, run_in_512_bits};

/// Columns that are multiplied at once each way: their sums stay in registers.
const TILE: usize = 4;
/// Blocks whose columns stay in the cache.
const SOME: usize = 16;
/// So many times such blocks are summed in single precision, each lane by itself.
const MOST_TIMES: usize = 4;

/// Columns of a tile.
type Columns = [[Lanes; SOME]; TILE];

/// Sums of products of columns with columns, by lanes.
type Tile = [[Lanes; TILE]; TILE];

/// Sums of products of everything with everything: of some pixels in single precision, of all of them in double.
pub(super) struct Products<const N: usize> {
    /// By tiles; columns behind the last, which make its tile whole, are 0.
    some: Vec<Columns>,
    n_some: usize,
    /// Row after row of tiles, each from the diagonal on.
    tiles: Vec<Tile>,
    n_times: usize,
    all: [[f64; N]; N],
}

impl<const N: usize> Products<N> {
    pub(super) fn new() -> Self {
        let n_tiles = N.div_ceil(TILE);
        Self {
            some: vec![[[Lanes::ZERO; SOME]; TILE]; n_tiles],
            n_some: 0,
            tiles: vec![[[Lanes::ZERO; TILE]; TILE]; n_tiles * (n_tiles + 1) / 2],
            n_times: 0,
            all: [[0.0; N]; N],
        }
    }

    #[inline(always)]
    pub(super) fn add(&mut self, all: &[Lanes; N]) {
        for (column, &lanes) in self.some.iter_mut().flatten().zip(all) {
            column[self.n_some] = lanes;
        }
        self.n_some += 1;
        if self.n_some == SOME {
            self.multiply();
        }
    }

    #[inline(never)]
    fn multiply(&mut self) {
        run_in_512_bits(AddProducts { tiles: &mut self.tiles, columns: &self.some, n_blocks: self.n_some });
        self.n_some = 0;
        self.n_times += 1;
        if self.n_times == MOST_TIMES {
            self.sum();
        }
    }

    /// Takes the lanes of all tiles together, and begins anew.
    fn sum(&mut self) {
        let n_tiles = N.div_ceil(TILE);
        let places = (0..n_tiles).flat_map(|down| (down..n_tiles).map(move |across| [down, across]));
        for ([down, across], tile) in places.zip(&mut self.tiles) {
            for (row, sums) in (down * TILE..N).zip(tile.iter()) {
                for (sum, lanes) in self.all[row][across * TILE..].iter_mut().zip(sums) {
                    *sum += lanes.sum();
                }
            }
            *tile = [[Lanes::ZERO; TILE]; TILE];
        }
        self.n_times = 0;
    }

    pub(super) fn finished(mut self) -> [[f64; N]; N] {
        self.multiply();
        self.sum();
        std::array::from_fn(|i| std::array::from_fn(|j| self.all[i.min(j)][i.max(j)]))
    }
}

/// Adds the products of columns' first blocks to all tiles.
struct AddProducts<'a> {
    tiles: &'a mut [Tile],
    columns: &'a [Columns],
    n_blocks: usize,
}

impl Kernel for AddProducts<'_> {
    type Output = ();

    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let mut tiles = self.tiles.iter_mut();
        for (place, down) in self.columns.iter().enumerate() {
            for (across, tile) in self.columns[place..].iter().zip(&mut tiles) {
                add_products::<A>(tile, down, across, self.n_blocks);
            }
        }
    }
}

#[inline(always)]
fn add_products<A: Arithmetic>(tile: &mut Tile, down: &Columns, across: &Columns, n_blocks: usize) {
    let mut sums = *tile;
    for block in 0..n_blocks.min(SOME) {
        // Lanes outermost: they are what is made a register.
        for lane in 0..WIDTH {
            for (sums, one) in sums.iter_mut().zip(down) {
                for (sum, other) in sums.iter_mut().zip(across) {
                    sum.0[lane] = A::mul_add_f32(one[block].0[lane], other[block].0[lane], sum.0[lane]);
                }
            }
        }
    }
    *tile = sums;
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sums_are_those_of_single_products(n_blocks in 0_usize..150, seed in 0_u32..1000) {
            // More blocks than are summed in single precision, and a last tile that is not whole.
            const N: usize = 7;
            let value = |block: usize, column: usize, lane: usize| {
                let place = (block * N + column) * WIDTH + lane;
                ((place as u32).wrapping_mul(2_654_435_761).wrapping_add(seed) >> 8) as f32 / 16_777_216.0 - 0.3
            };
            let mut products = Products::<N>::new();
            let mut expected = [[0.0; N]; N];
            for block in 0..n_blocks {
                let all: [Lanes; N] =
                    std::array::from_fn(|column| Lanes::from_fn(|lane| value(block, column, lane)));
                products.add(&all);
                for lane in 0..WIDTH {
                    for (i, row) in expected.iter_mut().enumerate() {
                        for (j, sum) in row.iter_mut().enumerate() {
                            *sum += f64::from(all[i].0[lane]) * f64::from(all[j].0[lane]);
                        }
                    }
                }
            }
            let found = products.finished();
            let size = expected.iter().flatten().fold(1.0_f64, |most, value| most.max(value.abs()));
            for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
                prop_assert!((found - expected).abs() < 2e-6 * size, "{found}, {expected}");
            }
        }
    }
}
