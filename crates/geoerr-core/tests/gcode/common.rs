//! Machines and short ways to run a program.

use geoerr_core::gcode::{GcodeError, OnUnsupported, Options, Rewriter, Summary, Warning};
use geoerr_core::kinematics::{Axis, Chain, Component, ErrorTables, MachineModel, Squareness, Table};

/// Range of every axis of the test machines.
pub const RANGE_MM: (f64, f64) = (-20.0, 420.0);

/// What came out of a program.
#[derive(Debug, PartialEq)]
pub struct Outcome {
    pub bytes: Vec<u8>,
    pub summary: Summary,
    pub warnings: Vec<Warning>,
    pub movers: Vec<(String, u64)>,
}

impl Outcome {
    pub fn text(&self) -> &str {
        std::str::from_utf8(&self.bytes).unwrap()
    }

    /// The lines without the mark.
    pub fn lines(&self) -> Vec<&str> {
        self.text().lines().filter(|line| !line.contains("corrected by geoerr")).collect()
    }

    pub fn warning_names(&self) -> Vec<&str> {
        self.warnings.iter().map(|warning| warning.kind.name()).collect()
    }
}

pub fn options() -> Options {
    Options { model_name: "0123456789ab".to_owned(), ..Options::for_range([RANGE_MM; 3]) }
}

pub fn passing() -> Options {
    Options { on_unsupported: OnUnsupported::Pass, ..options() }
}

/// A machine without errors.
pub fn nominal() -> MachineModel {
    MachineModel::new(Chain::parse("wZbXYt").unwrap(), ErrorTables::default(), [0.0, 5.0, -30.0])
}

/// X runs 1 mm/m long, Y 2 mm/m short: every correction can be done in the head.
pub fn scaled() -> MachineModel {
    let mut errors = ErrorTables::default();
    let (low, high) = RANGE_MM;
    let line = |slope: f64| Table::new(vec![low, high], vec![slope * low, slope * high]).unwrap();
    errors.set(Axis::X, Component::X, line(1e-3));
    errors.set(Axis::Y, Component::Y, line(-2e-3));
    MachineModel::new(Chain::parse("wbXYZt").unwrap(), errors, [0.0; 3])
}

/// Squareness alone: X leans with Y and Z, Y with Z.
pub fn skewed() -> MachineModel {
    let mut errors = ErrorTables::default();
    errors.set_squareness(Squareness { s_xy_rad: -5e-3, s_xz_rad: 1e-3, s_yz_rad: 4e-3 }).unwrap();
    MachineModel::new(Chain::parse("wZbXYt").unwrap(), errors, [0.0; 3])
}

/// All 21 errors: 5 mrad of squareness, bows and sines of up to a millimetre and two milliradians, a knot each 10 mm,
/// as on Li's printer (Figs. 11 to 13).
pub fn bent(chain: &str, tool_offset_mm: [f64; 3]) -> MachineModel {
    let mut errors = ErrorTables::default();
    let (low, high) = RANGE_MM;
    let positions: Vec<f64> = (0..=44).map(|i| low + 10.0 * f64::from(i)).collect();
    for (a, axis) in Axis::ALL.into_iter().enumerate() {
        for (c, component) in Component::ALL.into_iter().enumerate() {
            let amplitude = if c < 3 { 0.5 } else { 1.0e-3 };
            let periods = 0.5 + 0.7 * (a * 6 + c) as f64 / 4.0;
            let values = positions
                .iter()
                .map(|q| {
                    let u = (q - low) / (high - low);
                    amplitude * ((u * periods * std::f64::consts::TAU).sin() + 4.0 * u * (1.0 - u))
                })
                .collect();
            errors.set(axis, component, Table::new(positions.clone(), values).unwrap());
        }
    }
    errors.set_squareness(Squareness { s_xy_rad: -5.05e-3, s_xz_rad: 1.24e-3, s_yz_rad: 3.84e-3 }).unwrap();
    MachineModel::new(Chain::parse(chain).unwrap(), errors, tool_offset_mm)
}

pub fn run_bytes(machine: MachineModel, options: Options, chunks: &[&[u8]]) -> Result<Outcome, GcodeError> {
    let mut rewriter = Rewriter::new(machine, options)?;
    let mut bytes = Vec::new();
    for chunk in chunks {
        rewriter.push(chunk, false);
        while rewriter.pull(&mut bytes)? {}
    }
    rewriter.push(b"", true);
    while rewriter.pull(&mut bytes)? {}
    let movers = rewriter.movers().names().to_vec();
    Ok(Outcome { bytes, summary: rewriter.summary(), warnings: rewriter.warnings(), movers })
}

pub fn run(machine: MachineModel, options: Options, program: &str) -> Result<Outcome, GcodeError> {
    run_bytes(machine, options, &[program.as_bytes()])
}

/// The lines that come out, without the mark.
pub fn rewritten(machine: MachineModel, options: Options, program: &str) -> Vec<String> {
    let outcome = run(machine, options, program).unwrap();
    outcome.lines().into_iter().map(str::to_owned).collect()
}
