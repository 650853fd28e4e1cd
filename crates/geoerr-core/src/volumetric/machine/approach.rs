//! How a machine comes to a position: what a move tells formulas beside the position itself.

use crate::expression::decay;

/// Direction, travel and speed with which the axes come to a position.
///
/// | field | variables of formulas |
/// |---|---|
/// | `direction` | `d_x d_y d_z` |
/// | `travel_mm` | `s_x s_y s_z` |
/// | `velocity_mm_s` | `v_x v_y v_z` |
/// | `feed_mm_min` | `feed` |
/// | `left_unwound` | what `windup(lambda)` begins from |
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Approach {
    /// Direction in which each axis last moved, −1 or 1; 0 where it is not known.
    pub direction: [f64; 3],
    /// Travel of each axis since its last reversal.
    pub travel_mm: [f64; 3],
    /// Signed speed of each axis.
    pub velocity_mm_s: [f64; 3],
    /// Feed of the move.
    pub feed_mm_min: f64,
    /// Of each of the machine's wind-ups, what the stroke before the last reversal left unwound, as a share of the lost
    /// motion: 0 behind a long stroke, 1 where the axis has not turned round (it comes from far in its direction).
    pub left_unwound: [f64; MAX_WINDUPS],
}

impl Approach {
    /// The same place, where a way too short to wind anything up has turned an axis: its travel begins anew, and what was
    /// wound up stays.
    #[must_use]
    pub fn turned(mut self, axis: usize, windups: &[Windup]) -> Self {
        for (windup, left) in windups.iter().zip(&mut self.left_unwound) {
            if windup.axis == axis {
                *left = windup.left_by(self.travel_mm[axis], *left);
            }
        }
        self.direction[axis] = -self.direction[axis];
        self.travel_mm[axis] = 0.0;
        self
    }
}

/// Most wind-ups of one machine that are followed from stroke to stroke.
pub const MAX_WINDUPS: usize = 6;

/// A wind-up that depends on the strokes before: its axis, and over what length it fills.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Windup {
    /// Index of the axis.
    pub axis: usize,
    /// e^(−s/length) of a reversal's lost motion is left after the travel s.
    pub length_mm: f64,
}

impl Windup {
    /// What a stroke leaves unwound, of that which the one before it left.
    pub fn left_by(&self, stroke_mm: f64, left_before: f64) -> f64 {
        (1.0 - left_before) * decay(stroke_mm, self.length_mm)
    }
}

/// What of an [`Approach`] a machine's errors depend on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MotionNeeds {
    /// Direction of approach, or travel since the reversal, of each axis.
    pub direction: [bool; 3],
    /// Speeds or feed.
    pub speed: bool,
}

impl MotionNeeds {
    /// Whether the errors depend on how a position is approached.
    pub fn any(&self) -> bool {
        self.speed || self.direction.contains(&true)
    }
}
