//! Lines that move axes or the extruder.

use super::{Asked, EDGE_MM, Move, Reader, Step, Target};
use crate::gcode::course::Course;
use crate::gcode::decimal::Decimal;
use crate::gcode::extrusion::{Share, in_mm};
use crate::gcode::frame::{ALL, Effects, Mask, Motion, Place, either};
use crate::gcode::known::Known;
use crate::gcode::lexer::Line;
use crate::gcode::options::unit_mm;
use crate::gcode::passage::Passage;
use crate::gcode::plain::PlainMove;
use crate::gcode::report::WarningKind;
use crate::gcode::unsupported::Unsupported;
use crate::gcode::words::{MoveText, Words};

impl Reader {
    /// Notes every reason for which a line with motion words is no straight move.
    pub(super) fn check_motion(&mut self, line: &Line, words: &Words) {
        let (modes, asked) = (&self.modes, &mut self.asked);
        match modes.motion {
            Some(Ok(())) => {}
            Some(Err(Unsupported::Arc { code10 }))
                if words.axes.map(|word| word.is_some()) == [false, false, true] =>
            {
                asked.refuse(Unsupported::Helix { code10 });
            }
            Some(Err(what)) => asked.refuse(what),
            None => asked.refuse(Unsupported::NoMotionCode),
        }
        if let Some(at) = line.unreadable {
            asked.refuse(Unsupported::Unreadable { column: at + 1 });
        }
        if let Some(letter) = words.extra_axis {
            asked.refuse(Unsupported::ExtraAxis { letter });
        }
        if !words.has_placeholder()
            && let Err(what) = words.axes_mm(1.0)
        {
            asked.refuse(what);
        }
        if !words.has_axes() {
            return;
        }
        if let Some(code10) = modes.transformed {
            asked.refuse(Unsupported::Transformed { code10 });
        }
        if let Some(code10) = modes.compensation {
            asked.refuse(Unsupported::CutterCompensation { code10 });
        }
        if modes.is_inverse_time {
            asked.refuse(Unsupported::InverseTime);
        }
        // The machine's own coordinates have no tool length in them.
        if let Some(what) = modes.lost_length
            && !asked.in_machine_coordinates
        {
            asked.refuse(what);
        }
        if asked.in_machine_coordinates && modes.is_relative {
            asked.refuse(Unsupported::MachineIncrement);
        }
        let parameter = words.parameter.filter(|_| !asked.takes_parameters);
        if let Some(letter) = words.odd.or(parameter)
            && modes.motion == Some(Ok(()))
        {
            asked.refuse(Unsupported::OddWord { letter });
        }
        if line.has_checksum && !self.model_is_nominal {
            asked.refuse(if line.has_bare_star { Unsupported::BlockEnd } else { Unsupported::Checksum });
        }
    }

    /// A straight move of the axes or the extruder that [`check_motion`](Self::check_motion) has found nothing against.
    pub(super) fn motion(&mut self, line: &Line, words: &Words, body: &[u8]) -> Step {
        let mut forget = self.asked.forget;
        let words_mm = match words.axes_mm(unit_mm(self.modes.is_inch)) {
            Ok(words_mm) => words_mm,
            Err(_) => {
                // A placeholder: the firmware may refuse the line, or read what it can of it.
                self.warn(WarningKind::Placeholder, body);
                forget = either(forget, words.axes.map(|word| word.is_some()));
                return Step::pass(Effects { forget, ..Effects::default() });
            }
        };
        let extruder = words.extruder.and_then(|word| word.number());
        if self.asked.in_machine_coordinates
            && let Some(left) = self.left_in_machine(&words_mm, body)
        {
            return self.pass_in_machine(words_mm, left, extruder, body);
        }
        self.straight(words_mm, extruder, &MoveText::of(line, words, body, self.modes.is_rapid), forget, body)
    }

    /// Axes of a line with `G53` that are not followed, where there are any: then it passes as it is.
    fn left_in_machine(&mut self, words_mm: &Known, body: &[u8]) -> Option<Mask> {
        if !self.zero_is_told() {
            // Words that were added here, or words of these axes behind it, would count from another zero than is thought.
            self.warn(WarningKind::ZeroNotTold, body);
            return Some(words_mm.mask());
        }
        let left: Mask = std::array::from_fn(|axis| {
            let (low_mm, high_mm) = self.options.range_mm[axis];
            let is_at = |end_mm: f64| (words_mm.numbers()[axis] - end_mm).abs() <= EDGE_MM;
            is_at(low_mm) || is_at(high_mm)
        });
        if !self.modes.is_rapid || left == [false; 3] {
            return None;
        }
        self.warn(WarningKind::EndOfAxis, body);
        Some(left)
    }

    /// Whether it is told where the program's zero is in machine coordinates, or known that nobody knows.
    ///
    /// Printers count from the machine's zero, if nothing else is said.
    pub(super) fn zero_is_told(&self) -> bool {
        let modes = &self.modes;
        modes.system != 0 || modes.is_printers || modes.zero_is_told == ALL
    }

    /// A move in machine coordinates as it is; behind it the axes that are left are somewhere.
    fn pass_in_machine(
        &mut self,
        words_mm: Known,
        left: Mask,
        extruder: Option<Decimal>,
        body: &[u8],
    ) -> Step {
        if let Some(number) = extruder {
            self.extrude(number, body);
        }
        self.summary.moves_in += 1;
        self.summary.moves_out += 1;
        self.summary.untouched_position_unknown += 1;
        let followed_mm: [Option<f64>; 3] =
            std::array::from_fn(|axis| words_mm.get(axis).filter(|_| !left[axis]));
        let place = Place::Move(self.motion_of(followed_mm.into()));
        let effects = Effects { forget: either(self.asked.forget, left), place, ..Effects::default() };
        Step::pass(self.go(effects, Passage::Straight))
    }

    /// Whether a mode holds in which no straight move is corrected.
    pub(super) fn has_trouble(&self) -> bool {
        let modes = &self.modes;
        modes.transformed.is_some()
            || modes.compensation.is_some()
            || modes.lost_length.is_some()
            || modes.is_inverse_time
    }

    /// The line of a plain move; None where the modes make anything else of it, and nothing has happened yet.
    pub(super) fn plain_motion(&mut self, plain: &PlainMove, body: &[u8]) -> Option<Step> {
        let modes = &self.modes;
        let is_straight = plain.is_rapid.is_some() || modes.motion == Some(Ok(()));
        if !is_straight || self.has_trouble() {
            return None;
        }
        let modes = &mut self.modes;
        self.asked = Asked::default();
        if let Some(is_rapid) = plain.is_rapid {
            (modes.motion, modes.is_rapid) = (Some(Ok(())), is_rapid);
        }
        let unit_mm = unit_mm(modes.is_inch);
        if let Some(feed) = plain.feed {
            modes.take_feed(feed);
        }
        let words_mm = Known::all(plain.axes.numbers().map(|word| word * unit_mm));
        Some(self.straight(words_mm, plain.extruder, &plain.text, [false; 3], body))
    }

    /// A straight move of the axes or the extruder; before it, these axes are somewhere.
    #[inline]
    fn straight(
        &mut self,
        words_mm: Known,
        extruder: Option<Decimal>,
        text: &MoveText,
        forget: Mask,
        body: &[u8],
    ) -> Step {
        let (share, extrusion) = extruder.map_or((Share::None, 0), |number| self.extrude(number, body));
        if words_mm.is_none() {
            return Step::pass(Effects { forget, ..Effects::default() });
        }
        let motion = self.motion_of(words_mm);
        self.summary.moves_in += 1;
        if self.is_numbered && has_number_without_point(body) {
            self.warn(WarningKind::NumberWithoutPoint, body);
        }
        let mut before = self.frame;
        before.set_position(forget, &Known::NONE);
        let ends = before.end_of(&motion);
        let course = self.needs.any().then(|| {
            self.past.forget(forget);
            let speed_mm_min = self.speed_mm_min();
            (self.past.straight(&before.position_mm, &ends, speed_mm_min.unwrap_or(0.0)), speed_mm_min)
        });
        let Some(end_mm) = ends.whole() else {
            self.summary.moves_out += 1;
            self.summary.untouched_position_unknown += 1;
            self.warn(WarningKind::PositionUnknown, body);
            return Step::pass(Effects { forget, place: Place::Move(motion), ..Effects::default() });
        };
        // Counted again when the move is written.
        self.summary.extrusion_out -= in_mm(extrusion, self.modes.is_inch);
        if let Some((course, speed_mm_min)) = course {
            self.warn_of_motion(&course, speed_mm_min, body);
            self.courses.push(course);
        }
        self.frame.position_mm = ends;
        let is_first = !self.is_corrected || forget != [false; 3];
        self.targets.push(Target { end_mm, is_first, is_inch: self.modes.is_inch });
        self.moves.push(Move { motion, share, extrusion, text: *text });
        Step::Correct
    }

    /// Speed along the path; None where the program does not tell it.
    fn speed_mm_min(&self) -> Option<f64> {
        let modes = &self.modes;
        // A milling controller's G0 has a speed of its own; the firmwares of printers take the feed.
        let is_told = !modes.is_feed_a_turn && (!modes.is_rapid || self.options.firmware.is_some());
        modes
            .feed_mm_min
            .filter(|_| is_told)
            .zip(modes.feed_override.factor)
            .map(|(feed, factor)| feed * factor)
    }

    /// Says what of the motion the errors depend on is not known.
    fn warn_of_motion(&mut self, course: &Course, speed_mm_min: Option<f64>, body: &[u8]) {
        if (0..3).any(|axis| self.needs.direction[axis] && course.begin.direction[axis] == 0.0) {
            self.warn(WarningKind::DirectionUnknown, body);
        }
        if self.needs.speed {
            let kind =
                if speed_mm_min.is_some() { WarningKind::SpeedFromFeed } else { WarningKind::SpeedUnknown };
            self.warn(kind, body);
        }
    }

    pub(super) fn motion_of(&self, words_mm: Known) -> Motion {
        Motion {
            words_mm,
            is_absolute: !self.modes.is_relative,
            in_machine_coordinates: self.asked.in_machine_coordinates,
            system_mm: self.system_mm(),
        }
    }

    /// Moves the extruder by the line's `E`.
    #[inline(always)]
    pub(super) fn extrude(&mut self, number: Decimal, body: &[u8]) -> (Share, i128) {
        self.modes.is_printers = true;
        let (share, extrusion) = self.extrusion.advance(number);
        if matches!(share, Share::Unclear) && !number.is_cut {
            self.warn(WarningKind::ExtrusionUnclear, body);
        }
        let extrusion_mm = in_mm(extrusion, self.modes.is_inch);
        self.summary.extrusion_in += extrusion_mm;
        self.summary.extrusion_out += extrusion_mm;
        (share, extrusion)
    }

    pub(super) fn system_mm(&self) -> Known {
        self.modes.systems_mm[self.modes.system]
    }
}

/// Whether a place other than 0 is given without a point, before any comment.
fn has_number_without_point(body: &[u8]) -> bool {
    let code = body.split(|&byte| byte == b'(' || byte == b';').next().unwrap_or_default();
    let is_axis = |byte: &u8| matches!(byte.to_ascii_uppercase(), b'X' | b'Y' | b'Z');
    code.iter().enumerate().filter(|(_, byte)| is_axis(byte)).any(|(at, _)| {
        let rest = code[at + 1..].trim_ascii_start();
        let end = rest.iter().position(|byte| !byte.is_ascii_digit() && !b"+-.".contains(byte));
        let number = &rest[..end.unwrap_or(rest.len())];
        !number.contains(&b'.') && number.iter().any(|byte| (b'1'..=b'9').contains(byte))
    })
}
