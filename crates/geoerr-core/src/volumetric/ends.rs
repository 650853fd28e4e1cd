//! Measured lengths: two rows, one for each end, and the direction from one to the other.
//!
//! The distance between two places does not depend on where a part lies. A row of an end tells how far it is from the
//! middle, along the length; what both have in common, the middle itself, is for a shared unknown to take:
//!
//! ```math
//! r_{1,2} = \mp\tfrac12\,(L - |p_2 - p_1|) - \mathbf u\cdot(\mathbf m - \mathbf m_0) - s, \qquad
//! \mathbf m = \tfrac12(\mathbf p_1 + \mathbf p_2)
//! ```
//!
//! | symbol | code | meaning |
//! |---|---|---|
//! | `$L$` | `measured_mm` | what was measured, in both rows |
//! | `$\mathbf u$` | `along` | from the first end to the second, of a machine without errors |
//! | `$\mathbf m_0$` | `middle_mm` | the middle, of a machine without errors |
//! | `$s$` | shared unknown | where the middle lies |

use super::problem::Sightings;
use super::term::VolumetricModel;
use super::{VolumetricError, block::distance};

/// An end of a measured length.
#[derive(Debug, Clone, Copy)]
pub(super) struct End {
    /// Row of the other end.
    pub(super) other: usize,
    /// −1 of the first end, +1 of the second.
    pub(super) side: f64,
    /// From the first end to the second, of length 1.
    pub(super) along: [f64; 3],
    /// Middle of both.
    pub(super) middle_mm: [f64; 3],
}

/// The ends among rows, each where it stands; empty where there are none.
pub(super) fn ends_of(
    model: &VolumetricModel,
    sightings: &Sightings,
) -> Result<Vec<Option<End>>, VolumetricError> {
    let Sightings { rows, length, .. } = sightings;
    if length.iter().all(Option::is_none) {
        return Ok(Vec::new());
    }
    let nominal = |row: usize| {
        let (carrier, q_mm, offset_mm) = (rows.carriers[row], &rows.q_mm[row], &rows.offset_mm[row]);
        model.chain().nominal(carrier, q_mm, offset_mm, model.tool_offset_mm())
    };
    let mut ends = vec![None; length.len()];
    let mut of_length: Vec<(usize, usize)> =
        length.iter().enumerate().filter_map(|(row, &number)| number.map(|number| (number, row))).collect();
    of_length.sort_unstable();
    for both in of_length.chunk_by(|one, other| one.0 == other.0) {
        let &[(_, first), (_, second)] = both else {
            return Err(VolumetricError::Ends { row: both[0].1, n_ends: both.len() });
        };
        let (from, to) = (nominal(first), nominal(second));
        let extent_mm = distance(&from, &to);
        if extent_mm <= 0.0 || extent_mm.is_nan() {
            return Err(VolumetricError::NoExtent { row: first });
        }
        let along = std::array::from_fn(|c| (to[c] - from[c]) / extent_mm);
        let middle_mm = std::array::from_fn(|c| 0.5 * (from[c] + to[c]));
        ends[first] = Some(End { other: second, side: -1.0, along, middle_mm });
        ends[second] = Some(End { other: first, side: 1.0, along, middle_mm });
    }
    Ok(ends)
}

impl End {
    /// What was measured less where an end and the other one lie, along the length.
    pub(super) fn residual(&self, measured_mm: f64, here: &[f64; 3], there: &[f64; 3]) -> f64 {
        let off_middle: f64 =
            (0..3).map(|c| self.along[c] * (0.5 * (here[c] + there[c]) - self.middle_mm[c])).sum();
        0.5 * self.side * (measured_mm - distance(here, there)) - off_middle
    }
}
