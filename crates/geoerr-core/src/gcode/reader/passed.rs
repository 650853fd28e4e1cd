//! Moves that pass as they are: by which way each axis gets to its end.

use super::Reader;
use crate::gcode::frame::{Effects, Motion, Place};
use crate::gcode::known::Known;
use crate::gcode::lexer::Line;
use crate::gcode::options::unit_mm;
use crate::gcode::passage::{Arc, Centre, Passage};
use crate::gcode::unsupported::Unsupported;

impl Reader {
    /// What an untouched move does that gets to its end this way; the axes have gone it.
    pub(super) fn go(&mut self, effects: Effects, passage: Passage) -> Effects {
        if !self.needs.any() {
            return effects;
        }
        let mut before = self.frame;
        before.set_position(effects.forget, &Known::NONE);
        let from_mm = before.position_mm;
        let to_mm = if let Place::Move(motion) = effects.place { before.end_of(&motion) } else { from_mm };
        let passage = passage.between(&from_mm, &to_mm);
        self.past.pass(&passage, &from_mm, &to_mm);
        Effects { passage, ..effects }
    }

    /// The way of a line that ends at its words and is not corrected.
    pub(super) fn passage(&self, line: &Line) -> Passage {
        match self.modes.motion {
            Some(Ok(())) => Passage::Straight,
            Some(Err(Unsupported::Arc { code10 })) => {
                self.arc(line, code10 == 20).map_or(Passage::Unknown, Passage::Arc)
            }
            _ => Passage::Unknown,
        }
    }

    /// None where controllers may read its words differently.
    fn arc(&self, line: &Line, is_clockwise: bool) -> Option<Arc> {
        const LETTERS: &[u8] = b"GMXYZEFSIJKR";
        let modes = &self.modes;
        let unit_mm = unit_mm(modes.is_inch);
        let mut centre_mm = [None; 3];
        let mut radius_mm = None;
        for word in &line.words {
            match word.letter {
                letter @ b'I'..=b'K' => {
                    centre_mm[usize::from(letter - b'I')] = Some(word.number()?.to_f64() * unit_mm);
                }
                b'R' => radius_mm = Some(word.number()?.to_f64() * unit_mm),
                letter if LETTERS.contains(&letter) => {}
                _ => return None,
            }
        }
        let in_plane_mm = modes.plane.map(|axis| centre_mm[axis]);
        let centre = match (in_plane_mm, radius_mm) {
            ([None, None], Some(radius_mm)) => Centre::Radius(radius_mm),
            (_, Some(_)) | ([None, None], None) => return None,
            ([Some(first_mm), Some(second_mm)], None) if modes.has_absolute_centres => {
                let motion = Motion { is_absolute: true, ..self.motion_of(Known::NONE) };
                let origin_mm = self.frame.origin_of(&motion);
                let [first, second] = modes.plane.map(|axis| origin_mm.numbers()[axis]);
                Centre::At([first + first_mm, second + second_mm])
            }
            (_, None) if modes.has_absolute_centres => return None,
            (offset_mm, None) => Centre::FromBegin(offset_mm.map(|offset_mm| offset_mm.unwrap_or(0.0))),
        };
        Some(Arc { plane: modes.plane, is_clockwise, centre, is_whole: false })
    }
}
