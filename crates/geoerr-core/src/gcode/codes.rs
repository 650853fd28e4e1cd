//! G codes by what they mean for a machine's path, and the macros that are known not to move it.

use super::still::is_still_name;
use super::unsupported::Unsupported;

/// Meaning of a G code. Numbers are ten times the code: 92.1 is 921.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Code {
    /// `G0`, `G1`.
    Straight,
    /// A motion code that is not corrected; it holds until the next motion code.
    OtherMotion(Unsupported),
    /// `G70`, `G71` without words of a cycle: inches and millimetres of Siemens' and Heidenhain's controls, or a cycle that
    /// is told elsewhere.
    UnitOrCycle,
    /// `G80`: no motion code holds.
    NoMotion,
    /// `G4`: words are times.
    Dwell,
    /// `G10`: retraction, temperatures, offsets, by its words.
    Settings,
    /// `G28`: the named axes go home.
    Home,
    /// The machine moves by itself: `G29`, `G30`, `G12`, ...
    MovesItself,
    /// `G28.1`, `G30.1`: here is home; nothing moves.
    StorePlace,
    /// `G92`.
    SetShift,
    /// `G52`, `G92.1` to `G92.3`.
    OtherShift,
    /// `G20`, `G21`; `G700`, `G710` of Siemens' controls.
    Unit {
        /// Inches.
        is_inch: bool,
    },
    /// `G90`, `G91`.
    Distance {
        /// Words are increments.
        is_relative: bool,
    },
    /// `G53`.
    MachineCoordinates,
    /// `G54` to `G59`: 0 to 5.
    System(usize),
    /// `G59.1` to `G59.3`, `G54.1 P..` (Fanuc), `G154 P..` and `G114` to `G129` (Haas), `G500`, `G505` to `G599` (Siemens).
    FurtherSystem,
    /// `G40`.
    CompensationOff,
    /// `G41`, `G42`.
    CompensationOn,
    /// `G43`.
    ToolLength,
    /// `G49`.
    ToolLengthOff,
    /// `G43.1`, `G43.4` ...
    ToolPoint,
    /// `G93`.
    InverseTime,
    /// `G94`, `G95`.
    FeedRate,
    /// `G7`, `G12.1` and `G112` (polar), `G16`, `G51`, `G68`, `G254` (Haas' rotary offsets).
    TransformOn,
    /// `G8`, `G13.1`, `G15`, `G50`, `G69`, `G113`, `G255`.
    TransformOff,
    /// Other axis words from now on: cylinders (`G7.1`, `G107`), poles (`G110`, `G111`).
    OtherMeaning,
    /// `G60`: Marlin remembers the place, to which `G61` then goes.
    SavePlace,
    /// `G61`: exact path, or back to the saved place.
    ExactOrRestore,
    /// `G17` to `G19`: axes of the plane of arcs; from the first to the second they turn counter-clockwise.
    Plane([usize; 2]),
    /// `G90.1`, `G91.1`.
    ArcCentre {
        /// I, J and K are a place, not counted from the begin of the arc.
        is_absolute: bool,
    },
    /// Says nothing about the path.
    Harmless,
    /// Not known to geoerr.
    Unknown,
}

impl Code {
    /// The meaning of a code, given as ten times its number.
    pub fn of(code10: u32) -> Self {
        use Unsupported as U;
        match code10 {
            0 | 10 => Self::Straight,
            20 | 30 => Self::OtherMotion(U::Arc { code10 }),
            21..=29 | 31..=39 | 50..=53 | 60 => Self::OtherMotion(U::Spline { code10 }),
            330..=339 => Self::OtherMotion(U::Thread { code10 }),
            380..=389 => Self::OtherMotion(U::Probing { code10 }),
            700..=799 | 810..=899 => Self::OtherMotion(U::CannedCycle { code10 }),
            800 => Self::NoMotion,
            40 => Self::Dwell,
            100 => Self::Settings,
            280 => Self::Home,
            281 | 301 => Self::StorePlace,
            120 | 122..=129 | 260..=279 | 290..=300 | 320 | 340..=359 | 4250 => Self::MovesItself,
            920 => Self::SetShift,
            520 | 921..=923 => Self::OtherShift,
            200 | 210 | 7000 | 7100 => Self::Unit { is_inch: matches!(code10, 200 | 7000) },
            900 | 910 => Self::Distance { is_relative: code10 == 910 },
            530 => Self::MachineCoordinates,
            540 | 550 | 560 | 570 | 580 | 590 => Self::System((code10 as usize - 540) / 10),
            541..=549 | 591..=593 | 1140..=1290 | 1540 | 5000 | 5050..=5990 => Self::FurtherSystem,
            400 => Self::CompensationOff,
            410..=429 => Self::CompensationOn,
            430 => Self::ToolLength,
            431..=449 | 2340 => Self::ToolPoint,
            490 => Self::ToolLengthOff,
            930 => Self::InverseTime,
            940 | 950 => Self::FeedRate,
            70 | 121 | 160 | 510..=519 | 680..=689 | 1120 | 2540 => Self::TransformOn,
            71 | 1070 | 1100 | 1110 => Self::OtherMeaning,
            80 | 131 | 150 | 500 | 501 | 690 | 1130 | 2550 => Self::TransformOff,
            600 => Self::SavePlace,
            610 => Self::ExactOrRestore,
            170 => Self::Plane([0, 1]),
            180 => Self::Plane([2, 0]),
            190 => Self::Plane([1, 2]),
            901 | 911 => Self::ArcCentre { is_absolute: code10 == 901 },
            // G9, G11, G22, G23, G61.1, G64, G96 to G99
            90 | 110 | 220 | 230 | 611 | 640 | 960..=999 => Self::Harmless,
            _ => Self::Unknown,
        }
    }
}

/// What a macro (a command with a name of several letters) does to the path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Macro {
    /// Nothing, by Klipper's or RepRapFirmware's manual.
    Harmless,
    /// Switches a correction of the firmware on or off; does not move.
    FirmwareCorrection,
    /// Measures the bed: moves, and corrects from then on.
    MeasuresBed,
    /// Moves the program's zero.
    MovesZero,
    /// `if`, `while` ...: which line comes next.
    FlowControl,
    /// `TRANS`, `ROT` ...: other axis words from now on.
    Transforms,
    /// `SAVE_GCODE_STATE`: keeps modes and zeros under a name.
    SavesState,
    /// `RESTORE_GCODE_STATE`: takes them up again.
    RestoresState,
    /// `ACTIVATE_EXTRUDER`: another extruder, whose position counts anew.
    OtherExtruder,
    /// Anything: the machine may be elsewhere afterwards.
    Unknown,
}

/// Words of RepRapFirmware (`if`, `while`), of Fanuc's macros (`IF[..]GOTO`, `DO1`, `END1`) and of Siemens' controls
/// (`GOTOF`, `REPEAT`, `EXTCALL`) that say which line comes next.
fn is_branch(name: &[u8]) -> bool {
    let name = name.to_ascii_lowercase();
    let words: [&[u8]; 21] = [
        b"if",
        b"elif",
        b"else",
        b"while",
        b"break",
        b"continue",
        b"abort",
        b"goto",
        b"then",
        b"gotob",
        b"gotoc",
        b"gotof",
        b"gotos",
        b"for",
        b"loop",
        b"repeat",
        b"repeatb",
        b"until",
        b"case",
        b"call",
        b"extcall",
    ];
    let is_numbered = |begin: &[u8]| {
        name.strip_prefix(begin).is_some_and(|rest| !rest.is_empty() && rest.iter().all(u8::is_ascii_digit))
    };
    words.contains(&name.as_slice()) || [b"goto".as_slice(), b"do", b"end"].into_iter().any(is_numbered)
}

/// Frames and transformations of Siemens' controls, and paths of theirs that are no straight lines, in capitals; `A` before
/// a frame's name adds to the one that holds.
fn is_transformation(name: &[u8]) -> bool {
    const FRAMES: [&[u8]; 5] = [b"TRANS", b"ROT", b"ROTS", b"SCALE", b"MIRROR"];
    const OTHERS: [&[u8]; 19] = [
        b"ASPLINE",
        b"BSPLINE",
        b"CIP",
        b"CROTS",
        b"CSPLINE",
        b"CT",
        b"CYCLE800",
        b"INVCCW",
        b"INVCW",
        b"MCALL",
        b"POLY",
        b"TRAANG",
        b"TRACYL",
        b"TRAFOOF",
        b"TRAFOON",
        b"TRANSMIT",
        b"TRAORI",
        b"TOFRAME",
        b"TOROT",
    ];
    FRAMES.contains(&name)
        || name.strip_prefix(b"A").is_some_and(|rest| FRAMES.contains(&rest))
        // Okuma's zeros and lengths of tools: `VZOFX[1]=50`.
        || [&b"VZOF"[..], b"VTOF"].iter().any(|begin| name.starts_with(begin))
        || OTHERS.contains(&name)
}

/// Whether a line that begins with `$` sets a frame (`$P_UIFR[1,X,TR]=50`: where `G54` is) or the data of a tool
/// (`$TC_DP3[1,1]=80`: its length), as Siemens' controls have them.
pub fn sets_frame_or_tool(body: &[u8]) -> bool {
    let name: Vec<u8> = body
        .iter()
        .skip(1)
        .take_while(|byte| byte.is_ascii_alphanumeric() || **byte == b'_')
        .map(u8::to_ascii_uppercase)
        .collect();
    let has_frame = name.starts_with(b"P_") && name.windows(2).any(|pair| pair == b"FR");
    has_frame || name.starts_with(b"TC_")
}

impl Macro {
    /// An instruction of the controls of Beckhoff (ISG) and Fagor by its name behind `#`: `#CS ON` turns and moves the
    /// program's zero, `#MCS ON` counts from the machine's. What changes none of this is taken for a comment.
    ///
    /// `#Face mill 50` is one, too: what is a word of its own is none of them without `ON`, `OFF` or numbers behind it.
    pub fn of_instruction(name: &[u8], behind: &[u8]) -> Self {
        const TRANSFORMATIONS: [&[u8]; 11] =
            [b"ACS", b"AKIMA", b"CS", b"ECS", b"MCS", b"PRESET", b"PSET", b"RTCP", b"TLC", b"TRAFO", b"WCS"];
        const WORDS: [&[u8]; 5] = [b"CYL", b"FACE", b"KIN", b"ROTATION", b"SPLINE"];
        let behind = behind.trim_ascii_start().to_ascii_uppercase();
        let is_told = [&b"ON"[..], b"OFF", b"["].iter().any(|told| behind.starts_with(told));
        let name = name.to_ascii_uppercase();
        match name.as_slice() {
            b"VOLCOMP" => Self::FirmwareCorrection,
            b"CALL" | b"MCALL" | b"PCALL" => Self::FlowControl,
            other if TRANSFORMATIONS.contains(&other) || (is_told && WORDS.contains(&other)) => {
                Self::Transforms
            }
            _ => Self::Harmless,
        }
    }

    /// By its name.
    pub fn of(name: &[u8]) -> Self {
        if is_branch(name) {
            return Self::FlowControl;
        }
        if [b"var".as_slice(), b"global", b"set", b"echo"].contains(&name) {
            return Self::Harmless;
        }
        let name = name.to_ascii_uppercase();
        match name.as_slice() {
            _ if is_still_name(&name) => Self::Harmless,
            b"SET_SKEW"
            | b"SKEW_PROFILE"
            | b"BED_MESH_PROFILE"
            | b"BED_MESH_OFFSET"
            | b"SET_Z_THERMAL_ADJUST" => Self::FirmwareCorrection,
            _ if name.starts_with(b"BED_MESH_") => Self::MeasuresBed,
            b"SET_GCODE_OFFSET" => Self::MovesZero,
            _ if is_transformation(&name) => Self::Transforms,
            b"SAVE_GCODE_STATE" => Self::SavesState,
            b"RESTORE_GCODE_STATE" => Self::RestoresState,
            b"ACTIVATE_EXTRUDER" => Self::OtherExtruder,
            _ => Self::Unknown,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_with_and_without_a_digit_are_told_apart() {
        assert_eq!(Code::of(52), Code::OtherMotion(Unsupported::Spline { code10: 52 }), "G5.2");
        assert_eq!(Code::of(520), Code::OtherShift, "G52");
        assert_eq!(Code::of(590), Code::System(5));
        assert_eq!(Code::of(591), Code::FurtherSystem);
        assert_eq!(Code::of(541), Code::FurtherSystem, "G54.1");
        assert_eq!(Code::of(1540), Code::FurtherSystem, "G154");
        assert_eq!(Code::of(611), Code::Harmless);
        assert_eq!(Code::of(7000), Code::Unit { is_inch: true }, "G700, not G70");
        assert_eq!(Code::of(121), Code::TransformOn, "G12.1");
        assert_eq!(Code::of(120), Code::MovesItself, "G12");
        assert_eq!(Code::of(5050), Code::FurtherSystem, "G505");
        assert_eq!(Code::of(1150), Code::FurtherSystem, "G115 of Haas' controls");
        assert_eq!(Code::of(9999), Code::Unknown);
    }

    #[test]
    fn macros() {
        assert_eq!(Macro::of(b"SET_PRINT_STATS_INFO"), Macro::Harmless);
        assert_eq!(Macro::of(b"set_gcode_offset"), Macro::MovesZero);
        for name in
            [b"SET_POSITION".as_slice(), b"SET_HOME", b"SET_UP_PRINT", b"QUERY_PARK", b"SET_DUAL_CARRIAGE"]
        {
            assert_eq!(Macro::of(name), Macro::Unknown, "{}", String::from_utf8_lossy(name));
        }
        assert_eq!(Macro::of(b"BED_MESH_CLEAR"), Macro::Harmless);
        assert_eq!(Macro::of(b"BED_MESH_CALIBRATE"), Macro::MeasuresBed);
        assert_eq!(Macro::of(b"START_PRINT"), Macro::Unknown);
        assert_eq!(Macro::of(b"while"), Macro::FlowControl);
        assert_eq!(Macro::of(b"IF"), Macro::FlowControl);
        assert_eq!(Macro::of(b"GOTO50"), Macro::FlowControl);
        assert_eq!(Macro::of(b"END1"), Macro::FlowControl);
        assert_eq!(Macro::of(b"END_PRINT"), Macro::Unknown);
        assert_eq!(Macro::of(b"GOTOF"), Macro::FlowControl);
        assert_eq!(Macro::of(b"BSPLINE"), Macro::Transforms);
        assert_eq!(Macro::of(b"FORCE_MOVE"), Macro::Unknown);
        assert_eq!(Macro::of(b"restore_gcode_state"), Macro::RestoresState);
        for name in [b"TRANS".as_slice(), b"atrans", b"ROT", b"AMIRROR", b"CYCLE800", b"MCALL"] {
            assert_eq!(Macro::of(name), Macro::Transforms, "{}", String::from_utf8_lossy(name));
        }
        assert_eq!(Macro::of(b"ROTATE_BED"), Macro::Unknown);
    }
}
