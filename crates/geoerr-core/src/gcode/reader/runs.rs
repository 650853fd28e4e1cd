//! Runs of usual moves: read without a look at modes that no such line changes.

use super::{Reader, Target};
use crate::gcode::extrusion::in_mm;
use crate::gcode::usual::{Run, UsualMove};

impl Reader {
    /// A run that may begin here, and where its words count from in x and y; None where anything holds that makes a usual
    /// line more than a move in millimetres from one corrected place to the next.
    pub fn begin_run(&self) -> Option<(Run, [f64; 2])> {
        let modes = &self.modes;
        let is_plain = modes.motion == Some(Ok(()))
            && !modes.is_rapid
            && !modes.is_relative
            && !modes.is_inch
            && !self.has_trouble()
            && !self.is_numbered
            && !self.needs.any()
            && self.is_followed();
        if !is_plain || !self.is_corrected || self.frame.position_mm.whole().is_none() {
            return None;
        }
        let system_mm = self.system_mm();
        let (system, shift) = (system_mm.numbers(), self.frame.shift_mm.numbers());
        let origin_mm = [system[0] + shift[0], system[1] + shift[1]];
        let is_increment = self.extrusion.agreed()?;
        let comments_in_parentheses = self.comments_in_parentheses();
        let is_known = !origin_mm.iter().any(|at_mm| at_mm.is_nan());
        is_known.then_some((Run { n_moves: 0, system_mm, is_increment, comments_in_parentheses }, origin_mm))
    }

    /// Takes over a usual move of a run whose words count from `origin_mm`; false where its line has to be read as any
    /// other, and nothing has happened yet.
    #[inline(always)]
    pub fn take_usual(&mut self, usual: &mut UsualMove, origin_mm: [f64; 2]) -> bool {
        let [x, y] = usual.words;
        let before_mm = self.frame.position_mm;
        let end_mm = [origin_mm[0] + x, origin_mm[1] + y, before_mm.numbers()[2]];
        self.frame.position_mm = end_mm.into();
        if !self.is_inside() {
            self.frame.position_mm = before_mm;
            return false;
        }
        if let Some(number) = usual.extruder {
            self.modes.is_printers = true;
            (_, usual.extrusion) = self.extrusion.advance(number);
            self.summary.extrusion_in += in_mm(usual.extrusion, false);
        }
        self.summary.lines += 1;
        self.summary.moves_in += 1;
        self.targets.push(Target { end_mm, is_first: false, is_inch: false });
        true
    }
}
