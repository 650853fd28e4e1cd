//! How a machine comes to a position: what a move tells formulas beside the position itself.

/// Direction, travel and speed with which the axes come to a position.
///
/// | field | variables of formulas |
/// |---|---|
/// | `direction` | `d_x d_y d_z` |
/// | `travel_mm` | `s_x s_y s_z` |
/// | `velocity_mm_s` | `v_x v_y v_z` |
/// | `feed_mm_min` | `feed` |
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
