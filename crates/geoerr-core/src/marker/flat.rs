//! Pixels far from every edge: they say how bright black and white are, whatever the corners do.

use super::lanes::{Lanes, WIDTH};
use super::model::{N_LEVELS, N_LIGHT, light_at};
use super::products::Products;
use crate::arithmetic::{in_512_bits, in_wide_registers};

/// Light of a pixel and one number more.
const N_ALL: usize = N_LIGHT + 1;

/// All pixels of one colour: where they are from the centre, and how bright.
#[derive(Clone, Default)]
pub(super) struct FlatPixels {
    u: Vec<f32>,
    v: Vec<f32>,
    grey: Vec<f32>,
}

/// All of them.
pub(super) struct Flat {
    /// Black, then white.
    pixels: [FlatPixels; 2],
    /// Of their normal equations, which never change: (12 × 12) and (12,).
    pub gram: [[f64; N_LEVELS]; N_LEVELS],
    pub right: [f64; N_LEVELS],
}

impl FlatPixels {
    pub(super) fn push(&mut self, [u, v]: [f32; 2], grey: u8) {
        self.u.push(u);
        self.v.push(v);
        self.grey.push(f32::from(grey));
    }

    pub(super) fn len(&self) -> usize {
        self.grey.len()
    }

    /// Every so many-th.
    pub(super) fn every(self, step: usize) -> Self {
        if step == 1 { self } else { self.chosen(|place| place % step == 0) }
    }

    fn chosen(&self, is_kept: impl Fn(usize) -> bool) -> Self {
        let of = |column: &[f32]| {
            column.iter().enumerate().filter(|&(place, _)| is_kept(place)).map(|(_, &value)| value).collect()
        };
        Self { u: of(&self.u), v: of(&self.v), grey: of(&self.grey) }
    }

    /// Measured minus what the levels of their colour say.
    fn residuals(&self, levels: &[f64]) -> Vec<f32> {
        let levels: [f32; N_LIGHT] = std::array::from_fn(|i| levels[i] as f32);
        let mut left = self.grey.clone();
        in_wide_registers(
            #[inline(always)]
            || {
                for ((left, &u), &v) in left.iter_mut().zip(&self.u).zip(&self.v) {
                    for (light, level) in light_at(1.0, [u, v]).into_iter().zip(levels) {
                        *left -= light * level;
                    }
                }
            },
        );
        left
    }

    /// Products of light and `beside` with each other; both are multiplied by `scale` first.
    fn gram(&self, beside: &[f32], scale: Option<&[f32]>) -> [[f64; N_ALL]; N_ALL] {
        let mut products = Products::new();
        in_512_bits(
            #[inline(always)]
            || {
                for first in (0..self.len()).step_by(WIDTH) {
                    let here = |all: &[f32]| Lanes::first_of(&all[first..]);
                    let is_pixel = Lanes::from_fn(|lane| if first + lane < self.len() { 1.0 } else { 0.0 });
                    let scale = scale.map_or(is_pixel, here);
                    let mut all = [here(beside) * scale; N_ALL];
                    for (column, light) in
                        all.iter_mut().zip(light_at(is_pixel, [here(&self.u), here(&self.v)]))
                    {
                        *column = light * scale;
                    }
                    products.add(&all);
                }
            },
        );
        products.finished()
    }
}

impl Flat {
    /// Of black pixels and white ones.
    pub(super) fn new(pixels: [FlatPixels; 2]) -> Self {
        let mut flat = Self { pixels, gram: [[0.0; N_LEVELS]; N_LEVELS], right: [0.0; N_LEVELS] };
        for (own, first) in flat.pixels.iter().zip([0, N_LIGHT]) {
            for (i, products) in own.gram(&own.grey, None)[..N_LIGHT].iter().enumerate() {
                flat.gram[first + i][first..first + N_LIGHT].copy_from_slice(&products[..N_LIGHT]);
                flat.right[first + i] = products[N_LIGHT];
            }
        }
        flat
    }

    /// Measured minus what the levels say, of black pixels and of white ones.
    pub(super) fn residuals(&self, levels: &[f64; N_LEVELS]) -> [Vec<f32>; 2] {
        [0, 1].map(|colour| self.pixels[colour].residuals(&levels[colour * N_LIGHT..][..N_LIGHT]))
    }

    /// Calls `visit` with the colour, the place and what is left of every so many-th pixel.
    #[inline(always)]
    pub(super) fn each(
        &self,
        residuals: &[Vec<f32>; 2],
        step: usize,
        mut visit: impl FnMut(usize, [f32; 2], f32),
    ) {
        for (colour, (own, left)) in self.pixels.iter().zip(residuals).enumerate() {
            for ((&u, &v), &left) in own.u.iter().zip(&own.v).zip(left).step_by(step) {
                visit(colour, [u, v], left);
            }
        }
    }

    /// `gram` with each pixel's squared residual as its weight.
    pub(super) fn weighted_gram(&self, residuals: &[Vec<f32>; 2]) -> [[f64; N_LEVELS]; N_LEVELS] {
        let mut whole = [[0.0; N_LEVELS]; N_LEVELS];
        for ((own, first), left) in self.pixels.iter().zip([0, N_LIGHT]).zip(residuals) {
            for (i, products) in own.gram(left, Some(left))[..N_LIGHT].iter().enumerate() {
                whole[first + i][first..first + N_LIGHT].copy_from_slice(&products[..N_LIGHT]);
            }
        }
        whole
    }

    /// Those that are true in `kept`, of black pixels and of white ones.
    pub(super) fn kept(&self, kept: &[Vec<bool>; 2]) -> Self {
        Self::new([0, 1].map(|colour| self.pixels[colour].chosen(|place| kept[colour][place])))
    }
}
