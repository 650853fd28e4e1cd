//! What is known of the machine from line to line.

use super::common::{bent, options, passing, rewritten, run, scaled, skewed};
use geoerr_core::gcode::{Firmware, GcodeError, Options};

#[test]
fn moves_before_the_position_is_known_pass_untouched() {
    let outcome = run(scaled(), options(), "G1 X100.1 Y99.8\nG91\nG1 Z5\nG90\nG1 Z5\nG1 X100.1\n").unwrap();
    let lines = outcome.lines();
    assert_eq!(lines[..4], ["G1 X100.1 Y99.8", "G91", "G1 Z5", "G90"]);
    assert_eq!(lines[4], "G1 Z5 X100.0000 Y100.0000", "now all three are known");
    assert_eq!(outcome.summary.untouched_position_unknown, 2);
    assert_eq!(outcome.warning_names(), ["position-unknown"]);
    assert_eq!(outcome.warnings[0].line, 1);
    assert_eq!(outcome.warnings[0].count, 2);
}

#[test]
fn homing_forgets_unless_its_place_is_given() {
    let program = "G1 X100.1 Y0 Z0\nG28 X\nG1 Y99.8\nG1 X100.1\n";
    assert_eq!(
        rewritten(scaled(), options(), program)[1..],
        ["G28 X", "G1 Y99.8", "G1 X100.0000 Y100.0000 Z0.0000"]
    );
    let home = Options { home_mm: Some([0.0, 0.0, 10.0]), work_offset_mm: Some([0.0; 3]), ..options() };
    assert_eq!(rewritten(scaled(), home, program)[2], "G1 Y100.0000 X0.0000 Z0.0000");
}

#[test]
fn where_the_program_s_zero_is_not_told_homing_tells_nothing_of_it() {
    // X and Y that were added behind G28 would count from G54, which may be anywhere.
    let home = Options { home_mm: Some([0.0, 0.0, 10.0]), ..options() };
    let program = "G28\nG1 Z5\nG1 X100.1 F600\nG91\nG28 Z0\nG1 X5\n";
    let outcome = run(scaled(), home.clone(), program).unwrap();
    assert_eq!(outcome.text(), program);
    assert_eq!(outcome.warning_names(), ["zero-not-told", "position-unknown"]);
    assert_eq!((outcome.warnings[0].line, outcome.warnings[0].count), (1, 2));
    let named = |firmware| Options { firmware: Some(firmware), ..home.clone() };
    for (options, before) in [
        (Options { work_offset_mm: Some([0.0; 3]), ..home.clone() }, ""),
        (named(Firmware::Marlin), ""),
        (home.clone(), "G10 L2 P1 X0 Y0 Z0\n"),
        (home.clone(), "G10 L2 P2 X0 Y0 Z0\nG55\n"),
        // Plainly a printer's, whose zero is the machine's.
        (home.clone(), "M140 S60\n"),
        (home.clone(), "M190 T1 R60 ; bed\n"),
        (home.clone(), "M109 S215 T0\n"),
        (home.clone(), "G92 E0\n"),
        (home.clone(), "G1 E-2 F1200\n"),
    ] {
        let outcome = run(scaled(), options, &format!("{before}G28\nG1 X100.1\n")).unwrap();
        assert_eq!(outcome.lines().last(), Some(&"G1 X100.0000 Y0.0000 Z10.0000"), "{before}");
        assert!(!outcome.warning_names().contains(&"zero-not-told"), "{before}");
    }
    // A clamp or a spindle of a machine tool.
    for before in ["M140", "M109 P2", "M190 X5", "M104 S1500", "M82"] {
        let passing = Options { on_unsupported: passing().on_unsupported, ..home.clone() };
        let outcome = run(scaled(), passing, &format!("{before}\nG28\nG1 X100.1\n")).unwrap();
        assert_eq!(outcome.lines().last(), Some(&"G1 X100.1"), "{before}");
    }
}

#[test]
fn a_place_in_one_coordinate_system_tells_nothing_in_one_whose_zero_is_not_told() {
    let programs = [
        "G10 L2 P2 X0 Y0 Z0\nG55\nG0 X100 Y50 Z20\nG54\nG0 X5\n",
        "G10 L2 P2 X0 Y0 Z0\nG0 X100 Y50 Z20\nG55\nG0 X5\n",
        "G10 L2 P2 X0 Y0 Z0\nG55\nG53 G0 X100 Y50 Z20\nG54 G0 X5\n",
        "G0 X100 Y50 Z20\nG10 L2 P1 X0 Y0 Z0\nG0 X5\n",
        "G0 X100 Y50 Z20\nG55\nG91 G0 Y50\n",
        // What G92 says of a place that is forgotten tells no shift.
        "G10 L2 P2 X0 Y0 Z0\nG55\nG0 X100 Y50 Z20\nG54 G92 X0 Y0 Z0\nG0 X5 Y5 Z5\n",
    ];
    let last = |options: Options, program: &str| {
        let outcome = run(skewed(), options, program).unwrap();
        let said = outcome.warnings.iter().any(|one| one.kind.name() == "zero-not-told");
        ((*outcome.lines().last().unwrap()).to_owned(), said)
    };
    for program in programs {
        let as_it_was = program.lines().last().unwrap().to_owned();
        assert_eq!(last(passing(), program), (as_it_was.clone(), true), "{program}");
        let told = Options { work_offset_mm: Some([0.0; 3]), ..passing() };
        let (line, said) = last(told, program);
        assert!(!said && line != as_it_was, "{program}");
    }
    // All three words tell the place again.
    let outcome = run(scaled(), options(), &format!("{}G0 X100.1 Y0 Z0\nG0 X200.2\n", programs[0])).unwrap();
    assert_eq!(outcome.lines().last(), Some(&"G0 X200.0000"));
}

#[test]
fn an_axis_that_rests_is_not_moved_by_an_offset_of_the_firmware() {
    let behind = |line: &str| {
        rewritten(scaled(), options(), &format!("G1 X100.1 Y0 Z0\n{line}\nG1 Y99.8\n"))[2].clone()
    };
    for line in ["M206 X5", "M428", "SET_GCODE_OFFSET X=5", "set_gcode_offset x_adjust=5 MOVE=0"] {
        assert_eq!(behind(line), "G1 Y99.8", "{line}");
    }
    for line in ["M206", "M290 X.1", "SET_GCODE_OFFSET X=5 MOVE=1", "SET_GCODE_OFFSET E=5"] {
        assert_eq!(behind(line), "G1 Y100.0000", "{line}");
    }
}

#[test]
fn what_a_line_forgets_it_forgets_before_g92() {
    for line in ["M6 G92 X0", "G92 X0 M6"] {
        let program = format!("G1 X100.1 Y0 Z0\n{line}\nG1 X100.1 Y0 Z0\n");
        assert_eq!(rewritten(scaled(), options(), &program)[2], "G1 X100.1 Y0 Z0", "{line}");
    }
}

#[test]
fn g92_keeps_two_zeros() {
    // At X 100 of the corrected machine the program says it is at 0; 100.1 further on is at command 200.
    let lines =
        rewritten(scaled(), options(), "G1 X100.1 Y0 Z0\nG92 X0\nG1 X100.1\nG1 X0\nG92 X100.1\nG1 X0\n");
    assert_eq!(lines, ["G1 X100.0000 Y0 Z0", "G92 X0", "G1 X100.0000", "G1 X0", "G92 X100.1", "G1 X0.1000"]);
}

#[test]
fn g92_at_an_unknown_place_leaves_it_unknown() {
    let outcome = run(scaled(), options(), "G92 X0 Y0 Z0\nG1 X100.1 Y99.8 Z5\n").unwrap();
    assert_eq!(outcome.text(), "G92 X0 Y0 Z0\nG1 X100.1 Y99.8 Z5\n");
    assert_eq!(outcome.summary.untouched_position_unknown, 1);
}

#[test]
fn homing_after_a_shift_is_asked_about() {
    let program = "G1 X0 Y0 Z0\nG92 X10\nG28 X\nG1 X100.1 Y0 Z0\n";
    let refused = run(scaled(), options(), program).unwrap_err();
    assert_eq!(refused.line(), 3);
    let klipper = Options { firmware: Some(Firmware::Klipper), ..options() };
    assert_eq!(rewritten(scaled(), klipper, program)[3], "G1 X100.0000 Y0 Z0");
}

#[test]
fn coordinate_systems_that_the_program_sets() {
    let program = "G10 L2 P2 X100.1 Y0 Z0\nG55 G90\nG0 X0 Y0 Z0\nG54\nG0 X100.1\nG10 L2 P1 X200.2\nG0 X0\n";
    let told = Options { work_offset_mm: Some([0.0; 3]), ..options() };
    let lines = rewritten(scaled(), told, program);
    assert_eq!(lines[2], "G0 X-0.1000 Y0 Z0");
    assert_eq!(lines[4], "G0 X100.0000");
    assert_eq!(lines[6], "G0 X-0.2000");
    assert_eq!(run(scaled(), options(), "G10 L2 P2 X0 Y0\nG55\n").unwrap_err().line(), 2, "Z was not set");
}

#[test]
fn what_stands_behind_a_label_is_read() {
    let program = "G21 G90\nG0 X10 Y10 Z20\nSIDE: G91\nG1 X100 F300\nBACK: G90 G1 X10\nEND:\n";
    let without = program.replace("SIDE: ", "").replace("BACK: ", "").replace("END:\n", "");
    let lines = rewritten(scaled(), passing(), program);
    let plain: Vec<String> =
        lines.iter().map(|line| line.replace("SIDE: ", "").replace("BACK: ", "")).collect();
    assert_eq!(plain[..plain.len() - 1], rewritten(scaled(), passing(), &without));
    assert!(lines[4].starts_with("BACK: G90 G1 X") && lines[5] == "END:", "{lines:?}");
}

#[test]
fn a_printer_s_macro_may_have_parameters_like_codes() {
    let program = "G90\nG1 X10 Y10 Z1\nMY_MACRO G28 M5\nG1 X20 Y20 Z1\n";
    let named = Options { firmware: Some(Firmware::Klipper), ..options() };
    assert!(run(scaled(), named, program).is_ok());
    let still = Options { still: vec![b"MY_MACRO".to_vec()], ..options() };
    assert!(run(scaled(), still, program).is_ok());
    assert!(run(scaled(), options(), program).is_err());
}

#[test]
fn commands_that_may_move_the_machine_make_it_unknown() {
    let corrected = "G1 X100.1 Y0 Z0\n";
    for command in ["PARK", "G29", "G30", "T1 M6", "G27", "M48 P3", "BED_MESH_CALIBRATE", "G12 P1"] {
        let lines = rewritten(scaled(), options(), &format!("{corrected}{command}\nG1 X200.2\n"));
        assert_eq!(lines[1..], [command, "G1 X200.2"], "{command}");
    }
    for command in [
        "SET_PRINT_STATS_INFO CURRENT_LAYER=3",
        "M117 G1 X5",
        "G4 X100",
        "G10",
        "G11",
        "G10 S200 P0",
        "M204 P4000",
        "M201 X4000 Y4000 Z400 E5000",
        "T0",
        "G92 E0",
        "G17 G40 G64 P0.1",
        "EXCLUDE_OBJECT_START NAME=a",
        "M84 X Y E",
    ] {
        let lines = rewritten(scaled(), options(), &format!("{corrected}{command}\nG1 X200.2\n"));
        assert_eq!(lines[1..], [command, "G1 X200.0000"], "{command}");
    }
}

#[test]
fn a_placeholder_passes_and_forgets_what_it_names() {
    let outcome =
        run(scaled(), options(), "G1 X100.1 Y0 Z0\nG1 X0 Y{machine_depth} ; show\nG1 Z5\n").unwrap();
    assert_eq!(outcome.lines()[1..], ["G1 X0 Y{machine_depth} ; show", "G1 Z5"]);
    assert_eq!(outcome.warning_names(), ["placeholder", "position-unknown"]);
}

#[test]
fn a_tool_length_is_named_once_and_forgets_z() {
    let outcome = run(scaled(), options(), "G0 X0 Y0 Z50\nG43 H1 Z10\nG0 X100.1\nG43 H1\n").unwrap();
    assert_eq!(outcome.lines()[2], "G0 X100.0000 Y0.0000 Z10.0000");
    assert_eq!(outcome.warning_names(), ["tool-length"]);
    assert_eq!(run(scaled(), options(), "G43 H1\nG43 H2\n").unwrap_err().line(), 2);
    assert_eq!(run(scaled(), options(), "G43 H1\nG49\nG0 X5\n").unwrap_err().line(), 3);
    assert!(run(scaled(), options(), "G49\nG43 H2\n").is_ok());
}

#[test]
fn corrections_of_the_firmware_are_pointed_out_unless_named() {
    let program = "M852 I0.01\nSET_SKEW XY=1,2,3\nG29\nM425 X0.1\nBED_MESH_PROFILE LOAD=a\nM92 X81\nM579 Y1.01\n\
                   #VOLCOMP ON [ID0]\nM92 E415\n";
    let outcome = run(scaled(), options(), program).unwrap();
    assert_eq!(outcome.warning_names(), ["firmware-corrects"]);
    assert_eq!((outcome.warnings[0].line, outcome.warnings[0].count), (1, 8));
    let named = Options { firmware_corrections_named: true, ..options() };
    assert_eq!(run(scaled(), named, program).unwrap().warning_names(), Vec::<&str>::new());
}

#[test]
fn passed_lines_leave_known_what_their_words_say() {
    // The arc ends at its words, uncorrected; Z has not moved and is still where it was put.
    let program = "G1 X100.1 Y99.8 Z10\nG2 X200.2 Y99.8 I50\nG1 X100.1\nG1 Y0\n";
    let outcome = run(skewed(), passing(), program).unwrap();
    let lines = outcome.lines();
    assert_eq!(lines[1], "G2 X200.2 Y99.8 I50");
    assert!(lines[2].contains('X') && lines[2].contains('Y') && lines[2].contains('Z'), "{}", lines[2]);
    assert_eq!(outcome.summary.untouched_unsupported, 1);
    // A cycle retracts somewhere: nothing is known until all three are given.
    let program = "G1 X100.1 Y0 Z0\nG81 X0 Y0 Z-5 R2 F50\nX10\nG80\nG1 X100.1 Y0\nG1 Z5\nG1 X200.2\n";
    let outcome = run(scaled(), passing(), program).unwrap();
    assert_eq!(outcome.lines()[1..5], ["G81 X0 Y0 Z-5 R2 F50", "X10", "G80", "G1 X100.1 Y0"]);
    assert_eq!(outcome.lines()[5..], ["G1 Z5 X100.0000 Y0.0000", "G1 X200.0000"]);
}

#[test]
fn a_zero_that_cannot_be_read_is_lost() {
    let program = "G1 X100.1 Y0 Z0\nG92 X[#1]\nG1 X100.1 Y0 Z0\nG53 G1 X100.1 Y0 Z0\nG1 X100.1\n";
    let told = Options { work_offset_mm: Some([0.0, 0.0, 1.0]), ..passing() };
    let outcome = run(scaled(), told, program).unwrap();
    let lines = outcome.lines();
    assert_eq!(lines[2], "G1 X100.1 Y0 Z0");
    assert_eq!(lines[3], "G53 G1 X100.0000 Y0 Z0", "the machine's own zero is not lost");
    assert_eq!(lines[4], "G1 X100.1");
}

#[test]
fn where_the_program_s_zero_is_not_told_machine_coordinates_tell_nothing_of_it() {
    let program = "G0 X100.1 Y99.8 Z10\nG53 G0 Z100\nG0 X200.2\nG0 Z10\n";
    let outcome = run(skewed(), options(), program).unwrap();
    let lines = outcome.lines();
    assert_eq!(lines[1..3], ["G53 G0 Z100", "G0 X200.2"], "no word counts from a zero that is only thought");
    assert!(lines[3].starts_with("G0 Z") && lines[3].contains('X') && lines[3].contains('Y'), "{}", lines[3]);
    assert_eq!(outcome.warning_names(), ["zero-not-told", "position-unknown"]);
    for (options, before) in [
        (Options { work_offset_mm: Some([0.0, 0.0, 1.0]), ..options() }, ""),
        (Options { work_offset_mm: Some([0.0; 3]), ..options() }, ""),
        (Options { firmware: Some(Firmware::RepRapFirmware), ..options() }, ""),
        (options(), "G10 L2 P1 X0 Y0 Z0\n"),
        (options(), "G10 L2 P2 X0 Y0 Z0\nG55\n"),
    ] {
        let told = run(skewed(), options, &format!("{before}{program}")).unwrap();
        assert!(told.warnings.is_empty(), "{before}");
        let is_corrected = |line: &&str| line.starts_with("G53 G0 Z100") && line.contains('X');
        assert!(told.lines().iter().any(is_corrected), "{:?}", told.lines());
    }
    let passed = run(skewed(), passing(), "G0 X100.1 Y99.8 Z10\nG53 G0 Z100 A0\nG0 X200.2\n").unwrap();
    assert_eq!(passed.lines()[2], "G0 X200.2");
}

#[test]
fn a_rapid_to_the_end_of_an_axis_passes() {
    // Y 420 is reached at 420.84, which no axis does.
    let told = Options { work_offset_mm: Some([10.0, 0.0, 0.0]), ..options() };
    let program = "G0 X90.1 Y0 Z0\nG53 G0 Y420\nG0 X190.2\nG0 Y99.8\n";
    let outcome = run(scaled(), told.clone(), program).unwrap();
    assert_eq!(outcome.lines()[1..], ["G53 G0 Y420", "G0 X190.2", "G0 Y100.0000 X190.0000 Z0.0000"]);
    assert_eq!(outcome.warning_names(), ["end-of-axis", "position-unknown"]);
    let cut = run(scaled(), told, &program.replace("G53 G0", "G53 G1")).unwrap_err();
    assert!(matches!(cut, GcodeError::CommandOutsideRange { line: 2, axis: 'Y', .. }), "{cut:?}");
}

#[test]
fn after_a_branch_nothing_is_corrected() {
    let program = "G1 X100.1 Y0 Z0\no100 while [#1 LT 3]\nG1 X200.2 Y0 Z0\no100 endwhile\n";
    let outcome = run(scaled(), passing(), program).unwrap();
    assert_eq!(outcome.lines()[1..], ["o100 while [#1 LT 3]", "G1 X200.2 Y0 Z0", "o100 endwhile"]);
    assert_eq!(outcome.summary.lines_not_followed, 2);
}

#[test]
fn other_tools_and_zero_shifts_are_pointed_out() {
    let outcome = run(scaled(), options(), "T0\nT1\nSET_GCODE_OFFSET Z=0.05\nM206 X1\n").unwrap();
    assert_eq!(outcome.warning_names(), ["other-tool", "zero-moves"]);
}

#[test]
fn a_move_stands_behind_the_code_of_a_stop_where_no_printer_reads_text_there() {
    let program = "G1 X0 Y0 Z0\nM01 G00 X100.1\n";
    assert_eq!(rewritten(scaled(), options(), program)[1], "M01 G00 X100.0000 Y0.0000 Z0.0000");
    let printer = Options { firmware: Some(Firmware::RepRapFirmware), ..options() };
    assert_eq!(rewritten(scaled(), printer, program)[1], "M01 G00 X100.1");
    let text = "G1 X100.1 Y0 Z0\nM0 Click (to\nM23 GEAR2.GCO\nM92 X80 Y80\nM84 X Y\nG1 Y99.8\n";
    assert_eq!(rewritten(scaled(), options(), text)[5], "G1 Y100.0000");
}

#[test]
fn behind_a_branch_of_a_printer_nothing_is_known() {
    let program = "M83\nG1 X100.1 Y0 Z0\nM622 J1\nG1 X0\nM623\nG1 Y99.8\nG1 X100.1 Z0 E1\n";
    let outcome = run(scaled(), options(), program).unwrap();
    let lines = outcome.lines();
    assert_eq!(lines[5], "G1 Y99.8");
    assert_eq!(lines[6], "G1 X100.0000 Z0 Y100.0000 E1", "all three are known again");
    // Another code, which sets what a branch does by default.
    assert!(run(scaled(), options(), "M622.1 S1\nG1 X100.1 Y0 Z0\n").unwrap().warnings.is_empty());
}

#[test]
fn some_firmwares_run_the_first_code_of_a_line_alone() {
    let program = "G1 X100.1 Y0 Z0\nG91 G1 Z5\n";
    for firmware in [Firmware::Klipper, Firmware::Marlin] {
        let named = Options { firmware: Some(firmware), ..options() };
        let refused = run(scaled(), named.clone(), program).unwrap_err().to_string();
        assert!(refused.contains("several codes"), "{refused}");
        run(scaled(), named, "G1 X100.1 Y0 Z0\nM204 S500\nG4 P5\n").unwrap();
    }
    let named = Options { firmware: Some(Firmware::RepRapFirmware), ..options() };
    run(scaled(), named, program).unwrap();
}

#[test]
fn what_measures_the_bed_or_may_not_home_leaves_the_place_unknown() {
    let home = Options { home_mm: Some([0.0; 3]), firmware: Some(Firmware::Marlin), ..options() };
    let behind = |line: &str, options: Options| {
        rewritten(scaled(), options, &format!("G28\n{line}\nG1 X100.1\n"))[2].clone()
    };
    assert_eq!(behind("G28", home.clone()), "G1 X100.0000 Y0.0000 Z0.0000");
    assert_eq!(behind("G28 O", home.clone()), "G1 X100.1");
    assert_eq!(behind("G80", home.clone()), "G1 X100.1", "Prusa's mesh levelling");
    let mill = Options { firmware: None, ..home };
    assert_eq!(behind("G80\nG1 F5", mill)[..], "G1 F5"[..]);
}

#[test]
fn a_numbered_program_without_points_is_told_of() {
    let moves = "G90 G21\nG0 X0 Y0 Z0\nG1 X200 Y.5 Z0 F100\nG1 x 1.5Y-3(Z7)\nG1 X0.Y1. (X5)\n";
    let told = run(scaled(), options(), &format!("%\nO0001 (PART)\n{moves}%\n")).unwrap();
    let found: Vec<_> =
        told.warnings.iter().filter(|one| one.kind.name() == "number-without-point").collect();
    assert_eq!(found.len(), 1);
    assert_eq!((found[0].line, found[0].count), (5, 2));
    // Printers and LinuxCNC read whole numbers as they are written.
    for program in [moves.to_owned(), format!("%\n{moves}%\n")] {
        let silent = run(scaled(), options(), &program).unwrap();
        assert!(!silent.warning_names().contains(&"number-without-point"), "{program}");
    }
}

fn named(firmware: Firmware) -> Options {
    Options { firmware: Some(firmware), ..options() }
}

#[test]
fn behind_a_tool_no_axis_word_is_added_to_a_printer_s_travel() {
    let behind = |options: Options, tools: &str| {
        let program = format!("M83\nG1 X100.1 Y0 Z0 E1\n{tools}\nG1 X200.2 Y0\nG1 Z5\n");
        let outcome = run(scaled(), options, &program).unwrap();
        let lines = outcome.lines();
        ((lines[lines.len() - 2]).to_owned(), (lines[lines.len() - 1]).to_owned(), outcome.movers)
    };
    let untouched = ("G1 X200.2 Y0".to_owned(), "G1 Z5 X200.0000 Y0.0000".to_owned());
    let firmwares = [Firmware::Klipper, Firmware::Marlin, Firmware::RepRapFirmware];
    for options in firmwares.map(named).into_iter().chain([options()]) {
        for tool in ["T1", "T0"] {
            let (travel, down, movers) = behind(options.clone(), tool);
            assert_eq!((travel, down), untouched, "{tool} {:?}", options.firmware);
            assert_eq!(movers, [(tool.to_owned(), 1)]);
        }
        // Of the tool in use Marlin and RepRapFirmware do nothing; of Klipper's macro nobody knows.
        let is_still = matches!(options.firmware, Some(Firmware::Marlin | Firmware::RepRapFirmware));
        let (travel, ..) = behind(options.clone(), "T1\nG1 X0 Y0 Z0\nT1");
        assert_eq!(travel != untouched.0, is_still, "{:?}", options.firmware);
        let told = Options { still: vec![b"T1".to_vec()], ..options };
        assert_eq!(behind(told, "T1").0, "G1 X200.0000 Y0");
    }
    // Where nothing is known nothing is lost, and nothing is said.
    let begin = "T0\nG1 X100.1 Y0 Z0\n";
    assert!(run(scaled(), named(Firmware::Klipper), begin).unwrap().warnings.is_empty());
    // A mill's T alone makes the magazine turn.
    assert_eq!(rewritten(scaled(), options(), "G1 X100.1 Y0 Z0\nT1\nG1 X200.2\n")[2], "G1 X200.0000");
}

#[test]
fn a_printer_that_homes_one_axis_moves_the_others() {
    let home = |firmware| Options { firmware, home_mm: Some([0.0, 0.0, 10.0]), ..options() };
    let firmwares = [Firmware::Klipper, Firmware::Marlin, Firmware::RepRapFirmware].map(Some);
    for options in firmwares.into_iter().chain([None]).map(home) {
        for homing in ["G28 Z", "G28 X Y", "G28 X0", "G28 Y Z"] {
            let program = format!("M83\nG1 X100.1 Y0 Z0 E1\n{homing}\nG1 Z5\nG1 X100.1\nG1 X200.2 Y99.8\n");
            let lines = rewritten(scaled(), options.clone(), &program);
            let expected = ["G1 Z5", "G1 X100.1", "G1 X200.0000 Y100.0000 Z5.0000"];
            assert_eq!(lines[3..], expected, "{homing} {:?}", options.firmware);
        }
        let all = "M83\nG1 X100.1 Y0 Z0 E1\nG28 X Y Z\nG1 X100.1\n";
        assert_eq!(rewritten(scaled(), options, all)[3], "G1 X100.0000 Y0.0000 Z10.0000");
    }
}

#[test]
fn what_the_user_says_is_still_moves_nothing() {
    let program = "G1 X100.1 Y0 Z0\n_On_Layer_Change Z=1\nM600\nPARK\nG1 X200.2\nPARK\nBEEP\n";
    let outcome = run(scaled(), named(Firmware::Klipper), program).unwrap();
    let counts = [("_ON_LAYER_CHANGE", 1), ("M600", 1), ("PARK", 2), ("BEEP", 1)];
    assert_eq!(outcome.movers, counts.map(|(name, count)| (name.to_owned(), count)));
    assert!(outcome.warnings[0].kind.explanation().contains("--still"));
    let still = ["_ON_LAYER_CHANGE", "M600", "PARK"].map(|name| name.as_bytes().to_vec());
    let told = Options { still: still.to_vec(), ..named(Firmware::Klipper) };
    let outcome = run(scaled(), told, program).unwrap();
    assert_eq!(outcome.lines()[4], "G1 X200.0000");
    assert_eq!(outcome.movers, [("BEEP".to_owned(), 1)]);
}

#[test]
fn what_only_a_user_s_macro_can_be_may_move_a_printer() {
    let behind = |options: Options, line: &str| {
        rewritten(scaled(), options, &format!("M83\nG1 X100.1 Y0 Z0 E1\n{line}\nG1 X200.2\n"))[3].clone()
    };
    for line in [
        "SET_POSITION",
        "SET_HOME",
        "SET_UP_PRINT",
        "QUERY_PARK",
        "EXCLUDE_OBJECTS",
        "M1234",
        "M600",
        "M601",
        "M701",
        "M25",
        "M226",
        "M240",
        "PAUSE",
        "M24",
    ] {
        for options in [options(), named(Firmware::Klipper), named(Firmware::Marlin)] {
            assert_eq!(behind(options, line), "G1 X200.2", "{line}");
        }
    }
    for line in ["M0", "M1 wait"] {
        assert_eq!(behind(named(Firmware::Klipper), line), "G1 X200.2", "{line}");
        assert_eq!(behind(named(Firmware::Marlin), line), "G1 X200.0000", "{line}");
    }
    for line in [
        "SET_PRESSURE_ADVANCE ADVANCE=0.04",
        "set_fan_speed FAN=a SPEED=1",
        "SET_VELOCITY_LIMIT ACCEL=3000",
        "M204 S500",
        "EXCLUDE_OBJECT_START NAME=a",
        "BED_MESH_CLEAR",
        "TURN_OFF_HEATERS",
        "M117 G1 X5",
        "M205 X8",
        "M900 K0.1",
        "M106 S255",
        "M73 P5",
        "M400",
    ] {
        assert_eq!(behind(named(Firmware::Klipper), line), "G1 X200.0000", "{line}");
    }
    // Makers of machine tools have their own.
    let mill = "G1 X100.1 Y0 Z0\nM1234\nG1 X200.2\n";
    assert_eq!(rewritten(scaled(), options(), mill)[2], "G1 X200.0000");
}

#[test]
fn a_state_that_klipper_kept_is_taken_up_again() {
    let last = |options: Options, program: &str| {
        let program = format!("M83\nG1 X100.1 Y0 Z0 F600\n{program}\n");
        let outcome = run(scaled(), options, &program).unwrap();
        assert_eq!(outcome.movers, [], "{program}");
        (*outcome.lines().last().unwrap()).to_owned()
    };
    for (program, expected) in [
        // The modes.
        ("SAVE_GCODE_STATE NAME=a\nG90\nRESTORE_GCODE_STATE NAME=a\nG1 X200.2", "G1 X200.0000"),
        ("SAVE_GCODE_STATE\nG91\nG1 Z5\nRESTORE_GCODE_STATE\nG1 X200.2", "G1 X200.0000"),
        ("G91\nSAVE_GCODE_STATE\nG90\nRESTORE_GCODE_STATE MOVE=0\nG1 X100.1", "G1 X100.0000"),
        // The zero: here of the corrected machine X 0 is at 100.
        ("SAVE_GCODE_STATE\nG92 X0\nRESTORE_GCODE_STATE ; MOVE=1\nG1 X200.2", "G1 X200.0000"),
        ("G92 X0\nSAVE_GCODE_STATE\nG92 X50 Y7\nRESTORE_GCODE_STATE\nG1 X100.1", "G1 X100.0000"),
        // The place, with MOVE alone: where the corrected machine was.
        (
            "SAVE_GCODE_STATE\nG1 X300.3 Z9\nRESTORE_GCODE_STATE MOVE=1\nG1 Y99.8",
            "G1 Y100.0000 X100.0000 Z0.0000",
        ),
        ("SAVE_GCODE_STATE\nG1 X300.3 Z9\nRESTORE_GCODE_STATE\nG1 Y99.8", "G1 Y100.0000"),
        // The firmware's own offset, which is not followed.
        ("SAVE_GCODE_STATE\nSET_GCODE_OFFSET Z=5 MOVE=1\nRESTORE_GCODE_STATE\nG1 Y99.8", "G1 Y99.8"),
    ] {
        assert_eq!(last(named(Firmware::Klipper), program), expected, "{program}");
    }
    // E is a position again, and counts from where it was.
    let program =
        "M82\nG92 E5\nG1 X0 Y0 Z0\nSAVE_GCODE_STATE\nM83\nG1 E-2\nRESTORE_GCODE_STATE\nG1 X300 Y300 E7\n";
    let outcome = run(bent("wZbXYt", [0.0; 3]), named(Firmware::Klipper), program).unwrap();
    assert_eq!(outcome.summary.extrusion_in, 0);
    assert_eq!(outcome.summary.extrusion_out, 0);
}

#[test]
fn g92_alone_is_zero_everywhere_to_klipper() {
    let program = "G1 X100.1 Y0 Z5 E3\nG92\nG1 X100.1 E2\n";
    let outcome = run(scaled(), named(Firmware::Klipper), program).unwrap();
    assert_eq!(outcome.lines()[2], "G1 X100.0000 E2");
    assert_eq!(outcome.summary.extrusion_in, 5 * 10_i128.pow(18));
    assert!(run(scaled(), named(Firmware::Marlin), program).is_err());
}

#[test]
fn what_ends_a_correction_of_the_firmware_is_not_told() {
    for line in
        ["SET_SKEW CLEAR=1", "BED_MESH_CLEAR", "BED_MESH_PROFILE SAVE=a", "SKEW_PROFILE REMOVE=a", "M420 S0"]
    {
        assert!(run(scaled(), options(), &format!("{line}\n")).unwrap().warnings.is_empty(), "{line}");
    }
    for line in ["SET_SKEW CLEAR=0 XY=1,2,3", "BED_MESH_OFFSET X=5", "SKEW_PROFILE LOAD=a", "M420 S1"] {
        let outcome = run(scaled(), options(), &format!("{line}\n")).unwrap();
        assert_eq!(outcome.warning_names(), ["firmware-corrects"], "{line}");
    }
}
