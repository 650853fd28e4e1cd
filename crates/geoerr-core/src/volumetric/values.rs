//! What every channel gets at every row: the sum of the parts that act on it.

use rayon::prelude::*;

use super::shared_bases::SharedBases;
use super::term::{Shape, VolumetricModel};
use super::{Rows, VolumetricError};
use crate::kinematics::{Channel, Displacements};

/// Rows that a thread takes at a time.
const BLOCK_ROWS: usize = 1024;

/// Values of the used channels, channel by channel, each as long as the rows.
#[derive(Debug, Clone, Default)]
pub struct ChannelValues {
    channels: Vec<Channel>,
    values: Vec<Vec<f64>>,
}

impl ChannelValues {
    /// The value on every channel at a row, in the order of [`Channel::index`].
    #[inline]
    pub fn at(&self, row: usize) -> [f64; Channel::ALL.len()] {
        let mut all = [0.0; Channel::ALL.len()];
        for (channel, values) in self.channels.iter().zip(&self.values) {
            all[channel.index()] = values[row];
        }
        all
    }

    /// The channels on which something acts, with their values at all rows.
    pub fn iter(&self) -> impl Iterator<Item = (Channel, &[f64])> {
        self.channels.iter().copied().zip(self.values.iter().map(Vec::as_slice))
    }
}

/// Sums all parts on their channels.
///
/// # Errors
/// [`VolumetricError::Length`] where coefficients, inner parameters or variables do not fit the model.
pub fn channel_values(
    model: &VolumetricModel,
    rows: &Rows,
    coefficients: &[f64],
    inner: &[f64],
) -> Result<ChannelValues, VolumetricError> {
    let shared = SharedBases::of(model.parts().map(|(_, part)| part));
    channel_values_of_bases(model, &shared, rows, coefficients, inner)
}

/// The same with the model's bases, of which the functions at all rows may be known.
pub(super) fn channel_values_of_bases(
    model: &VolumetricModel,
    shared: &SharedBases,
    rows: &Rows,
    coefficients: &[f64],
    inner: &[f64],
) -> Result<ChannelValues, VolumetricError> {
    rows.check()?;
    check_parameters(model, coefficients, inner)?;
    let views = rows.variable_views();
    let expression_rows = rows.expression_rows(&views);
    let channels = model.channels().to_vec();
    let parts: Vec<_> = model.parts().collect();
    let values = sums_of_bases(model, shared, rows, coefficients);
    let values = values
        .into_par_iter()
        .zip(&channels)
        .map(|(mut sum, channel)| {
            let mut scratch = Vec::new();
            for (term, part) in parts.iter().filter(|(_, part)| part.channel == *channel) {
                let Shape::Expression { expression, coefficients: places, inner: inner_places } = &part.shape
                else {
                    continue;
                };
                let own = &coefficients[model.first_coefficient(*term)..];
                let theta: Vec<f64> = places.iter().map(|&place| own[place]).collect();
                let first_inner = model.first_inner(*term);
                let phi: Vec<f64> = inner_places.iter().map(|&p| inner[first_inner + p]).collect();
                scratch.clear();
                scratch.resize(rows.len(), 0.0);
                expression.evaluate(&expression_rows, 0..rows.len(), &theta, &phi, &mut scratch)?;
                for (total, value) in sum.iter_mut().zip(&scratch) {
                    *total += part.factor * value;
                }
            }
            Ok(sum)
        })
        .collect::<Result<Vec<_>, VolumetricError>>()?;
    Ok(ChannelValues { channels, values })
}

/// What the parts that are bases give to every channel, at all rows.
fn sums_of_bases(
    model: &VolumetricModel,
    shared: &SharedBases,
    rows: &Rows,
    coefficients: &[f64],
) -> Vec<Vec<f64>> {
    let mut values = vec![vec![0.0; rows.len()]; model.channels().len()];
    // In place: of many rows a second copy would be the largest thing that a fit holds.
    let mut blocks: Vec<Vec<&mut [f64]>> = Vec::new();
    blocks.resize_with(rows.len().div_ceil(BLOCK_ROWS), Vec::new);
    for channel in &mut values {
        for (block, sums) in blocks.iter_mut().zip(channel.chunks_mut(BLOCK_ROWS)) {
            block.push(sums);
        }
    }
    blocks.into_par_iter().enumerate().for_each(|(number, mut sums)| {
        let first_row = number * BLOCK_ROWS;
        let places: Vec<usize> = (first_row..rows.len().min(first_row + BLOCK_ROWS)).collect();
        let at_rows = shared.at_rows(&places, &rows.q_mm);
        for (number, (term, part)) in model.parts().enumerate() {
            let is_own = |channel: &Channel| *channel == part.channel;
            let (Shape::Basis { .. }, Some(place)) = (&part.shape, model.channels().iter().position(is_own))
            else {
                continue;
            };
            let (basis, own) = (shared.of_part(number), &coefficients[model.first_coefficient(term)..]);
            for (at, (total, &row)) in sums[place].iter_mut().zip(&places).enumerate() {
                let (first, functions) = at_rows.of(basis, row, at);
                let value: f64 = functions.iter().zip(&own[first..]).map(|(f, c)| f * c).sum();
                *total += part.factor * value;
            }
        }
    });
    values
}

/// Displacement of every row's point, actual minus nominal, by the exact chain and without the rig, mm.
///
/// # Errors
/// As [`channel_values`].
pub fn displacements(
    model: &VolumetricModel,
    rows: &Rows,
    coefficients: &[f64],
    inner: &[f64],
) -> Result<Vec<[f64; 3]>, VolumetricError> {
    let values = channel_values(model, rows, coefficients, inner)?;
    let (chain, tool) = (model.chain(), model.tool_offset_mm());
    let block = |first: usize| {
        let last = rows.len().min(first + BLOCK_ROWS);
        (first..last)
            .map(|row| {
                let mut numbers = [0.0; Channel::MACHINE_COUNT];
                numbers.copy_from_slice(&values.at(row)[..Channel::MACHINE_COUNT]);
                let displacements = Displacements::from_channels(&numbers);
                chain.displacement(
                    rows.carriers[row],
                    &rows.q_mm[row],
                    &rows.offset_mm[row],
                    tool,
                    &displacements,
                )
            })
            .collect::<Vec<_>>()
    };
    let blocks: Vec<Vec<[f64; 3]>> = (0..rows.len()).into_par_iter().step_by(BLOCK_ROWS).map(block).collect();
    Ok(blocks.concat())
}

pub(super) fn check_parameters(
    model: &VolumetricModel,
    coefficients: &[f64],
    inner: &[f64],
) -> Result<(), VolumetricError> {
    let same = |what, found, needed| {
        if found == needed { Ok(()) } else { Err(VolumetricError::Length { what, found, needed }) }
    };
    same("coefficients", coefficients.len(), model.n_coefficients())?;
    same("inner", inner.len(), model.n_inner())
}
