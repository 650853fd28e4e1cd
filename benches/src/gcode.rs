//! Machines and programs that G-code is measured with.

use std::fmt::Write as _;

use geoerr_core::gcode::{Options, Rewriter};
use geoerr_core::kinematics::{Axis, Chain, Component, ErrorTables, MachineModel, Squareness, Table};

/// Range of every axis.
pub const RANGE_MM: (f64, f64) = (-20.0, 420.0);

/// A printer: `none` has no errors, `square` Li's squareness, everything else also 18 bows with an entry each 10 mm.
pub fn bent(kind: &str) -> MachineModel {
    let mut errors = ErrorTables::default();
    let knots: Vec<f64> = (0..=44).map(|k| RANGE_MM.0 + 10.0 * f64::from(k)).collect();
    for axis in Axis::ALL {
        for component in Component::ALL {
            let size = if component.index() < 3 { 0.2 } else { 1e-3 };
            let phase = (axis.index() * 6 + component.index()) as f64;
            let values = knots.iter().map(|q| size * ((q / 70.0 + phase).sin() - phase.sin())).collect();
            if let (false, Ok(table)) = (matches!(kind, "none" | "square"), Table::new(knots.clone(), values))
            {
                errors.set(axis, component, table);
            }
        }
    }
    let li = Squareness { s_xy_rad: -5.05e-3, s_xz_rad: 1.24e-3, s_yz_rad: 3.84e-3 };
    assert!(kind == "none" || errors.set_squareness(li).is_ok());
    Chain::parse("wZbXYt")
        .map(|chain| MachineModel::new(chain, errors, [0.0; 3]))
        .unwrap_or_else(|error| unreachable!("{error}"))
}

/// Walls of a sliced part: moves of `step_mm`, extrusion, now and then a comment.
pub fn walls(n_moves: u32, step_mm: f64) -> String {
    let mut text = String::from("G21\nG90\nM83\nG28\nG1 X200 Y200 Z.2 F7800\n");
    let radius_mm = 100.0;
    for i in 0..n_moves {
        let turn = f64::from(i) * step_mm / radius_mm;
        let (x, y) = (200.0 + radius_mm * turn.cos(), 200.0 + radius_mm * turn.sin());
        if i % 500 == 0 {
            let _ = write!(text, ";LAYER:{}\nG1 Z{:.2}\n", i / 500, 0.2 + 0.01 * f64::from(i / 500));
        }
        let _ = writeln!(text, "G1 X{x:.3} Y{y:.3} E.06669");
    }
    text
}

/// The program corrected.
pub fn rewrite(machine: &MachineModel, program: &str) -> Vec<u8> {
    let mut out = Vec::new();
    let Ok(mut rewriter) = Rewriter::new(machine.clone(), Options::for_range([RANGE_MM; 3])) else {
        return out;
    };
    for chunk in program.as_bytes().chunks(1 << 20).chain([b"".as_slice()]) {
        rewriter.push(chunk, chunk.is_empty());
        while rewriter.pull(&mut out).unwrap_or_else(|error| unreachable!("{error}")) {}
    }
    out
}

/// How far a machine that runs a rewritten program is from what the program before meant, µm.
#[derive(Debug, Clone, Copy, Default)]
pub struct Closeness {
    /// At the ends of moves.
    pub ends_um: f64,
    /// On the way, at eleven places of each written move.
    pub path_um: f64,
}

/// Runs both programs, of absolute moves in millimetres, `G0` or `G1` alone on their lines; all else is passed over. Every
/// line of the first has to come back as one line or, split, as several.
pub fn closeness(machine: &MachineModel, before: &str, after: &str) -> Closeness {
    let distance = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>().sqrt();
    let actual = |command: &[f64; 3]| -> [f64; 3] {
        let error = machine.error(command, &[0.0; 3]);
        std::array::from_fn(|c| command[c] + error[c])
    };
    let between = |a: &[f64; 3], b: &[f64; 3], share: f64| -> [f64; 3] {
        std::array::from_fn(|c| a[c] + share * (b[c] - a[c]))
    };
    let mut worst = Closeness::default();
    let mut written = positions(after);
    let mut meant = positions(before);
    let (Some(mut from), Some(mut command)) = (meant.next(), written.next()) else { return worst };
    for to in meant {
        // Pieces up to the one that ends nearest to the end.
        let mut path: Vec<[f64; 3]> = Vec::new();
        let length = distance(&from, &to);
        for next in written.by_ref() {
            path.extend((1..=10).map(|tenth| actual(&between(&command, &next, 0.1 * f64::from(tenth)))));
            command = next;
            if distance(&actual(&command), &to) < 1e-3 {
                break;
            }
        }
        worst.ends_um = worst.ends_um.max(1e3 * distance(&actual(&command), &to));
        for place in &path {
            let along = (0..3).map(|c| (place[c] - from[c]) * (to[c] - from[c])).sum::<f64>();
            let share = if length > 0.0 { (along / (length * length)).clamp(0.0, 1.0) } else { 0.0 };
            worst.path_um = worst.path_um.max(1e3 * distance(place, &between(&from, &to, share)));
        }
        from = to;
    }
    worst
}

/// Where the moves of a program end, from the first that follows a whole position on.
fn positions(program: &str) -> impl Iterator<Item = [f64; 3]> {
    let mut at = [f64::NAN; 3];
    program.lines().filter_map(move |line| {
        let words = line.strip_prefix("G1 ").or_else(|| line.strip_prefix("G0 "))?;
        let mut has_axis = false;
        for word in words.split(';').next()?.split_ascii_whitespace() {
            if let (Some(axis), Ok(number)) = ("XYZ".find(&word[..1]), word[1..].parse()) {
                at[axis] = number;
                has_axis = true;
            }
        }
        (has_axis && at.iter().all(|number| number.is_finite())).then_some(at)
    })
}
