//! What happened to a program: counts, the largest correction, and what the user should know.

use super::unsupported::{After, Unsupported};

/// Something that the user should know; the work went on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WarningKind {
    /// A line that is not corrected was passed through.
    Passed(Unsupported),
    /// The program switches a correction of the firmware on.
    FirmwareCorrects,
    /// `G43`: a tool length.
    ToolLength,
    /// `M206`, `SET_GCODE_OFFSET`: the program's zero moves.
    ZeroMoves,
    /// A macro or code that may move the machine.
    MayMove,
    /// A slicer's placeholder that was never filled in.
    Placeholder,
    /// Moves before the position is known.
    PositionUnknown,
    /// `G53`, homing, or another coordinate system, where the program's zero is not told.
    ZeroNotTold,
    /// A rapid in machine coordinates to the end of an axis.
    EndOfAxis,
    /// Errors held beyond their measured range.
    OutsideMeasured,
    /// A move that had to stay whole because of its `E`, or of a code that is meant for its end.
    NotSplit(Unsupported),
    /// Firmwares read an `E` differently.
    ExtrusionUnclear,
    /// Another tool.
    OtherTool,
    /// An axis of which it is not known from where it came.
    DirectionUnknown,
    /// A correction turns an axis that the program does not.
    TurnedAtRest,
    /// Speeds are those of the feed, without ramps.
    SpeedFromFeed,
    /// A speed that the program does not tell.
    SpeedUnknown,
    /// A place without a point, in a program with a number.
    NumberWithoutPoint,
}

impl WarningKind {
    /// A short name, for programs.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Passed(_) => "passed-unsupported",
            Self::FirmwareCorrects => "firmware-corrects",
            Self::ToolLength => "tool-length",
            Self::ZeroMoves => "zero-moves",
            Self::MayMove => "may-move",
            Self::Placeholder => "placeholder",
            Self::PositionUnknown => "position-unknown",
            Self::ZeroNotTold => "zero-not-told",
            Self::EndOfAxis => "end-of-axis",
            Self::OutsideMeasured => "outside-measured",
            Self::NotSplit(_) => "not-split",
            Self::ExtrusionUnclear => "extrusion-unclear",
            Self::OtherTool => "other-tool",
            Self::DirectionUnknown => "direction-unknown",
            Self::TurnedAtRest => "turned-at-rest",
            Self::SpeedFromFeed => "speed-from-feed",
            Self::SpeedUnknown => "speed-unknown",
            Self::NumberWithoutPoint => "number-without-point",
        }
    }

    /// What it means, and what to do where there is something to do.
    pub fn explanation(&self) -> String {
        match self {
            Self::Passed(what @ (Unsupported::Arc { .. } | Unsupported::Helix { .. })) => format!(
                "{what}: passed through untouched; it begins where the corrected move before it ended, which a controller that checks radii may refuse, and one that does not check them jumps to its circle in the last chord"
            ),
            Self::Passed(what) if what.after() == After::EverythingLost => {
                format!("{what}: this line and all that follow are passed through untouched")
            }
            Self::Passed(what) => format!("{what}: passed through untouched"),
            Self::FirmwareCorrects => "the firmware itself corrects here: name what it corrects with --firmware-corrects, or it is corrected twice (a mesh of the bed: bed-mesh, which is EZX and EZY; skew: squareness; steps a millimetre: positioning)".to_owned(),
            Self::ToolLength => "a tool length, which the program does not tell: it has to be part of --work-offset".to_owned(),
            Self::ZeroMoves => "moves the program's zero by the firmware's own offset: a shift that matters has to be part of --work-offset, and moves after it pass through untouched until its axes are given again".to_owned(),
            Self::MayMove => "may move the machine: moves after it pass through untouched until X, Y and Z are all given again; name what does not move it and changes no mode with --still".to_owned(),
            Self::Placeholder => "a placeholder that the slicer did not fill in: passed through untouched".to_owned(),
            Self::PositionUnknown => "the position is not known yet (start, homing, or an untouched line before): moves pass through untouched until X, Y and Z have all been given; --home tells where homing leaves the machine".to_owned(),
            Self::ZeroNotTold => "a place in machine coordinates (G53, G28 with --home, or one of another coordinate system), and where the program's zero lies in them is not told: nothing is counted from it, and moves after it pass through untouched until the axes are given again; --work-offset tells it (0,0,0 where it is the machine's; of a printer that is so: --firmware)".to_owned(),
            Self::EndOfAxis => "a rapid to the end of an axis, where a correction has no travel: passed through untouched, and so are moves after it until that axis is given again".to_owned(),
            Self::OutsideMeasured => "outside the measured range: functions of an axis keep their last measured values, formulas go on".to_owned(),
            Self::NotSplit(what) => format!("{what}: it stays whole, corrected at its end alone, and what play it has to cross is crossed on its way; {}", what.remedy()),
            Self::ExtrusionUnclear => "firmwares read its E differently, as a position or as an increment: the extruded lengths are those of Marlin's reading; --firmware says whose they are to be".to_owned(),
            Self::DirectionUnknown => "an axis has not moved yet since its place became known: what depends on its direction of approach is left out until it has".to_owned(),
            Self::TurnedAtRest => "an axis rests or creeps in the program, and its correction moves it back from where it came: its play is taken up there, by a piece that moves that axis alone".to_owned(),
            Self::SpeedFromFeed => "errors that depend on speed are corrected for the feed as programmed: near corners, where the machine brakes, they are smaller (v_x=0, v_y=0, v_z=0 as conditions leave out what follows a speed)".to_owned(),
            Self::SpeedUnknown => "the speed of this move is not known (no feed yet, a feed per turn, or a rapid whose speed only the controller knows; --firmware says that G0 takes the feed): what depends on it is taken as at rest, a curve at the lowest speed that it was made of".to_owned(),
            Self::NumberWithoutPoint => "a number without a point is read in whole units, X200 as 200 mm; a control that is not set to calculator-type input reads smallest steps, 0.2 mm: let the CAM write points".to_owned(),
            Self::OtherTool => "another tool: the model's tool offset is used for all of them".to_owned(),
        }
    }

    fn is_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Passed(a), Self::Passed(b)) | (Self::NotSplit(a), Self::NotSplit(b)) => {
                std::mem::discriminant(a) == std::mem::discriminant(b)
            }
            _ => std::mem::discriminant(self) == std::mem::discriminant(other),
        }
    }
}

/// A kind of warning, once.
#[derive(Clone, Debug, PartialEq)]
pub struct Warning {
    /// What.
    pub kind: WarningKind,
    /// 1-based line where it was first met.
    pub line: u64,
    /// That line.
    pub text: String,
    /// How often it was met.
    pub count: u64,
}

/// Warnings, one for each kind, in the order in which they were first met.
#[derive(Clone, Debug, Default)]
pub struct Warnings(Vec<Warning>);

impl Warnings {
    /// Counts one more.
    pub fn add(&mut self, kind: WarningKind, line: u64, body: &[u8]) {
        match self.0.iter_mut().find(|warning| warning.kind.is_like(&kind)) {
            Some(warning) => warning.count += 1,
            None => self.0.push(Warning { kind, line, text: excerpt(body), count: 1 }),
        }
    }

    /// All of them.
    pub fn as_slice(&self) -> &[Warning] {
        &self.0
    }
}

/// Commands that may move the machine, in the order in which they were first met, each with how often.
#[derive(Clone, Debug, Default)]
pub struct Movers {
    names: Vec<(String, u64)>,
    /// Lines whose command is none of these.
    others: u64,
}

impl Movers {
    /// More names than this are only counted: memory stays bounded.
    const MOST: usize = 100;

    /// Counts one more.
    pub fn add(&mut self, name: &[u8]) {
        const LONGEST: usize = 60;
        let name = name[..name.len().min(LONGEST)].escape_ascii().to_string();
        if let Some((_, count)) = self.names.iter_mut().find(|(known, _)| *known == name) {
            *count += 1;
        } else if self.names.len() < Self::MOST {
            self.names.push((name, 1));
        } else {
            self.others += 1;
        }
    }

    /// The names, in capitals, and on how many lines each was met.
    pub fn names(&self) -> &[(String, u64)] {
        &self.names
    }

    /// On how many lines others were met.
    pub fn others(&self) -> u64 {
        self.others
    }
}

/// Figures of a whole program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Lines read.
    pub lines: u64,
    /// Moves read: lines that give X, Y or Z to `G0` or `G1`.
    pub moves_in: u64,
    /// Moves written.
    pub moves_out: u64,
    /// Moves whose end was corrected, changed digits or not.
    pub moves_corrected: u64,
    /// Moves untouched because the position was not known.
    pub untouched_position_unknown: u64,
    /// Lines passed through because they are unsupported.
    pub untouched_unsupported: u64,
    /// Lines behind a point from which the program was not followed.
    pub lines_not_followed: u64,
    /// Largest distance of a command from the programmed position, mm.
    pub largest_correction_mm: f64,
    /// Its line, 1-based; 0 where there is none.
    pub largest_correction_line: u64,
    /// Box of the ends of corrected moves, machine coordinates, (low, high); low above high where there are none.
    pub box_mm: [(f64, f64); 3],
    /// Extruded length read, in units of `10^-18` mm.
    pub extrusion_in: i128,
    /// Extruded length written, in units of `10^-18` mm.
    pub extrusion_out: i128,
}

impl Default for Summary {
    fn default() -> Self {
        Self {
            lines: 0,
            moves_in: 0,
            moves_out: 0,
            moves_corrected: 0,
            untouched_position_unknown: 0,
            untouched_unsupported: 0,
            lines_not_followed: 0,
            largest_correction_mm: 0.0,
            largest_correction_line: 0,
            box_mm: [(f64::INFINITY, f64::NEG_INFINITY); 3],
            extrusion_in: 0,
            extrusion_out: 0,
        }
    }
}

impl Summary {
    /// These counts and those of another part of the work.
    pub fn plus(&self, other: &Self) -> Self {
        let largest = if self.largest_correction_mm > other.largest_correction_mm { self } else { other };
        let both = |axis: usize| {
            let ((low, high), (other_low, other_high)) = (self.box_mm[axis], other.box_mm[axis]);
            (low.min(other_low), high.max(other_high))
        };
        Self {
            lines: self.lines + other.lines,
            moves_in: self.moves_in + other.moves_in,
            moves_out: self.moves_out + other.moves_out,
            moves_corrected: self.moves_corrected + other.moves_corrected,
            untouched_position_unknown: self.untouched_position_unknown + other.untouched_position_unknown,
            untouched_unsupported: self.untouched_unsupported + other.untouched_unsupported,
            lines_not_followed: self.lines_not_followed + other.lines_not_followed,
            largest_correction_mm: largest.largest_correction_mm,
            largest_correction_line: largest.largest_correction_line,
            box_mm: std::array::from_fn(both),
            extrusion_in: self.extrusion_in + other.extrusion_in,
            extrusion_out: self.extrusion_out + other.extrusion_out,
        }
    }
}

/// The line as a message shows it: printable, short, between backquotes.
pub fn excerpt(body: &[u8]) -> String {
    const LONGEST: usize = 60;
    let trimmed = body.trim_ascii();
    let shown = &trimmed[..trimmed.len().min(LONGEST)];
    let dots = if trimmed.len() > LONGEST { "..." } else { "" };
    format!("`{}{dots}`", shown.escape_ascii().to_string().replace("\\\"", "\"").replace("\\'", "'"))
}
