//! What the user decides about the rewriting of a program.

use super::error::GcodeError;
use super::extrusion::Firmware;

/// What to do with a line that is not corrected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum OnUnsupported {
    /// Refuse the program.
    #[default]
    Refuse,
    /// Pass the line through untouched, with a warning.
    Pass,
}

/// Everything the rewriting depends on besides the model and the program.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// From the machine's zero to the program's (`G54`). None takes it for the machine's; where the program is no
    /// printer's either (no firmware is named, and it heats no bed and has no extruder), nothing is relied on that is told
    /// in machine coordinates: `G53`, and `home_mm` behind `G28`.
    pub work_offset_mm: Option<[f64; 3]>,
    /// Largest distance of the actual from the ideal path.
    pub tolerance_mm: f64,
    /// Digits behind the point of a printed axis word in millimetres; inches get one more.
    pub digits: u8,
    /// Where `G28` leaves the machine, machine coordinates.
    pub home_mm: Option<[f64; 3]>,
    /// Who runs the program.
    pub firmware: Option<Firmware>,
    /// What to do with a line that is not corrected.
    pub on_unsupported: OnUnsupported,
    /// Hold the last measured values of functions outside the measured range; else such positions are refused.
    pub holds_outside_measured: bool,
    /// Whether the user has said what the firmware corrects.
    pub firmware_corrections_named: bool,
    /// Names of macros and codes, in capitals, of which the user says that they neither move the machine nor change its
    /// modes.
    pub still: Vec<Vec<u8>>,
    /// Range of each axis, (low, high).
    pub range_mm: [(f64, f64); 3],
    /// Range in which the errors of each axis were measured, (low, high); infinite where it has none.
    pub measured_mm: [(f64, f64); 3],
    /// Name of the model in the mark that says the program is corrected.
    pub model_name: String,
}

impl Options {
    /// Options for a machine with these ranges; everything else as the command line has it without options.
    pub fn for_range(range_mm: [(f64, f64); 3]) -> Self {
        Self {
            work_offset_mm: None,
            tolerance_mm: 0.005,
            digits: 4,
            home_mm: None,
            firmware: None,
            on_unsupported: OnUnsupported::Refuse,
            holds_outside_measured: false,
            firmware_corrections_named: false,
            still: Vec::new(),
            range_mm,
            measured_mm: [(f64::NEG_INFINITY, f64::INFINITY); 3],
            model_name: String::new(),
        }
    }

    /// Refuses what makes no sense.
    ///
    /// # Errors
    /// [`GcodeError::Option`].
    pub fn check(&self) -> Result<(), GcodeError> {
        let refuse = |name, value: String, needed| Err(GcodeError::Option { name, value, needed });
        if !(self.tolerance_mm > 0.0 && self.tolerance_mm.is_finite()) {
            return refuse(
                "tolerance",
                self.tolerance_mm.to_string(),
                "a positive number of millimetres is needed",
            );
        }
        if !(1..=9).contains(&self.digits) {
            return refuse("digits", self.digits.to_string(), "1 to 9 digits are possible");
        }
        let numbers = self.work_offset_mm.iter().chain(&self.home_mm).flatten();
        if let Some(number) = numbers.into_iter().find(|number| !number.is_finite()) {
            return refuse("offset", number.to_string(), "millimetres are needed");
        }
        Ok(())
    }

    /// Digits behind the point of a printed axis word.
    pub fn word_digits(&self, is_inch: bool) -> u8 {
        self.digits + u8::from(is_inch)
    }

    /// Half a unit of the last printed digit, mm.
    pub fn half_step_mm(&self, is_inch: bool) -> f64 {
        0.5 * unit_mm(is_inch) / super::decimal::POWERS_F64[usize::from(self.word_digits(is_inch))]
    }
}

/// Millimetres in the program's unit.
pub fn unit_mm(is_inch: bool) -> f64 {
    if is_inch { 25.4 } else { 1.0 }
}
