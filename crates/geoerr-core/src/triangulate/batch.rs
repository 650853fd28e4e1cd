//! Batches: the fast kernels over chunks of rows, and the careful path for the rows they do not answer for.
//!
//! A chunk's numbers lie by component, so that the compiler works on as many rows at once as the registers hold; the
//! kernels are compiled for the widest ones, chosen when the program runs. A row's result does not depend on its neighbours:
//! the last chunk is filled up with its own last row.

use pulp::{Arch, Simd, WithSimd};

use super::fast::{self, Seen, State};
use super::pair::Pair;
use super::{PixelNoise, Pixels};
use crate::arithmetic::{Arithmetic, Fused, Separate};

/// Rows that are done together: what is worked out for them stays in the fastest cache.
pub(super) const CHUNK: usize = 64;

/// One number of every row of a chunk.
type Column = [f64; CHUNK];

const ZEROS: Column = [0.0; CHUNK];

/// What one camera saw of a chunk.
pub(super) struct ChunkView {
    /// From the camera's origin.
    x: [Column; 2],
    /// c00, c01, c11.
    covariance_px2: [Column; 3],
}

impl ChunkView {
    pub(super) fn new() -> Self {
        Self { x: [ZEROS; 2], covariance_px2: [ZEROS; 3] }
    }

    /// Takes the rows from `first` on, `n_rows` of them.
    pub(super) fn take(&mut self, seen: &Pixels<'_>, origin_px: &[f64; 2], first: usize, n_rows: usize) {
        for row in 0..CHUNK {
            let uv_px = &seen.uv_px[first + row.min(n_rows - 1)];
            for axis in 0..2 {
                self.x[axis][row] = uv_px[axis] - origin_px[axis];
            }
        }
        match seen.noise {
            PixelNoise::Sigma(sigma_px) => {
                self.covariance_px2 = [[sigma_px * sigma_px; CHUNK], ZEROS, [sigma_px * sigma_px; CHUNK]];
            }
            PixelNoise::Covariances(covariances) => {
                for row in 0..CHUNK {
                    let c = &covariances[first + row.min(n_rows - 1)];
                    self.covariance_px2[0][row] = c[0][0];
                    self.covariance_px2[1][row] = 0.5 * (c[0][1] + c[1][0]);
                    self.covariance_px2[2][row] = c[1][1];
                }
            }
        }
    }

    #[inline(always)]
    fn row(&self, row: usize) -> Seen {
        Seen { x: [0, 1].map(|i| self.x[i][row]), c: [0, 1, 2].map(|i| self.covariance_px2[i][row]) }
    }
}

/// What was found of a chunk.
pub(super) struct ChunkFound {
    pub point_mm: [Column; 3],
    /// xx, xy, xz, yy, yz, zz.
    pub covariance_mm2: [Column; 6],
    pub reprojection_px: Column,
    /// 0 where the careful path has to answer.
    pub is_good: [u64; CHUNK],
    depth_mm: Column,
    residual_px: [Column; 2],
}

impl ChunkFound {
    pub(super) fn new() -> Self {
        Self {
            point_mm: [ZEROS; 3],
            covariance_mm2: [ZEROS; 6],
            reprojection_px: ZEROS,
            is_good: [0; CHUNK],
            depth_mm: ZEROS,
            residual_px: [ZEROS; 2],
        }
    }

    #[inline(always)]
    fn state(&self, row: usize) -> State {
        State { depth_mm: self.depth_mm[row], residual_px: [0, 1].map(|i| self.residual_px[i][row]) }
    }

    #[inline(always)]
    fn set_state(&mut self, row: usize, state: &State) {
        self.depth_mm[row] = state.depth_mm;
        for i in 0..2 {
            self.residual_px[i][row] = state.residual_px[i];
        }
    }
}

/// Points, covariances and reprojection errors of a chunk.
pub(super) fn solve_chunk(
    pair: &Pair,
    left: &ChunkView,
    right: &ChunkView,
    reweightings: u32,
    found: &mut ChunkFound,
) {
    Arch::new().dispatch(Everything { pair, left, right, reweightings, found });
}

struct Everything<'a> {
    pair: &'a Pair,
    left: &'a ChunkView,
    right: &'a ChunkView,
    reweightings: u32,
    found: &'a mut ChunkFound,
}

impl Everything<'_> {
    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let Self { left, right, reweightings, found, .. } = self;
        // A copy of its own: the compiler need not expect the results to overwrite it.
        let pair = *self.pair;
        for row in 0..CHUNK {
            let (state, are_apart) = fast::start::<A>(&pair, &left.row(row), &right.row(row));
            found.set_state(row, &state);
            found.is_good[row] = u64::from(are_apart);
        }
        for _ in 0..reweightings {
            for row in 0..CHUNK {
                let state = fast::step::<A>(&pair, &left.row(row), &right.row(row), &found.state(row));
                found.set_state(row, &state);
            }
        }
        for row in 0..CHUNK {
            let all = fast::finish::<A>(&pair, &left.row(row), &right.row(row), &found.state(row));
            for i in 0..3 {
                found.point_mm[i][row] = all.point_mm[i];
            }
            for i in 0..6 {
                found.covariance_mm2[i][row] = all.covariance_mm2[i];
            }
            found.reprojection_px[row] = all.reprojection_px;
            found.is_good[row] &= u64::from(all.is_good);
        }
    }
}

impl WithSimd for Everything<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        if S::IS_SCALAR { self.run::<Separate>() } else { self.run::<Fused>() }
    }
}

/// Points of a chunk with equal noise in all pixels and no reweighting; whether all rows are good, and which.
pub(super) fn solve_points(
    pair: &Pair,
    left_px: &[[f64; 2]; CHUNK],
    right_px: &[[f64; 2]; CHUNK],
    points_mm: &mut [[f64; 3]; CHUNK],
) -> [u64; CHUNK] {
    Arch::new().dispatch(PointsOnly { pair, left_px, right_px, points_mm })
}

struct PointsOnly<'a> {
    pair: &'a Pair,
    left_px: &'a [[f64; 2]; CHUNK],
    right_px: &'a [[f64; 2]; CHUNK],
    points_mm: &'a mut [[f64; 3]; CHUNK],
}

impl PointsOnly<'_> {
    #[inline(always)]
    fn run<A: Arithmetic>(self) -> [u64; CHUNK] {
        let pair = *self.pair;
        let mut is_good = [0; CHUNK];
        let rows = self.left_px.iter().zip(self.right_px).zip(self.points_mm);
        for (((left_px, right_px), point_mm), is_good) in rows.zip(&mut is_good) {
            let (found_mm, good) = fast::point::<A>(&pair, left_px, right_px);
            *point_mm = found_mm;
            *is_good = u64::from(good);
        }
        is_good
    }
}

impl WithSimd for PointsOnly<'_> {
    type Output = [u64; CHUNK];
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> [u64; CHUNK] {
        if S::IS_SCALAR { self.run::<Separate>() } else { self.run::<Fused>() }
    }
}
