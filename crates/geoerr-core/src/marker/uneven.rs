//! Light that no quadratic follows: a shadow's edge across the plate, a reflection.
//!
//! What is left then has a sign in common over whole parts of the plate, and a covariance that takes each pixel for itself
//! promises too much: behind a shadow's edge corners were off by 15 of its standard deviations. So the plate is cut into
//! parts of a fifth of its width. Where the sums of what is left over parts are what independent pixels make them, nothing
//! is done. Where they are larger, the corners are found without each part in turn, without each row of parts and without each
//! column, and the mean of what these three say of how far corners move is added. Single parts alone promise too much of the
//! middle of a plate where an edge runs along it (1.6 standard deviations in the root mean square), rows and columns too little.
//!
//! With `r` what is left of a pixel, `c` the model's derivatives there, g a part (a row, a column) of G:
//!
//! ```text
//! D   = mean over parts g of (Σ_g r)² / Σ_g r²                      1 for independent pixels
//! m_g = (Σ c cᵀ − Σ_g c cᵀ)⁻¹ Σ_g c r                         what the unknowns move by without g
//! C   = White's + mean over the three cuts of (1 − 1/G) Σ_g m_g m_gᵀ
//! ```
//!
//! # Source
//! D is Kish's design effect (*Survey Sampling*, 1965, 5.4). Σ m mᵀ is the jackknife by groups: the covariance of Liang &
//! Zeger (*Biometrika* 73, 1986) in the form of MacKinnon & White (*J. Econometrics* 29, 1985, HC3) that does not shrink
//! where few groups hold much of what is known (Bell & McCaffrey, *Survey Methodology* 28, 2002).
//!
//! # Verified
//! `tests/vision/test_marker_fit.py`: errors over standard deviations under drawn shadows, and without any.

use nalgebra::{SMatrix, SVector};

use super::flat::Flat;
use super::homography::solved;
use super::lanes::{SHIFT, WIDTH};
use super::model::{Evaluated, FIRST_LEVEL, N_LIGHT, N_UNKNOWNS, State, light_at};
use super::pixels::Pixels;
use super::scene::Scene;

/// Parts along a side of the window: an odd number, so that one is in the middle.
const PER_SIDE: usize = 5;
/// Places along a side with those outside: a power of 2.
const PLACES: usize = 8;
const N_PARTS: usize = PLACES * PLACES;
/// What is left between edges is looked at in every so many-th pixel: a second one says little more.
const FLAT_STEP: usize = 2;
/// The last bits of numbers as large say which part it is, as in `Lanes::rounded`.
const MIDDLE: f32 = SHIFT + (PER_SIDE / 2) as f32;
/// A part of fewer pixels says nothing.
const LEAST_IN_PART: u32 = 12;
/// Standard deviations by which D has to lie above 1: its excess by chance has a long tail.
const CHANCE_SIGMAS: f64 = 4.0;
/// Everything that is adjusted, and the residual.
const N_ALL: usize = N_UNKNOWNS + 1;

/// Sums of products of derivatives.
pub(super) type Gram = [[f64; N_UNKNOWNS]; N_UNKNOWNS];

/// Of derivatives and what is left with each other.
type Products = [[f64; N_ALL]; N_ALL];

/// Into single parts, rows of them and columns: an edge that runs along the plate pulls at all of a row alike.
const CUTS: [fn(usize) -> usize; 3] = [|part| part, |part| part / PLACES, |part| part % PLACES];

/// What is left in a part.
#[derive(Clone, Copy, Default)]
struct Left {
    sum: f32,
    squares: f32,
    count: u32,
}

/// The plate's parts, and what is left in each.
pub(super) struct Parts {
    /// Parts for each half of the marker's side.
    per: f32,
    left: [Left; N_PARTS],
}

impl Parts {
    pub(super) fn new(scene: &Scene<'_>) -> Self {
        Self { per: (PER_SIDE as f64 / (2.0 * scene.reach)) as f32, left: [Left::default(); N_PARTS] }
    }

    /// The part at a place from the centre: of a place outside one of its own, that is beside the others.
    #[inline(always)]
    fn at(&self, place: [f32; 2]) -> usize {
        let [across, down] = place.map(|off| (off * self.per + MIDDLE).to_bits() as usize % PLACES);
        across * PLACES + down
    }

    #[inline(always)]
    pub(super) fn add(&mut self, place: [f32; 2], residual: f32) {
        let own = &mut self.left[self.at(place)];
        own.sum += residual;
        own.squares += residual * residual;
        own.count += 1;
    }

    pub(super) fn add_flat(&mut self, flat: &Flat, residuals: &[Vec<f32>; 2]) {
        flat.each(
            residuals,
            FLAT_STEP,
            #[inline(always)]
            |_, place, residual| self.add(place, residual),
        );
    }

    /// Whether parts are off as wholes by more than independent pixels are.
    pub(super) fn are_uneven(&self) -> bool {
        let of_parts: Vec<f64> = (self.left.iter())
            .filter(|own| own.count >= LEAST_IN_PART && own.squares > 0.0)
            .map(|own| f64::from(own.sum).powi(2) / f64::from(own.squares))
            .collect();
        let n = of_parts.len() as f64;
        // χ² of one degree of freedom each: the variance is 2.
        of_parts.iter().sum::<f64>() > n + CHANCE_SIGMAS * (2.0 * n).sqrt()
    }

    /// The homography's covariance (8 × 8) from how far it moves without each part.
    pub(super) fn moves(
        &self,
        scene: &Scene<'_>,
        pixels: &Pixels,
        state: &State,
        information: &Gram,
        of_flat: &[Vec<f32>; 2],
    ) -> Option<SMatrix<f64, 8, 8>> {
        let of_parts = self.products(scene, pixels, state, of_flat);
        let mut sum = SMatrix::zeros();
        for cut in CUTS {
            sum += without_each(&joined(&of_parts, cut), information)? / CUTS.len() as f64;
        }
        Some(sum)
    }

    /// Products of derivatives and what is left with each other, of each part.
    fn products(
        &self,
        scene: &Scene<'_>,
        pixels: &Pixels,
        state: &State,
        of_flat: &[Vec<f32>; 2],
    ) -> Vec<Products> {
        let mut of_parts = vec![[[0.0; N_ALL]; N_ALL]; N_PARTS];
        pixels.each(
            state,
            scene,
            false,
            #[inline(always)]
            |kept, own| {
                for lane in 0..WIDTH {
                    if kept.0[lane] > 0.0 {
                        let all: [f64; N_ALL] = std::array::from_fn(|i| {
                            f64::from(own.columns.get(i).map_or(own.residual, |column| *column).0[lane])
                        });
                        add_products(&mut of_parts[self.at(place_of(own, lane))], &all, 0);
                    }
                }
            },
        );
        pixels.flat.each(of_flat, 1, |colour, place, residual| {
            let light = light_at(1.0, place).map(f64::from);
            let sums = &mut of_parts[self.at(place)];
            let first = FIRST_LEVEL + colour * N_LIGHT;
            add_products(sums, &light, first);
            for (sum, light) in sums[N_UNKNOWNS][first..first + N_LIGHT].iter_mut().zip(light) {
                *sum += light * f64::from(residual);
            }
            sums[N_UNKNOWNS][N_UNKNOWNS] += f64::from(residual).powi(2);
        });
        of_parts
    }
}

/// Sums over the parts that a cut does not part.
fn joined(of_parts: &[Products], cut: fn(usize) -> usize) -> Vec<Products> {
    let mut joined = vec![[[0.0; N_ALL]; N_ALL]; N_PARTS];
    for (part, own) in of_parts.iter().enumerate() {
        let sums = joined[cut(part)].iter_mut().flatten();
        sums.zip(own.iter().flatten()).for_each(|(sum, value)| *sum += value);
    }
    joined
}

/// The homography's covariance from how far it moves without each; `None` where one decides alone.
fn without_each(of_parts: &[Products], information: &Gram) -> Option<SMatrix<f64, 8, 8>> {
    let mut sum = SMatrix::zeros();
    let mut n_parts = 0.0;
    for own in of_parts.iter().filter(|own| own[N_UNKNOWNS][N_UNKNOWNS] > 0.0) {
        let without: Vec<f64> = (information.iter().zip(own))
            .flat_map(|(all, own)| all.iter().zip(own).map(|(all, own)| all - own))
            .collect();
        let moved = solved(&without, &own[N_UNKNOWNS][..N_UNKNOWNS])?;
        let moved = SVector::<f64, 8>::from_column_slice(&moved[..8]);
        sum += moved * moved.transpose();
        n_parts += 1.0;
    }
    Some(sum * (1.0 - 1.0 / n_parts))
}

/// Where a pixel near an edge lies from the centre: what is light times 1, u, v of black and of white is so of both.
#[inline(always)]
pub(super) fn place_of(own: &Evaluated, lane: usize) -> [f32; 2] {
    [1, 2].map(|i| own.columns[FIRST_LEVEL + i].0[lane] + own.columns[FIRST_LEVEL + N_LIGHT + i].0[lane])
}

/// Adds products of numbers with each other, from a row and column on.
#[inline(always)]
fn add_products<const N: usize>(sums: &mut [[f64; N_ALL]; N_ALL], all: &[f64; N], first: usize) {
    for (row, &one) in sums[first..first + N].iter_mut().zip(all) {
        for (sum, &other) in row[first..first + N].iter_mut().zip(all) {
            *sum += one * other;
        }
    }
}
