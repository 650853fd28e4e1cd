//! Commands of printers that leave the machine where it is, and its modes as they are: by Klipper's manual (G-Codes), and
//! by those of Marlin, RepRapFirmware, Prusa and Bambu. Others may be a user's macros, which do anything.

/// Klipper's own commands, in order. Of `SET_...` not all are its own.
const NAMES: [&[u8]; 69] = [
    b"ACCELEROMETER_DEBUG_READ",
    b"ACCELEROMETER_DEBUG_WRITE",
    b"ACCELEROMETER_MEASURE",
    b"ACCELEROMETER_QUERY",
    b"ANGLE_CHIP_CALIBRATE",
    b"ANGLE_DEBUG_READ",
    b"ANGLE_DEBUG_WRITE",
    b"BED_MESH_CLEAR",
    b"BED_MESH_MAP",
    b"BED_MESH_OUTPUT",
    b"CALC_MEASURED_SKEW",
    b"CLEAR_PAUSE",
    b"DISABLE_FILAMENT_WIDTH_LOG",
    b"DISABLE_FILAMENT_WIDTH_SENSOR",
    b"DUMP_TMC",
    b"ENABLE_FILAMENT_WIDTH_LOG",
    b"ENABLE_FILAMENT_WIDTH_SENSOR",
    b"EXCLUDE_OBJECT",
    b"EXCLUDE_OBJECT_DEFINE",
    b"EXCLUDE_OBJECT_END",
    b"EXCLUDE_OBJECT_START",
    b"GET_CURRENT_SKEW",
    b"GET_POSITION",
    b"GET_RETRACTION",
    b"HELP",
    b"INIT_TMC",
    b"MEASURE_AXES_NOISE",
    b"PID_CALIBRATE",
    b"QUERY_ADC",
    b"QUERY_ENDSTOPS",
    b"QUERY_FILAMENT_SENSOR",
    b"QUERY_FILAMENT_WIDTH",
    b"QUERY_PROBE",
    b"QUERY_RAW_FILAMENT_WIDTH",
    b"RESET_FILAMENT_WIDTH_SENSOR",
    b"RESET_SMART_EFFECTOR",
    b"RESET_VELOCITY_LIMIT",
    b"RESPOND",
    b"SAVE_VARIABLE",
    b"SDCARD_RESET_FILE",
    b"SET_DISPLAY_GROUP",
    b"SET_DISPLAY_TEXT",
    b"SET_EXTRUDER_ROTATION_DISTANCE",
    b"SET_EXTRUDER_STEP_DISTANCE",
    b"SET_FAN_SPEED",
    b"SET_FILAMENT_SENSOR",
    b"SET_GCODE_VARIABLE",
    b"SET_HEATER_TEMPERATURE",
    b"SET_IDLE_TIMEOUT",
    b"SET_INPUT_SHAPER",
    b"SET_LED",
    b"SET_LED_TEMPLATE",
    b"SET_PIN",
    b"SET_PRESSURE_ADVANCE",
    b"SET_PRINT_STATS_INFO",
    b"SET_RETRACTION",
    b"SET_SERVO",
    b"SET_SMART_EFFECTOR",
    b"SET_STEPPER_ENABLE",
    b"SET_TEMPERATURE_FAN_TARGET",
    b"SET_TMC_CURRENT",
    b"SET_TMC_FIELD",
    b"SET_VELOCITY_LIMIT",
    b"STATUS",
    b"SYNC_EXTRUDER_MOTION",
    b"TEMPERATURE_WAIT",
    b"TUNING_TOWER",
    b"TURN_OFF_HEATERS",
    b"UPDATE_DELAYED_GCODE",
];

/// Whether a name, in capitals, is one of Klipper's own commands that leave the machine alone.
pub fn is_still_name(name: &[u8]) -> bool {
    NAMES.binary_search(&name).is_ok()
}

/// Whether an M code leaves the machine alone for all firmwares of printers that have it: times, temperatures, fans,
/// limits, drivers, messages, settings.
pub fn is_still_code(code: u32) -> bool {
    matches!(
        code,
        0..=5
            | 7..=11
            | 16..=18
            | 20..=23
            | 26..=31
            | 33
            | 34
            | 36..=39
            | 42
            | 43
            | 70..=78
            | 80..=87
            | 92
            | 100
            | 102
            | 104..=124
            | 126..=129
            | 136
            | 140..=145
            | 149
            | 150
            | 154
            | 155
            | 163..=166
            | 190..=193
            | 200..=209
            | 211
            | 217
            | 218
            | 220
            | 221
            | 250
            | 255
            | 256
            | 260
            | 261
            | 280..=282
            | 300..=310
            | 330..=334
            | 350
            | 351
            | 355
            | 380
            | 381
            | 400
            | 403..=409
            | 412..=418
            | 420..=423
            | 425
            | 430
            | 450..=453
            | 486
            | 493
            | 494
            | 500..=505
            | 510..=512
            | 540
            | 550..=584
            | 586..=589
            | 591..=593
            | 595..=599
            | 603
            | 607
            | 622..=625
            | 630
            | 640
            | 665..=667
            | 669..=671
            | 703
            | 709
            | 710
            | 750..=756
            | 851
            | 852
            | 860..=869
            | 871
            | 876
            | 899
            | 900
            | 905..=919
            | 928
            | 929
            | 950..=960
            | 973..=975
            | 981
            | 982
            | 991
            | 993..=997
            | 1002
            | 1003
            | 1006
            | 1007
    )
}

/// Whether a code stops the work and parks, or changes the filament, for some printer: its number is no other machine's.
pub fn is_pause(code: u32) -> bool {
    matches!(code, 600..=602 | 701 | 702)
}

/// Name of the command that a line begins with, in capitals: `START_PRINT`, `M600`, `T1`.
pub fn command_name(body: &[u8]) -> Vec<u8> {
    let body = behind_block_skip(body);
    let numbered = body.strip_prefix(b"N").or_else(|| body.strip_prefix(b"n"));
    let behind = match numbered.map(|rest| rest.trim_ascii_start()) {
        Some(rest) if rest.first().is_some_and(u8::is_ascii_digit) => {
            let n_digits = rest.iter().take_while(|byte| byte.is_ascii_digit()).count();
            behind_block_skip(&rest[n_digits..])
        }
        _ => body,
    };
    let length =
        behind.iter().take_while(|byte| byte.is_ascii_alphanumeric() || b"_.".contains(byte)).count();
    let name = &behind[..length];
    // `M600X5` is M600 with a word; `T0_LOAD` is a name.
    let n_code = 1 + name.iter().skip(1).take_while(|byte| byte.is_ascii_digit() || **byte == b'.').count();
    let is_code = n_code > 1 && name.get(n_code) != Some(&b'_');
    (if is_code { &name[..n_code] } else { name }).to_ascii_uppercase()
}

/// A line without the `/`, or `/1` to `/9`, that it may begin with.
fn behind_block_skip(body: &[u8]) -> &[u8] {
    let body = body.trim_ascii_start();
    let Some(behind) = body.strip_prefix(b"/") else { return body };
    let is_numbered = behind.first().is_some_and(u8::is_ascii_digit);
    behind[usize::from(is_numbered)..].trim_ascii_start()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_by_their_order() {
        assert!(NAMES.is_sorted());
        assert!(NAMES.iter().all(|name| is_still_name(name)));
        assert!(!is_still_name(b"SET_POSITION") && !is_still_name(b""));
    }

    #[test]
    fn a_line_begins_with_a_command() {
        for (line, name) in [
            ("  _on_layer_change Z=5", "_ON_LAYER_CHANGE"),
            ("N12 M600", "M600"),
            ("/M600", "M600"),
            ("/1 N7 /T1", "T1"),
            ("M600X5 ; change", "M600"),
            ("T0_LOAD A=1", "T0_LOAD"),
            ("t1;next", "T1"),
            ("M1002.5 judge", "M1002.5"),
            ("NEXT_PART", "NEXT_PART"),
            ("", ""),
            ("?", ""),
        ] {
            assert_eq!(command_name(line.as_bytes()), name.as_bytes(), "{line}");
        }
    }
}
