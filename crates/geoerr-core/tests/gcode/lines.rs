//! One line at a time: which words change, which stay, and in what form.

use super::common::{nominal, options, passing, rewritten, run, scaled, skewed};
use geoerr_core::gcode::{Firmware, Options};

/// On `scaled`, X 100.1 is reached at X 100 and Y 99.8 at Y 100.
#[test]
fn words_change_and_everything_else_stays() {
    let cases = [
        ("G1 X100.1 Y99.8 Z5 E1.5 F1200 ; outer", "G1 X100.0000 Y100.0000 Z5 E1.5 F1200 ; outer"),
        ("g01x100.1y99.8z5f1200", "g01x100.0000y100.0000z5f1200"),
        ("G1 Z5 Y99.8 X100.1", "G1 Z5 Y100.0000 X100.0000"),
        ("N40 G1 X100.1 (up) Y99.8 Z5", "N40 G1 X100.0000 (up) Y100.0000 Z5"),
        ("G1\tX100.1\tY99.8\tZ5 S200 M8", "G1\tX100.0000\tY100.0000\tZ5 S200 M8"),
        ("  G0 X0 Y0 Z5.12345678901234567890", "  G0 X0 Y0 Z5.12345678901234567890"),
        ("G1 X 100.1 Y0 Z0", "G1 X100.0000 Y0 Z0"),
    ];
    for (line, expected) in cases {
        assert_eq!(rewritten(scaled(), options(), line), [expected], "{line}");
    }
}

#[test]
fn axes_that_the_line_does_not_name_are_added_when_they_change() {
    // Going up, X and Y lean: 5 µm in X for 5 mm in Z.
    let lines = rewritten(skewed(), options(), "G1 X10 Y0 Z0\nG1 Z5 F600 ; lift\ng1z0\nG1 E5\n");
    assert_eq!(lines[0], "G1 X10 Y0 Z0", "at the origin of squareness nothing changes");
    assert_eq!(lines[1], "G1 Z5 X10.0049 Y0.0200 F600 ; lift");
    assert_eq!(lines[2], "g1z0x10.0000y0.0000");
    assert_eq!(lines[3], "G1 E5");
    let lines = rewritten(skewed(), options(), "G1 X10 Y0 Z0\nG1 E5 Z5 F600 X10 ; any order\n");
    assert_eq!(lines[1], "G1 E5 Z5 F600 X10.0049 Y0.0200 ; any order");
}

#[test]
fn the_first_changed_move_gives_all_three_axes() {
    let lines = rewritten(scaled(), options(), "G28\nG1 Z5\nG1 X100.1 Y0 E1\nG1 X200.2\n");
    assert_eq!(lines, ["G28", "G1 Z5", "G1 X100.0000 Y0 Z5.0000 E1", "G1 X200.0000"]);
}

#[test]
fn modal_moves_of_machining_programs() {
    let program =
        "%\n(part)\nG21 G90\nG0 X0 Y0 Z0\n X100.1\n Y99.8\nG1 Z-1 F100\nX0Y0\nM30\n%\nX5 is no program\n";
    let lines = rewritten(scaled(), options(), program);
    assert_eq!(lines[4..8], [" X100.0000 Y0.0000 Z0.0000", " Y100.0000", "G1 Z-1 F100", "X0Y0"]);
    assert_eq!(lines.last().unwrap(), "X5 is no program");
}

#[test]
fn inches_get_one_digit_more() {
    let lines = rewritten(scaled(), options(), "G20\nG0 X0 Y0 Z0\nG1 X3.93\nG21\nG1 X0\n");
    // 3.93 / 1.001 inches
    assert_eq!(lines[2], "G1 X3.92607 Y0.00000 Z0.00000");
    assert_eq!(lines[4], "G1 X0");
}

/// Siemens' G700 and G710.
#[test]
fn units_of_siemens_are_inches_and_millimetres() {
    let written = |program: &str| run(scaled(), options(), program).unwrap().text().to_owned();
    let usual = "G21\nG90\nG1 X0 Y0 Z0\nG20\nG1 X3.93\nG21\nG1 X50\n";
    let siemens = usual.replace("G21", "G710").replace("G20", "G700");
    assert_eq!(written(&siemens), written(usual).replace("G21", "G710").replace("G20", "G700"));
}

#[test]
fn increments_carry_their_rounding() {
    // 1000 steps of 0.1 mm: the true step is 0.0999001.
    let program = format!("G90\nG1 X0 Y0 Z0\nG91\n{}G90\nG1 Y0\n", "G1 X0.1\n".repeat(1000));
    let outcome = run(scaled(), options(), &program).unwrap();
    let steps = outcome.lines().into_iter().filter_map(|line| line.strip_prefix("G1 X0."));
    let sum: i64 = steps.map(|digits| format!("{digits:0<4}").parse::<i64>().unwrap()).sum();
    assert_eq!(sum, 999_001, "100 / 1.001 in units of 0.1 µm, to half a unit");
}

#[test]
fn a_number_behind_an_equals_sign_is_a_number() {
    let program = "G1 X=100.1 Y = 99.8 Z=5 F=500\nG1 X=200.2\nT1 D1\nG0 X=100.1Y=99.8 Z=6 D1\n";
    let lines = rewritten(scaled(), options(), program);
    assert_eq!(lines[..2], ["G1 X100.0000 Y100.0000 Z=5 F=500", "G1 X200.0000"]);
    assert_eq!(lines[3], "G0 X100.0000Y100.0000 Z=6 D1");
    // Printers do not have it.
    let printer = Options { firmware: Some(Firmware::RepRapFirmware), ..options() };
    let refused = run(scaled(), printer, "G1 X=100.1 Y99.8 Z5\n").unwrap_err();
    assert!(refused.to_string().contains("column 5"), "{refused}");
}

#[test]
fn machine_coordinates_and_the_work_offset() {
    let options = Options { work_offset_mm: Some([100.1, 0.0, 0.0]), ..options() };
    let lines = rewritten(scaled(), options, "G90\nG0 X0 Y0 Z0\nG53 G0 X100.1\nX100.1\nG53 X0 Y99.8\n");
    assert_eq!(lines[1], "G0 X-0.1000 Y0 Z0");
    assert_eq!(lines[2], "G53 G0 X100.0000", "here already, so said again in the machine's words");
    assert_eq!(lines[3], "X99.9000", "200.2 in the machine is reached at 200.0");
    assert_eq!(lines[4], "G53 X0 Y100.0000");
}

#[test]
fn splitting_shares_the_extrusion_to_its_last_digit() {
    // Two kinks: at least three pieces.
    let program = "M82\nG92 E0\nG1 X0 Y0 Z0\nG1 X400 E13.37 F900 ; long\nM83\nG1 X0 E-.123456\n";
    let machine = super::common::bent("wbXYZt", [0.0; 3]);
    let outcome = run(machine, options(), program).unwrap();
    let lines = outcome.lines();
    let back = lines.iter().position(|line| *line == "M83").unwrap();
    let absolute = &lines[3..back];
    assert!(absolute.len() > 2);
    assert!(absolute[0].ends_with(" F900 ; long"), "{}", absolute[0]);
    assert!(absolute[1..].iter().all(|line| line.starts_with("G1 X") && !line.contains('F')));
    assert!(absolute.last().unwrap().ends_with(" E13.37"), "the last piece keeps the text");
    let number = |line: &str| {
        let word = line.split(' ').find(|word| word.starts_with('E')).unwrap();
        word[1..].parse::<f64>().unwrap()
    };
    assert!(absolute.windows(2).all(|pair| number(pair[0]) <= number(pair[1])));
    let relative = &lines[back + 1..];
    let millionths = |line: &&str| (number(line) * 1e6).round() as i64;
    assert!(relative.len() > 2);
    assert_eq!(relative.iter().map(millionths).sum::<i64>(), -123_456);
    assert_eq!(outcome.summary.extrusion_in, outcome.summary.extrusion_out);
    assert_eq!(outcome.summary.moves_in, 3);
    assert_eq!(outcome.summary.moves_out as usize, 1 + absolute.len() + relative.len());
}

#[test]
fn where_the_extruder_stands_is_the_same_place_in_inches() {
    // From 25.4 mm, one inch, to two.
    let program = "M82\nG1 X0 Y0 Z0 E25.4\nG20\nG1 X15 E2\nG1 E1\nG21\n";
    let outcome = run(super::common::bent("wbXYZt", [0.0; 3]), options(), program).unwrap();
    let lines = outcome.lines();
    let ends: Vec<f64> = lines[3..lines.len() - 2]
        .iter()
        .map(|line| line.rsplit_once(" E").unwrap().1.parse().unwrap())
        .collect();
    assert!(ends.len() > 2);
    assert!(
        ends[0] > 1.0 && ends.windows(2).all(|pair| pair[0] < pair[1]) && ends.last() == Some(&2.0),
        "{ends:?}"
    );
    let in_all = 254 * 10_i128.pow(17);
    assert_eq!((outcome.summary.extrusion_in, outcome.summary.extrusion_out), (in_all, in_all));
}

#[test]
fn what_has_too_many_digits_to_be_shared_is_extruded_once() {
    let program = "M83\nG1 X0 Y0 Z0\nG1 E900000000000000 X400\n";
    let lines = rewritten(super::common::bent("wbXYZt", [0.0; 3]), options(), program);
    assert!(lines.len() > 4, "{lines:?}");
    assert!(lines[2].starts_with("G1 E900000000000000 X"), "{}", lines[2]);
    assert!(lines[3..].iter().all(|line| !line.contains('E')), "{lines:?}");
}

#[test]
fn a_split_move_with_unclear_extrusion_needs_the_firmware() {
    let program = "M83\nG90\nG1 X0 Y0 Z0\nG1 X400 E10\n";
    let machine = || super::common::bent("wbXYZt", [0.0; 3]);
    let refused = run(machine(), options(), program).unwrap_err();
    assert_eq!(refused.line(), 4);
    assert!(refused.remedy().contains("--firmware"));
    for (firmware, last) in [(Firmware::Marlin, "E10"), (Firmware::Klipper, "")] {
        let options = Options { firmware: Some(firmware), ..options() };
        let lines = rewritten(machine(), options, program);
        assert!(lines.len() > 5 && lines.last().unwrap().ends_with(last));
    }
    let whole = run(machine(), passing(), program).unwrap();
    assert_eq!(whole.summary.moves_out, 2);
    assert_eq!(whole.warning_names(), ["extrusion-unclear", "not-split"]);
}

#[test]
fn whose_reading_of_an_unclear_extrusion_is_told_is_said() {
    // Marlin extrudes to 10 and to 12, others 10 and 12 more.
    let program = "M83\nG90\nG1 X0 Y0 Z0 E10\nG1 E12\n";
    let told = run(scaled(), options(), program).unwrap();
    assert_eq!(told.warning_names(), ["extrusion-unclear"]);
    assert_eq!(told.warnings[0].count, 2);
    assert_eq!(told.summary.extrusion_in, 12 * 10_i128.pow(18));
    let named = Options { firmware: Some(Firmware::Klipper), ..options() };
    let known = run(scaled(), named, program).unwrap();
    assert!(known.warning_names().is_empty());
    assert_eq!(known.summary.extrusion_in, 22 * 10_i128.pow(18));
}

#[test]
fn the_mark_stands_before_the_first_changed_line_in_the_program_s_own_comments() {
    let mark = "corrected by geoerr: model 0123456789ab, tolerance 0.005 mm, do not correct again";
    let printer = run(scaled(), options(), "; a\n(b)\nG1 X0 Y0 Z0\r\nG1 X50\r\nG1 X60\r\n").unwrap();
    assert_eq!(
        printer.text(),
        format!("; a\n(b)\nG1 X0 Y0 Z0\r\n; {mark}\r\nG1 X49.9500 Y0.0000 Z0.0000\r\nG1 X59.9401\r\n")
    );
    let mill = run(scaled(), options(), "(b)\nG1 X50 Y0 Z0").unwrap();
    assert_eq!(mill.text(), format!("(b)\n({mark})\nG1 X49.9500 Y0 Z0"));
}

#[test]
fn line_ends_and_a_missing_last_one_are_kept() {
    let machine = || super::common::bent("wbXYZt", [0.0; 3]);
    let outcome = run(machine(), options(), "G1 X0 Y0 Z0\r\nM117 \u{e9}\nG1 X200").unwrap();
    let text = outcome.text();
    assert!(text.contains("\u{e9}\n") && !text.ends_with('\n'));
    let pieces: Vec<&str> = text.split("\u{e9}\n").nth(1).unwrap().split('\n').collect();
    assert!(pieces.len() > 1 && pieces.iter().all(|piece| piece.starts_with("G1 X")));
}

#[test]
fn a_machine_without_errors_changes_nothing() {
    let program =
        "; \u{ff}\nG28\nG1 X1.23456789 Y2 Z3.00\nG91\nG1 X.1\r\nG20\nG1 Z.001\nN5 G90*22\nN6 G1 X3*9\nM84";
    let outcome = run(nominal(), options(), program).unwrap();
    assert_eq!(outcome.text(), program);
    assert_eq!(outcome.summary.largest_correction_mm, 0.0);
}
