//! Batches: the fast kernels over chunks of rows, and the careful path for the rows they do not answer for.
//!
//! A chunk's numbers lie by component, so that the compiler works on as many rows at once as the registers hold; the
//! kernels are compiled for the widest ones, chosen when the program runs. A row's result does not depend on its neighbours:
//! the last chunk is filled up with its own last row.

use super::fast::{self, Noise, Own, Seen, State, Unit};
use super::pair::Pair;
use super::{PixelNoise, Pixels, Rows};
use crate::arithmetic::{Arithmetic, Kernel, all_three, both, run_in_512_bits};

/// Rows that are done together: what is worked out for them stays in the fastest cache.
pub(super) const CHUNK: usize = 64;

/// One number of every row of a chunk.
type Column = [f64; CHUNK];

const ZEROS: Column = [0.0; CHUNK];

/// A standard deviation whose square can be multiplied in afterwards.
const COMMON_SIGMA_PX: std::ops::Range<f64> = 1e-50..1e50;

/// What one camera saw of a chunk.
struct ChunkView {
    /// From the camera's origin.
    x: [Column; 2],
    /// c00, c01, c11.
    covariance_px2: [Column; 3],
}

impl ChunkView {
    const EMPTY: Self = Self { x: [ZEROS; 2], covariance_px2: [ZEROS; 3] };

    /// Takes the pixels of a chunk; `uv_px` has one row at least, and the last one fills it up.
    #[inline(always)]
    fn take_pixels(&mut self, uv_px: &[[f64; 2]], origin_px: &[f64; 2]) {
        let [u, v] = &mut self.x;
        for ((uv_px, u), v) in uv_px.iter().zip(u.iter_mut()).zip(v.iter_mut()) {
            *u = uv_px[0] - origin_px[0];
            *v = uv_px[1] - origin_px[1];
        }
        for column in &mut self.x {
            fill_up(column, uv_px.len());
        }
    }

    #[inline(always)]
    fn take_noise(&mut self, noise: &PixelNoise<'_>) {
        match noise {
            PixelNoise::Sigma(sigma_px) => {
                self.covariance_px2 = [[sigma_px * sigma_px; CHUNK], ZEROS, [sigma_px * sigma_px; CHUNK]];
            }
            PixelNoise::Covariances(covariances) => {
                let [c00, c01, c11] = &mut self.covariance_px2;
                for (((c, c00), c01), c11) in
                    covariances.iter().zip(c00.iter_mut()).zip(c01.iter_mut()).zip(c11)
                {
                    *c00 = c[0][0];
                    *c01 = 0.5 * (c[0][1] + c[1][0]);
                    *c11 = c[1][1];
                }
                for column in &mut self.covariance_px2 {
                    fill_up(column, covariances.len());
                }
            }
        }
    }

    #[inline(always)]
    fn x(&self, row: usize) -> [f64; 2] {
        [self.x[0][row], self.x[1][row]]
    }

    #[inline(always)]
    fn noise(&self, row: usize) -> Own {
        Own(all_three(|i| self.covariance_px2[i][row]))
    }
}

/// Repeats the last of the first `n_rows` numbers.
#[inline(always)]
fn fill_up(column: &mut Column, n_rows: usize) {
    if n_rows < CHUNK {
        let last = column[n_rows - 1];
        column[n_rows..].fill(last);
    }
}

/// What is worked out of a chunk, column by column.
struct Columns {
    depth_mm: Column,
    residual_px: [Column; 2],
    point_mm: [Column; 3],
    /// xx, xy, xz, yy, yz, zz.
    covariance_mm2: [Column; 6],
    reprojection_px: Column,
    /// 0 where the careful path has to answer.
    is_good: [u64; CHUNK],
}

impl Columns {
    #[inline(always)]
    fn state(&self, row: usize) -> State {
        State { depth_mm: self.depth_mm[row], residual_px: both(|i| self.residual_px[i][row]) }
    }

    #[inline(always)]
    fn set_state(&mut self, row: usize, state: &State) {
        self.depth_mm[row] = state.depth_mm;
        for i in 0..2 {
            self.residual_px[i][row] = state.residual_px[i];
        }
    }

    /// Writes the first rows into the result.
    ///
    /// Not in registers of 512 bits: there nine numbers a row would be scattered, which takes some processors as long as
    /// all that was worked out.
    #[inline(never)]
    fn store(&self, rows: &mut Rows<'_>) {
        let [x, y, z] = &self.point_mm;
        for (((p, x), y), z) in rows.points_mm.iter_mut().zip(x).zip(y).zip(z) {
            *p = [*x, *y, *z];
        }
        for (row, c) in rows.covariance_mm2.iter_mut().enumerate().take(CHUNK) {
            let [xx, xy, xz] = all_three(|i| self.covariance_mm2[i][row]);
            let [yy, yz, zz] = all_three(|i| self.covariance_mm2[3 + i][row]);
            *c = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        }
        for (reprojection_px, found) in rows.reprojection_px.iter_mut().zip(&self.reprojection_px) {
            *reprojection_px = *found;
        }
    }
}

/// Room for the work on chunks, made once for many of them.
pub(super) struct Workspace {
    left: ChunkView,
    right: ChunkView,
    columns: Columns,
}

impl Workspace {
    pub(super) fn new() -> Self {
        Self {
            left: ChunkView::EMPTY,
            right: ChunkView::EMPTY,
            columns: Columns {
                depth_mm: ZEROS,
                residual_px: [ZEROS; 2],
                point_mm: [ZEROS; 3],
                covariance_mm2: [ZEROS; 6],
                reprojection_px: ZEROS,
                is_good: [0; CHUNK],
            },
        }
    }

    /// Points, covariances and reprojection errors of up to [`CHUNK`] rows; 0 for each that the careful path has to answer.
    pub(super) fn solve(
        &mut self,
        pair: &Pair,
        left: &Pixels<'_>,
        right: &Pixels<'_>,
        reweightings: u32,
        rows: &mut Rows<'_>,
    ) -> &[u64] {
        let n_rows = rows.points_mm.len();
        run_in_512_bits(Everything { workspace: self, pair, left, right, reweightings });
        self.columns.store(rows);
        &self.columns.is_good[..n_rows]
    }
}

struct Everything<'a> {
    workspace: &'a mut Workspace,
    pair: &'a Pair,
    left: &'a Pixels<'a>,
    right: &'a Pixels<'a>,
    reweightings: u32,
}

impl Kernel for Everything<'_> {
    type Output = ();

    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let Workspace { left, right, columns } = self.workspace;
        // A copy of its own: the compiler need not expect the results to overwrite it.
        let pair = *self.pair;
        left.take_pixels(self.left.uv_px, &pair.left_origin_px);
        right.take_pixels(self.right.uv_px, &pair.right_origin_px);
        match (self.left.noise, self.right.noise) {
            (PixelNoise::Sigma(sigma_px), PixelNoise::Sigma(other_px))
                if sigma_px == other_px && COMMON_SIGMA_PX.contains(&sigma_px) =>
            {
                columns.fill::<A, Unit>(
                    &pair,
                    self.reweightings,
                    sigma_px * sigma_px,
                    |row| Seen { x: left.x(row), noise: Unit },
                    |row| Seen { x: right.x(row), noise: Unit },
                );
            }
            (noise_left, noise_right) => {
                left.take_noise(&noise_left);
                right.take_noise(&noise_right);
                columns.fill::<A, Own>(
                    &pair,
                    self.reweightings,
                    1.0,
                    |row| Seen { x: left.x(row), noise: left.noise(row) },
                    |row| Seen { x: right.x(row), noise: right.noise(row) },
                );
            }
        }
    }
}

impl Columns {
    /// `variance` is what the noise is a multiple of.
    #[inline(always)]
    fn fill<A: Arithmetic, N: Noise>(
        &mut self,
        pair: &Pair,
        reweightings: u32,
        variance: f64,
        left: impl Fn(usize) -> Seen<N>,
        right: impl Fn(usize) -> Seen<N>,
    ) {
        for row in 0..CHUNK {
            let (state, are_apart) = fast::start::<A, N>(pair, &left(row), &right(row));
            self.set_state(row, &state);
            self.is_good[row] = u64::from(are_apart);
        }
        for _ in 0..reweightings {
            for row in 0..CHUNK {
                let state = fast::step::<A, N>(pair, &left(row), &right(row), &self.state(row));
                self.set_state(row, &state);
            }
        }
        for row in 0..CHUNK {
            let all = fast::finish::<A, N>(pair, &left(row), &right(row), &self.state(row));
            for i in 0..3 {
                self.point_mm[i][row] = all.point_mm[i];
            }
            for i in 0..6 {
                self.covariance_mm2[i][row] = all.covariance_mm2[i] * variance;
            }
            self.reprojection_px[row] = all.reprojection_px;
            self.is_good[row] &= u64::from(all.is_good);
        }
    }
}

/// Points of a chunk with equal noise in all pixels and no reweighting; whether all rows are good, and which.
pub(super) fn solve_points<P: Copy + Into<f64>>(
    pair: &Pair,
    left_px: &[[P; 2]; CHUNK],
    right_px: &[[P; 2]; CHUNK],
    points_mm: &mut [[f64; 3]; CHUNK],
) -> [u64; CHUNK] {
    run_in_512_bits(PointsOnly { pair, left_px, right_px, points_mm })
}

struct PointsOnly<'a, P> {
    pair: &'a Pair,
    left_px: &'a [[P; 2]; CHUNK],
    right_px: &'a [[P; 2]; CHUNK],
    points_mm: &'a mut [[f64; 3]; CHUNK],
}

impl<P: Copy + Into<f64>> Kernel for PointsOnly<'_, P> {
    type Output = [u64; CHUNK];

    #[inline(always)]
    fn run<A: Arithmetic>(self) -> [u64; CHUNK] {
        let pair = *self.pair;
        let mut is_good = [0; CHUNK];
        let rows = self.left_px.iter().zip(self.right_px).zip(self.points_mm);
        for (((left_px, right_px), point_mm), is_good) in rows.zip(&mut is_good) {
            let (found_mm, good) =
                fast::point::<A>(&pair, &both(|i| left_px[i].into()), &both(|i| right_px[i].into()));
            *point_mm = found_mm;
            *is_good = u64::from(good);
        }
        is_good
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::run_widest;
    use crate::triangulate::Rig;

    /// Pixels of a chunk, each row with its own; some are not seen by both cameras at one place.
    fn pixels(camera: f64) -> [[f64; 2]; CHUNK] {
        std::array::from_fn(|row| {
            let row = row as f64;
            [
                1100.0 + 17.0 * row - 480.0 * camera - 3.1 * row * camera,
                900.0 + 11.0 * row + 0.07 * (row * camera).sin(),
            ]
        })
    }

    #[test]
    fn all_registers_give_the_same_bits() {
        let left = [[2000.0, 0.0, 1000.0, 0.0], [0.0, 2000.0, 1000.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let mut right = left;
        right[0][3] = -2000.0 * 200.0;
        let pair = Rig::new(&left, &right).unwrap().pair;
        let (left_px, right_px) = (pixels(0.0), pixels(1.0));
        let mut points_mm = [[[0.0; 3]; CHUNK]; 2];
        let [wide, widest] = &mut points_mm;
        let good = [
            run_widest(PointsOnly { pair: &pair, left_px: &left_px, right_px: &right_px, points_mm: wide }),
            run_in_512_bits(PointsOnly {
                pair: &pair,
                left_px: &left_px,
                right_px: &right_px,
                points_mm: widest,
            }),
        ];
        assert_eq!(good[0], good[1]);
        assert_eq!(points_mm[0], points_mm[1]);
        assert!(good[0].iter().filter(|&&good| good == 1).count() > CHUNK / 2);
    }
}
