//! The inverse of the machine: which command puts the tool where it should be.
//!
//! Li et al. 2023, Eqs. 24 to 27, iterated: one step is the paper's compensation.

use rayon::prelude::*;

use crate::kinematics::{BLOCK_ROWS, MachineModel};

/// A machine that can be asked for its error with derivatives: what Newton's method needs to know.
///
/// Direction of approach and history are those of the move that is asked about; they are held while it is solved.
pub trait ErrorMap {
    /// Actual minus nominal position of the tool point, and the derivative of the actual one by the commanded axes
    /// (row by component, column by axis; at a kink that to the right).
    fn error_and_jacobian(&self, q_mm: &[f64; 3]) -> ([f64; 3], [[f64; 3]; 3]);
}

impl<M: ErrorMap> ErrorMap for &M {
    #[inline]
    fn error_and_jacobian(&self, q_mm: &[f64; 3]) -> ([f64; 3], [[f64; 3]; 3]) {
        (**self).error_and_jacobian(q_mm)
    }
}

impl ErrorMap for MachineModel {
    #[inline]
    fn error_and_jacobian(&self, q_mm: &[f64; 3]) -> ([f64; 3], [[f64; 3]; 3]) {
        Self::error_and_jacobian(self, q_mm, &[0.0; 3])
    }
}

/// A command that puts the tool where it should be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// Axis positions to command.
    pub command_mm: [f64; 3],
    /// Distance of the tool from its target at that command, by the model.
    pub remaining_mm: f64,
    /// Steps taken; 0 where the target itself was good enough.
    pub steps: u32,
}

/// Why there is no command.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum NewtonError {
    /// A tolerance that is not a positive number.
    #[error("a tolerance of {tolerance_mm} mm: it must be a positive number")]
    Tolerance {
        /// The tolerance.
        tolerance_mm: f64,
    },
    /// A target, or the model's answer to it, is NaN or infinite.
    #[error("the target, or the model's error there, is not finite")]
    NonFinite,
    /// The error stays above the tolerance.
    #[error("{remaining_mm} mm remain after {steps} steps")]
    NotConverged {
        /// Best command found.
        command_mm: [f64; 3],
        /// Distance from the target that it leaves.
        remaining_mm: f64,
        /// Steps taken.
        steps: u32,
    },
}

/// How the solve of one row of a batch ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Status {
    /// The remaining error is within the tolerance.
    Converged = 0,
    /// It is not; `remaining_mm` says what is left.
    NotConverged = 1,
    /// The target, or the model's answer to it, is not finite.
    NonFinite = 2,
}

/// Commands for a batch of targets; row i belongs to target i.
#[derive(Debug, Clone, PartialEq)]
pub struct Commands {
    /// Axis positions to command; NaN where there is none.
    pub command_mm: Vec<[f64; 3]>,
    /// Remaining error; of the best command found where the solve did not converge; NaN where nothing is finite.
    pub remaining_mm: Vec<f64>,
    /// How each row ended.
    pub status: Vec<Status>,
}

/// A step that leaves at most half of the error, 50 times: from a metre to less than a picometre.
const MAX_STEPS: u32 = 50;

/// Halvings of a step before the search gives up: to a millionth, below the rounding of any correction.
const MAX_HALVINGS: u32 = 20;

/// The command X* whose actual tool position is the ideal one.
///
/// ```math
/// X^* \leftarrow X - J^{-1}(X)\,\bigl(X + E(X) - x\bigr)
/// ```
///
/// | symbol | code | meaning | unit |
/// |---|---|---|---|
/// | `$x$` | `target_mm` | ideal position of the tool seen from the work, less the machine's tool offset: the axis positions of a machine without errors | mm |
/// | `$X$` | `command_mm` | commanded axis positions | mm |
/// | `$E(X)$` | [`ErrorMap::error_and_jacobian`] | actual minus nominal tool position | mm |
/// | `$J$` | [`ErrorMap::error_and_jacobian`] | derivative of the actual tool position by the commanded axes | - |
///
/// So a machine without errors gives the target back bit for bit, whatever its tool offset.
///
/// Error tables have kinks, and a Newton step computed in one cell is taken into others. With J̄ the mean of the
/// Jacobian along the step it leaves `(J − J̄) J⁻¹` of the error, at most `2L / (1 − L)`, where the error changes by
/// at most L mm/mm: less than a quarter on machines (L < 0.1), so that full steps cannot fail. Where two
/// entries of a table lie almost at one place L is larger; a step that leaves more than half is then shortened.
///
/// # Errors
/// [`NewtonError::Tolerance`]; [`NewtonError::NonFinite`]; [`NewtonError::NotConverged`] with the best
/// command found and what it leaves.
///
/// # Source
/// Li et al. 2023, Eqs. 24 to 27 (one step).
///
/// # Verified by
/// `tests/kinematics/newton.rs`: compensate∘map is the identity to 1 nm on drawn tables, on tables made to hurt, and on a periodic
/// error of 2 mm period and 20 µm amplitude.
pub fn command_for<M: ErrorMap>(
    model: &M,
    target_mm: &[f64; 3],
    tolerance_mm: f64,
) -> Result<Solution, NewtonError> {
    checked_tolerance(tolerance_mm)?;
    let mut here = Trial::at(model, *target_mm, target_mm).ok_or(NewtonError::NonFinite)?;
    for steps in 0..MAX_STEPS {
        if here.remaining_mm <= tolerance_mm {
            return Ok(Solution { command_mm: here.command_mm, remaining_mm: here.remaining_mm, steps });
        }
        match here.better(model, target_mm) {
            Some(next) => here = next,
            None => return Err(here.not_converged(steps)),
        }
    }
    if here.remaining_mm <= tolerance_mm {
        return Ok(Solution {
            command_mm: here.command_mm,
            remaining_mm: here.remaining_mm,
            steps: MAX_STEPS,
        });
    }
    Err(here.not_converged(MAX_STEPS))
}

/// [`command_for`] for each target, in parallel, with the map of its row; the result does not depend on the number of
/// threads.
///
/// A target without a command gets NaN and its [`Status`]; the others are not disturbed.
///
/// # Errors
/// [`NewtonError::Tolerance`].
pub fn commands_by_row<M: ErrorMap>(
    map_of_row: impl Fn(usize) -> M + Sync,
    targets_mm: &[[f64; 3]],
    tolerance_mm: f64,
) -> Result<Commands, NewtonError> {
    checked_tolerance(tolerance_mm)?;
    let rows: Vec<([f64; 3], f64, Status)> = targets_mm
        .par_iter()
        .with_min_len(BLOCK_ROWS)
        .enumerate()
        .map(|(row, target_mm)| match command_for(&map_of_row(row), target_mm, tolerance_mm) {
            Ok(solution) => (solution.command_mm, solution.remaining_mm, Status::Converged),
            Err(NewtonError::NotConverged { remaining_mm, .. }) => {
                ([f64::NAN; 3], remaining_mm, Status::NotConverged)
            }
            Err(NewtonError::NonFinite | NewtonError::Tolerance { .. }) => {
                ([f64::NAN; 3], f64::NAN, Status::NonFinite)
            }
        })
        .collect();
    Ok(Commands {
        command_mm: rows.iter().map(|row| row.0).collect(),
        remaining_mm: rows.iter().map(|row| row.1).collect(),
        status: rows.iter().map(|row| row.2).collect(),
    })
}

/// [`commands_by_row`] with one map for all rows.
///
/// # Errors
/// [`NewtonError::Tolerance`].
pub fn commands_for<M: ErrorMap + Sync>(
    model: &M,
    targets_mm: &[[f64; 3]],
    tolerance_mm: f64,
) -> Result<Commands, NewtonError> {
    commands_by_row(|_| model, targets_mm, tolerance_mm)
}

fn checked_tolerance(tolerance_mm: f64) -> Result<(), NewtonError> {
    if tolerance_mm > 0.0 && tolerance_mm.is_finite() {
        return Ok(());
    }
    Err(NewtonError::Tolerance { tolerance_mm })
}

/// A command on trial.
struct Trial {
    command_mm: [f64; 3],
    /// Actual minus ideal tool position.
    miss_mm: [f64; 3],
    remaining_mm: f64,
    jacobian: [[f64; 3]; 3],
}

impl Trial {
    fn at(model: &impl ErrorMap, command_mm: [f64; 3], target_mm: &[f64; 3]) -> Option<Self> {
        let (error_mm, jacobian) = model.error_and_jacobian(&command_mm);
        let miss_mm: [f64; 3] = std::array::from_fn(|c| (command_mm[c] - target_mm[c]) + error_mm[c]);
        let remaining_mm = miss_mm.iter().map(|c| c * c).sum::<f64>().sqrt();
        remaining_mm.is_finite().then_some(Self { command_mm, miss_mm, remaining_mm, jacobian })
    }

    /// The next command: the longest of the Newton step, its half, its quarter ... that takes away at least half of
    /// what it promises; else the one that leaves least; None where all leave as much as there was.
    fn better(&self, model: &impl ErrorMap, target_mm: &[f64; 3]) -> Option<Self> {
        let step = solve(&self.jacobian, &self.miss_mm)?;
        let mut best: Option<Self> = None;
        let mut share = 1.0;
        for _ in 0..=MAX_HALVINGS {
            let command_mm = std::array::from_fn(|c| self.command_mm[c] - share * step[c]);
            if let Some(trial) = Self::at(model, command_mm, target_mm) {
                if trial.remaining_mm <= (1.0 - 0.5 * share) * self.remaining_mm {
                    return Some(trial);
                }
                let least = best.as_ref().map_or(self.remaining_mm, |best| best.remaining_mm);
                if trial.remaining_mm < least {
                    best = Some(trial);
                }
            }
            share *= 0.5;
        }
        best
    }

    fn not_converged(&self, steps: u32) -> NewtonError {
        NewtonError::NotConverged { command_mm: self.command_mm, remaining_mm: self.remaining_mm, steps }
    }
}

/// `J⁻¹ b` by cofactors: J is close to the identity on every machine that can be compensated.
fn solve(jacobian: &[[f64; 3]; 3], b: &[f64; 3]) -> Option<[f64; 3]> {
    let [r0, r1, r2] = jacobian;
    let cross = |a: &[f64; 3], b: &[f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    // The columns of the inverse are the cross products of the rows, over the determinant.
    let columns = [cross(r1, r2), cross(r2, r0), cross(r0, r1)];
    let determinant = r0[0] * columns[0][0] + r0[1] * columns[0][1] + r0[2] * columns[0][2];
    let solution: [f64; 3] = std::array::from_fn(|c| {
        (columns[0][c] * b[0] + columns[1][c] * b[1] + columns[2][c] * b[2]) / determinant
    });
    solution.iter().all(|x| x.is_finite()).then_some(solution)
}
