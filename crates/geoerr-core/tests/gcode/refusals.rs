//! What is refused, by line, with the line's text and a remedy.

use super::common::{bent, nominal, options, passing, run, run_bytes, scaled};
use geoerr_core::gcode::{Firmware, GcodeError, Options, Unsupported};

fn reason(program: &str) -> Unsupported {
    match run(scaled(), options(), program) {
        Err(GcodeError::Unsupported { what, text, .. }) => {
            assert!(text.starts_with('`') && text.ends_with('`'));
            assert!(!what.remedy().is_empty() && !what.to_string().contains("Some("));
            what
        }
        other => panic!("{program:?}: {other:?}"),
    }
}

#[test]
fn every_unsupported_line_has_its_reason() {
    let here = "G1 X0 Y0 Z0\n";
    let cases: [(&str, Unsupported); 173] = [
        ("G2 X10 I5", Unsupported::Arc { code10: 20 }),
        ("g03 x10 r5", Unsupported::Arc { code10: 30 }),
        ("G2 I5", Unsupported::Arc { code10: 20 }),
        ("G2 F500\nX10 I5", Unsupported::Arc { code10: 20 }),
        ("ARC: G2 X10 I5", Unsupported::Arc { code10: 20 }),
        ("N10 SIDE_1: G41 D1", Unsupported::CutterCompensation { code10: 410 }),
        ("SUPA G0 Z0 G91", Unsupported::CodeBehindName { column: 6 }),
        ("MSG(\"SIDE\") G55", Unsupported::CodeBehindName { column: 13 }),
        ("LIMS=3000 M3", Unsupported::CodeBehindName { column: 11 }),
        ("G5 X10 I5 J5", Unsupported::Spline { code10: 50 }),
        ("G5.2 X10 P1 L3", Unsupported::Spline { code10: 52 }),
        ("G81 X1 Z-5 R2", Unsupported::CannedCycle { code10: 810 }),
        ("G73 X1 Z-5 Q1", Unsupported::CannedCycle { code10: 730 }),
        ("G33 Z-5 K1", Unsupported::Thread { code10: 330 }),
        ("G38.2 Z-5", Unsupported::Probing { code10: 382 }),
        ("G41 D1", Unsupported::CutterCompensation { code10: 410 }),
        ("G42.1 D1 X5", Unsupported::CutterCompensation { code10: 421 }),
        ("G93", Unsupported::InverseTime),
        ("G43.4 H1", Unsupported::ToolPoint { code10: 434 }),
        ("G1 X5 A10", Unsupported::ExtraAxis { letter: b'A' }),
        ("G0 C90", Unsupported::ExtraAxis { letter: b'C' }),
        ("G7", Unsupported::Transformed { code10: 70 }),
        ("G16", Unsupported::Transformed { code10: 160 }),
        ("G51 X2", Unsupported::Transformed { code10: 510 }),
        ("G68 X0 Y0 R45", Unsupported::Transformed { code10: 680 }),
        ("G52 X5", Unsupported::ZeroShift { code10: 520 }),
        ("G92 X5\nG92.1", Unsupported::ZeroShift { code10: 921 }),
        ("G92 X5\nG52 X0 Y0 Z0", Unsupported::ZeroShift { code10: 520 }),
        ("G52", Unsupported::ZeroShift { code10: 520 }),
        ("G92.3", Unsupported::ZeroShift { code10: 923 }),
        ("G10 L20 P1 X0", Unsupported::ZeroShift { code10: 100 }),
        ("G10 P0 X5", Unsupported::ZeroShift { code10: 100 }),
        // The system that holds, or one that is added to all.
        ("G10 L2 P0 X0", Unsupported::ZeroShift { code10: 100 }),
        ("M29 S800 G84 X10 Z2 R5", Unsupported::CannedCycle { code10: 840 }),
        ("M64 P1 Z5", Unsupported::AxisWordsOfM { code: 64 }),
        ("M01 X[#1]", Unsupported::AxisWordsOfM { code: 1 }),
        ("M198 P100", Unsupported::FlowControl),
        ("M623", Unsupported::FlowControl),
        ("M622 J1\nG91\nM623", Unsupported::FlowControl),
        ("G10 L2 P1 R45", Unsupported::ZeroShift { code10: 100 }),
        ("G91\nG10 L2 P1 X1", Unsupported::ZeroShift { code10: 100 }),
        ("G92 X", Unsupported::ZeroShift { code10: 920 }),
        ("G92 Z[#1]", Unsupported::ZeroShift { code10: 920 }),
        ("G10 L2 P1 X{x}", Unsupported::ZeroShift { code10: 100 }),
        ("G92", Unsupported::BareShift),
        ("G56", Unsupported::UnknownSystem { code10: 560 }),
        ("G59.1", Unsupported::UnknownSystem { code10: 591 }),
        ("G91\nG53 G0 X5", Unsupported::MachineIncrement),
        ("G1 X[1+2]", Unsupported::Expression),
        ("#1=5", Unsupported::Expression),
        ("O100 sub", Unsupported::FlowControl),
        ("O100", Unsupported::FlowControl),
        ("M97 P100", Unsupported::FlowControl),
        ("IF[#1000EQ1]GOTO50", Unsupported::FlowControl),
        ("GOTO50", Unsupported::FlowControl),
        ("DO1", Unsupported::FlowControl),
        ("G54.1 P3", Unsupported::UnknownSystem { code10: 541 }),
        ("G154 P3", Unsupported::UnknownSystem { code10: 1540 }),
        ("M70\nG20\nG91\nM72", Unsupported::RestoredState),
        ("M83\nM120\nG91\nG1 Z5\nM121", Unsupported::RestoredState),
        ("SAVE_GCODE_STATE NAME=a\nG20\nRESTORE_GCODE_STATE NAME=a", Unsupported::RestoredState),
        ("RESTORE_GCODE_STATE NAME=nobody", Unsupported::UnknownState),
        ("SAVE_GCODE_STATE NAME=a\nRESTORE_GCODE_STATE NAME=A", Unsupported::UnknownState),
        ("M98 P100", Unsupported::FlowControl),
        ("while iterations < 3", Unsupported::FlowControl),
        // A move beside a dwell: some controls dwell, some dwell and move.
        ("G1 X400 Y400 F600 G4 P1", Unsupported::MoveBesides { code10: 40 }),
        ("G4 P1 G1 X5", Unsupported::MoveBesides { code10: 40 }),
        ("G4 P1 X5", Unsupported::MoveBesides { code10: 40 }),
        ("G4 X1 Y5", Unsupported::MoveBesides { code10: 40 }),
        ("G53 G4 X50", Unsupported::MoveBesides { code10: 40 }),
        ("G28.1 X5", Unsupported::MoveBesides { code10: 281 }),
        // Frames and machine coordinates of Beckhoff's, ISG's and Fagor's controls.
        ("#CS ON [0,0,0,0,0,30]", Unsupported::OtherMeaning),
        ("N10 #ROTATION ON [ANGLE=30]", Unsupported::OtherMeaning),
        ("#mcs on", Unsupported::OtherMeaning),
        ("#TRAFO ON", Unsupported::OtherMeaning),
        ("#PSET X50", Unsupported::OtherMeaning),
        ("#CALL S1", Unsupported::FlowControl),
        // Subprograms of Siemens' and Fadal's.
        ("L100 P3", Unsupported::FlowControl),
        ("N10 L100", Unsupported::FlowControl),
        // Coordinate systems of Fanuc's, GSK's and Okuma's.
        ("G54 P3", Unsupported::UnknownSystem { code10: 541 }),
        ("G40 G54 P3", Unsupported::UnknownSystem { code10: 541 }),
        ("G15 H2", Unsupported::UnknownSystem { code10: 150 }),
        ("G115", Unsupported::UnknownSystem { code10: 1150 }),
        ("G113", Unsupported::UnknownSystem { code10: 1130 }),
        // Edges of Siemens' tools.
        ("D1\nD2", Unsupported::OtherEdge { number: 2 }),
        ("T1 D1\nG1 Z5\nD0\nG1 Z6", Unsupported::OtherEdge { number: 0 }),
        ("G43 H1\nG49\nG1 Z5", Unsupported::OtherToolLength { code10: 490 }),
        // The lengths of Siemens' tools: of one that is changed by T, or put in by M6.
        ("T1 D1\nG1 Z5\nT2 D1", Unsupported::LengthOfOtherTool),
        ("T1 D1\nT2 D2", Unsupported::LengthOfOtherTool),
        ("T1 D1\nT2\nG1 Z5", Unsupported::LengthOfOtherTool),
        ("T1 M6\nD1\nT2 M6\nG1 Z5", Unsupported::LengthOfOtherTool),
        ("T1 M6\nD1\nT2\nG1 Z5\nM6\nD1", Unsupported::LengthOfOtherTool),
        ("D1\nT2 D1", Unsupported::LengthOfOtherTool),
        ("T=\"MILL 10\" D1\nT=\"MILL 8\"\nD1", Unsupported::LengthOfOtherTool),
        ("T1 G17 S5000\nT2 G17 S2000", Unsupported::LengthOfOtherTool),
        // What a controller computes may be any tool, edge or length.
        ("T1 D1\nG1 Z5\nT=R1 D1\nG1 Z6", Unsupported::LengthOfOtherTool),
        ("T1 D1\nG1 Z5\nT#1 D1\nG1 Z6", Unsupported::LengthOfOtherTool),
        ("T1 D1\nG1 Z5\nT=R1\nG1 Z6", Unsupported::LengthOfOtherTool),
        ("T=R1 D1\nG1 Z5\nT=R1 D1\nG1 Z6", Unsupported::LengthOfOtherTool),
        ("T=R1 D1\nG1 Z5\nT1 D1\nG1 Z6", Unsupported::LengthOfOtherTool),
        ("T1 M6\nD1\nG1 Z5\nT=R1 M6\nD1\nG1 Z6", Unsupported::LengthOfOtherTool),
        ("T=R1 G17 S5000\nG1 Z5\nT2 G17 S2000", Unsupported::LengthOfOtherTool),
        ("T1 D1\nG1 Z5\nD=R2\nG1 Z6", Unsupported::OtherEdge { number: u32::MAX }),
        ("D=R2\nG1 Z5\nD=R2\nG1 Z6", Unsupported::OtherEdge { number: u32::MAX }),
        ("T1 M6\nG43 H1\nG1 Z5\nG43 H#3 Z6", Unsupported::OtherToolLength { code10: 430 }),
        ("T1 M6\nG43 H1\nG1 Z5\nG43 H=R3 Z6", Unsupported::OtherToolLength { code10: 430 }),
        ("T1 M6 G43\nG1 Z5\nT#2 M6\nG43", Unsupported::OtherToolLength { code10: 430 }),
        ("G43 H#3\nG1 Z5\nG43 H#3\nG1 Z6", Unsupported::OtherToolLength { code10: 430 }),
        ("G43 H1\nG1 Z5\nH#3\nG1 Z6", Unsupported::OtherToolLength { code10: 430 }),
        ("G17 G54 D1\nG90 D2", Unsupported::OtherEdge { number: 2 }),
        ("G0 Z5 D1\nG0 G40 Z6 D2", Unsupported::OtherEdge { number: 2 }),
        // Inches to Siemens' and Heidenhain's controls, and a cycle to others.
        ("G70 G90 G54", Unsupported::UnitOrCycle { code10: 700 }),
        ("G20\nG71", Unsupported::UnitOrCycle { code10: 710 }),
        ("G20\nG71 G1 X5 D1", Unsupported::UnitOrCycle { code10: 710 }),
        ("G70 P10 Q20", Unsupported::CannedCycle { code10: 700 }),
        ("G71 U2 R1", Unsupported::CannedCycle { code10: 710 }),
        ("G3 Z0.6 I1.217 J0 P1", Unsupported::Helix { code10: 30 }),
        ("G0 X5 G80", Unsupported::TwoMotionCodes),
        ("G1 X5 X6", Unsupported::RepeatedWord { letter: b'X' }),
        ("G1 X Y5", Unsupported::MissingNumber { letter: b'X' }),
        ("G1 X5 R2", Unsupported::OddWord { letter: b'R' }),
        ("G1 X5 H1", Unsupported::OddWord { letter: b'H' }),
        ("G1 X--5", Unsupported::Unreadable { column: 5 }),
        // What stands behind = on Siemens' controls.
        ("G1 X=IC(10)", Unsupported::OwnMode { letter: b'X' }),
        ("G1 Y=ac(10) F500", Unsupported::OwnMode { letter: b'Y' }),
        ("G1 X=R1", Unsupported::Expression),
        ("G1 X=5+3", Unsupported::Expression),
        ("G1 X=5*3", Unsupported::Expression),
        ("G1 X=5 X=6", Unsupported::RepeatedWord { letter: b'X' }),
        // A feed a tooth, and a numbered axis.
        ("G1 X5 FZ=0.1", Unsupported::Unreadable { column: 9 }),
        ("G1 X1=5", Unsupported::Unreadable { column: 6 }),
        ("/G1 X5", Unsupported::BlockSkip),
        // One of several switches, or behind the line's number.
        ("/1 G1 X5", Unsupported::BlockSkip),
        ("N40 /G1 X5", Unsupported::BlockSkip),
        ("/G91", Unsupported::BlockSkipOfMode),
        ("/1 G91", Unsupported::BlockSkipOfMode),
        ("/2G91", Unsupported::BlockSkipOfMode),
        ("/ 3 G20", Unsupported::BlockSkipOfMode),
        ("N40 /9 G92 X0", Unsupported::BlockSkipOfMode),
        ("/1 N40 G55", Unsupported::BlockSkipOfMode),
        // Words of other controls that change what coordinates are.
        ("TRANS X100 Y100", Unsupported::OtherMeaning),
        ("N10 ATRANS Z5", Unsupported::OtherMeaning),
        ("ROT RPL=30", Unsupported::OtherMeaning),
        ("amirror X0", Unsupported::OtherMeaning),
        ("CYCLE800(1,\"T\")", Unsupported::OtherMeaning),
        ("G107 C50", Unsupported::OtherMeaning),
        ("$P_UIFR[1,X,TR]=50", Unsupported::OtherMeaning),
        ("N10 $p_pframe=CTRANS(X,5)", Unsupported::OtherMeaning),
        ("$TC_DP3[1,1]=80", Unsupported::OtherMeaning),
        ("BSPLINE X5 Y5", Unsupported::OtherMeaning),
        ("N90 GOTOF ENDE", Unsupported::FlowControl),
        ("EXTCALL \"SUB\"", Unsupported::FlowControl),
        ("REPEAT LABEL1 P=3", Unsupported::FlowControl),
        ("VZOFX[1]=50", Unsupported::OtherMeaning),
        // NUM's controls move in machine coordinates, Heidenhain's with M91.
        ("G0 G52 Z0", Unsupported::ZeroShift { code10: 520 }),
        ("N40 G00 G40 G90 Z+0 M91", Unsupported::MachinePlaceByM { code: 91 }),
        ("X5 M92", Unsupported::MachinePlaceByM { code: 92 }),
        // A code of the machine's maker beside a move.
        ("M101 X5", Unsupported::AxisWordsOfM { code: 101 }),
        // LinuxCNC takes the length of the tool in use, and Fanuc that of H alone.
        ("T1 M6 G43\nG0 Z5\nG43 T2 M6", Unsupported::OtherToolLength { code10: 430 }),
        ("G43 H1\nG0 Z5\nH2", Unsupported::OtherToolLength { code10: 430 }),
        ("G43 H1\nG0 Z5\nH0\nG0 Z6", Unsupported::OtherToolLength { code10: 430 }),
        ("G43 H1\nH0\nH2\nG1 Z6", Unsupported::OtherToolLength { code10: 430 }),
        // H alone takes up what H0 ended, and not what G49 did.
        ("G43 H1\nG49\nH1\nG1 Z5", Unsupported::OtherToolLength { code10: 490 }),
        ("G43 H1\nG49\nH0\nH1\nG1 Z5", Unsupported::OtherToolLength { code10: 490 }),
        ("G43 H1\nH0\nG49\nH1\nG1 Z5", Unsupported::OtherToolLength { code10: 490 }),
        ("G12.1", Unsupported::Transformed { code10: 121 }),
        ("G112", Unsupported::Transformed { code10: 1120 }),
        ("G500", Unsupported::UnknownSystem { code10: 5000 }),
        ("1 L X+10 Y+10 Z+50 R0 FMAX", Unsupported::PlainText),
        ("0 BEGIN PGM PART MM", Unsupported::PlainText),
        ("G01 X+5 Y+5 F500 *", Unsupported::BlockEnd),
        ("G1 X5*71", Unsupported::Checksum),
        ("G1234 X5", Unsupported::UnknownCode { code10: 12340 }),
    ];
    for (program, expected) in cases {
        assert_eq!(reason(&format!("{here}{program}\n")), expected, "{program}");
        run(scaled(), passing(), &format!("{here}{program}\nG1 X100.1\n")).unwrap();
    }
    assert_eq!(reason("X5 Y5 Z5\n"), Unsupported::NoMotionCode);
    assert_eq!(reason("G92 X0 G28 Y0\n"), Unsupported::TwoOwners);
    assert_eq!(reason("G1 G2 X5\n"), Unsupported::TwoMotionCodes);
    assert_eq!(reason("N1 G1 X5 Y5 Z5*33\n"), Unsupported::Checksum);
}

#[test]
fn what_belongs_to_the_end_of_a_move_is_not_said_at_the_end_of_its_first_piece() {
    let here = "G1 X0 Y0 Z0\n";
    let stop = |letter, code10| Unsupported::StopOnMove { letter, code10 };
    for (program, expected) in [
        ("G1 X300 Y300 F1000 M30", stop(b'M', 300)),
        ("G1 X300 Y300 M0", stop(b'M', 0)),
        ("X300 Y300 M1", stop(b'M', 10)),
        ("G9 G1 X300 Y300", stop(b'G', 90)),
        ("G1 X300 Y300 F600 M5", stop(b'M', 50)),
        ("G1 X300 Y300 S500 M3 M9", stop(b'M', 90)),
        ("G1 X300 Y300 M19", stop(b'M', 190)),
        ("G1 X300 Y300 M400", stop(b'M', 4000)),
        ("T0\nG1 X1 E5\nT1\nG1 X1 Y1 Z1\nG1 X300 Y300 E7", Unsupported::ExtruderLost),
        ("G1 X1 E5\nT1\nG1 X1 Y1 Z1\nG1 X300 Y300 E7", Unsupported::ExtruderLost),
        ("ACTIVATE_EXTRUDER EXTRUDER=e1\nG1 X1 Y1 Z1\nG1 X300 Y300 E7", Unsupported::ExtruderLost),
    ] {
        let program = format!("{here}{program}\n");
        let refused = run(bent("wZbXYt", [0.0; 3]), options(), &program).unwrap_err();
        assert!(matches!(refused, GcodeError::Unsupported { what, .. } if what == expected), "{refused:?}");
        // In one piece it may pass.
        let passed = run(bent("wZbXYt", [0.0; 3]), passing(), &program).unwrap();
        let warning = passed.warnings.iter().find(|warning| warning.kind.name() == "not-split").unwrap();
        assert!(warning.kind.explanation().starts_with(&expected.to_string()), "{program}");
    }
    assert!(
        stop(b'G', 90).to_string().contains("G9 on its line") && stop(b'M', 50).to_string().contains("M5")
    );
    for program in [
        "G1 X300 Y300\nM30\n",
        "T0\nG1 X1 E5\nT1\nG92 E0\nG1 X1 Y1 Z1\nG1 X300 Y300 E7\n",
        "G1 X300 Y300 F1000 M3 M8\n",
        // In a rapid nothing is cut.
        "G0 X300 Y300 M5\n",
        "G0\nX300 Y300 M9\n",
    ] {
        assert!(run(bent("wZbXYt", [0.0; 3]), options(), &format!("{here}{program}")).is_ok(), "{program}");
    }
}

#[test]
fn klipper_has_no_inches() {
    let klipper = Options { firmware: Some(Firmware::Klipper), ..options() };
    let program = "G1 X0 Y0 Z0\nG20\nG1 X5\nG21\nG1 X300\n";
    let refused = run(scaled(), klipper.clone(), program).unwrap_err();
    assert!(
        matches!(refused, GcodeError::Unsupported { line: 2, what: Unsupported::NoInches, .. }),
        "{refused:?}"
    );
    // It stops there: nothing behind is corrected.
    let passed = run(scaled(), Options { firmware: Some(Firmware::Klipper), ..passing() }, program).unwrap();
    assert_eq!(passed.text(), program);
    assert_eq!((passed.summary.untouched_unsupported, passed.summary.lines_not_followed), (1, 3));
    for options in [options(), Options { firmware: Some(Firmware::Marlin), ..options() }] {
        assert!(run(scaled(), options, program).is_ok());
    }
    assert!(run(scaled(), klipper, "G21\nG1 X0 Y0 Z0\nG1 X5\n").is_ok());
}

#[test]
fn modes_that_are_taken_up_again_as_they_are_change_nothing() {
    let here = "G90\nG1 X0 Y0 Z0\n";
    for program in [
        "M70\nG91\nG1 X5\nG90\nM72\nG1 X50\n",
        "M120\nG91\nG1 Z5\nG90\nM121\nG1 X50\n",
        "SAVE_GCODE_STATE NAME=a\nG91\nG1 X5\nG90\nRESTORE_GCODE_STATE NAME=a\nG1 X50 Y0 Z0\n",
        "M121\nM72\nG1 X50\n",
    ] {
        assert!(run(scaled(), options(), &format!("{here}{program}")).is_ok(), "{program}");
    }
    // Messages and endstops, of firmwares that have these numbers for them.
    let marlin = Options { firmware: Some(Firmware::Marlin), ..options() };
    assert!(run(scaled(), marlin, &format!("{here}M120\nM70\nG91\nM121\nM72\nG1 X50\n")).is_ok());
    // The position of the extruder is what it was, and the machine may be elsewhere.
    let klipper = Options { firmware: Some(Firmware::Klipper), ..options() };
    let program =
        "G1 X10 E5\nSAVE_GCODE_STATE\nG92 E0\nG1 E-2\nRESTORE_GCODE_STATE\nG1 X0 Y0 Z0\nG1 X300 E20\n";
    let outcome = run(bent("wZbXYt", [0.0; 3]), klipper, &format!("{here}{program}")).unwrap();
    let ends_mm: Vec<f64> = std::str::from_utf8(&outcome.bytes)
        .unwrap()
        .lines()
        .filter(|line| line.starts_with("G1"))
        .filter_map(|line| line.split_once(" E")?.1.trim().parse().ok())
        .collect();
    assert_eq!((ends_mm[0], ends_mm[1], *ends_mm.last().unwrap()), (5.0, -2.0, 20.0));
    assert!(ends_mm[2..].windows(2).all(|pair| pair[1] > pair[0]) && ends_mm[2] > 5.0, "{ends_mm:?}");
}

#[test]
fn the_number_of_a_program_is_its_name() {
    let program = "%\nO1234 (PART)\nN10 G90\nG1 X0 Y0 Z0\nG1 X50\nM30\n%\n";
    let outcome = run(scaled(), options(), program).unwrap();
    assert_eq!(outcome.summary.moves_corrected, 2);
    let again = run(scaled(), options(), "O1\nG1 X0 Y0 Z0\nM99\nO2\nG1 X5\n").unwrap_err();
    assert!(matches!(again, GcodeError::Unsupported { line: 3, what: Unsupported::FlowControl, .. }));
}

#[test]
fn codes_that_do_nothing_here_pass() {
    let here = "G1 X0 Y0 Z0\n";
    for line in [
        "G52 X0 Y0 Z0",
        "G92.1",
        "G92.2",
        "G0 G17 G40 G49 G80 G90",
        "G80 G0 X5",
        "G4 X100",
        "G1 G4 P1",
        "G17 G40 G54 G64 P0.01",
        "G43 H1 Z5\nG49\nM30",
        "G43 H1 Z5\nG49\nG43 H1\nG1 Z6",
        "T1 D1\nD1\nG1 Z5",
        "G43 H1\nD21\nG1 Z5",
        "D0",
        "T1 M6 G43\nT2\nG43\nG1 Z5",
        "G43 H1\nH1\nG1 Z5",
        "G43 H1\nG1 Z5\nH0\nH1\nG1 Z6",
        "G43 H#3\nG1 Z5",
        "T=R1 D1\nG1 Z5\nD1\nG1 Z6",
        "T#1 M6 G43\nG1 Z5\nG43\nG1 Z6",
        "G43 H1\nG1 Z5\nT=R1 M6\nG1 X0 Y0 Z5\nG43 H1\nG1 Z6",
        "G43 H1 Z5\nG49 H0\nM30",
        "T1 M6\nD1\nT2\nD1\nG1 Z5",
        "T1 D1\nT1\nM6\nD1\nG1 Z5",
        "T1 D1\nT2\nT1 D1\nG1 Z5",
        "G43 H1\nT1 D1\nT2 D1\nG1 Z5",
        "G96 D2500 S200\nG97 D1 S300",
        "T=\"MILL 10\" D1\nT=\"Mill 10\"\nG1 Z5",
        "#HSC ON",
        "#Layer 3",
    ] {
        let outcome = run(scaled(), options(), &format!("{here}{line}\n")).unwrap();
        assert!(!outcome.warning_names().contains(&"may-move"), "{line}");
    }
    // An output says nothing of places, and may move all the same; where another nozzle is moves the zero.
    for (line, warning) in [
        ("$A_OUT[1]=1", "may-move"),
        ("M125", "may-move"),
        ("M140 MB50", "may-move"),
        ("M218 T1 X20", "zero-moves"),
    ] {
        let outcome = run(scaled(), options(), &format!("{here}{line}\n")).unwrap();
        assert_eq!(outcome.warning_names(), [warning], "{line}");
    }
    // The G0 before G80 holds on.
    let moved = run(scaled(), options(), &format!("{here}G0 G17 G80\nX100.1\n")).unwrap();
    assert_eq!(moved.lines()[2], "X100.0000 Y0.0000 Z0.0000");
    // Where L repeats a cycle it is no call, and to a printer # begins a comment.
    let cycle = run(scaled(), passing(), &format!("{here}G81 Z-5 R2\nL3\nG80\n{here}G1 X100.1\n")).unwrap();
    assert_eq!(cycle.lines().last(), Some(&"G1 X100.0000 Y0.0000 Z0.0000"));
    let printer = Options { firmware: Some(Firmware::RepRapFirmware), ..options() };
    assert!(run(scaled(), printer, &format!("{here}#CS ON\nG1 X5\n")).is_ok());
    assert!(
        run(scaled(), options(), &format!("{here}#Face mill 50\n#Rotation of the vice\nG1 X5\n")).is_ok()
    );
}

#[test]
fn behind_what_may_be_inches_nothing_is_corrected() {
    let program = "G1 X0 Y0 Z0\nG70 G90\nG1 X4 Y1 Z1\nG1 X5\n";
    let outcome = run(scaled(), passing(), program).unwrap();
    assert_eq!((outcome.text(), outcome.summary.lines_not_followed), (program, 2));
    let refused = run(scaled(), options(), program).unwrap_err();
    assert!(refused.to_string().contains("G70 is inches for some controls and a canned cycle for others"));
    assert!(refused.remedy().contains("G20"));
}

#[test]
fn millimetres_where_millimetres_hold_are_no_matter() {
    for program in ["G17 G54 G64 G90 G71 G94\nG1 X0 Y0 Z0 F500\nG1 X5\n", "G1 X0 Y0 Z0\nG71 G1 X5\n"] {
        let (outcome, siemens) = (run(scaled(), options(), program).unwrap(), program.replace("G71", "G710"));
        assert_eq!(outcome.text(), run(scaled(), options(), &siemens).unwrap().text().replace("G710", "G71"));
        assert_eq!(outcome.summary.moves_corrected, 2);
    }
}

#[test]
fn the_reason_that_leaves_least_known_counts() {
    // A cycle under inverse time: where it ends is the cycle's affair.
    assert_eq!(reason("G93 G81 X1 Z-5 R2\n"), Unsupported::CannedCycle { code10: 810 });
}

#[test]
fn messages_name_line_text_and_remedy() {
    let error = run(scaled(), options(), "G28\n; arc\n  G2 X10 Y5 I5 ; \u{e9}\n").unwrap_err();
    assert_eq!(error.line(), 3);
    assert_eq!(error.to_string(), r"`G2 X10 Y5 I5 ; \xc3\xa9`: an arc (G2) is not corrected yet");
    assert!(error.remedy().contains("--on-unsupported pass"));
}

#[test]
fn the_machine_s_range_is_kept() {
    let outside = run(scaled(), options(), "G1 X0 Y0 Z0\nG1 X420.1\n").unwrap_err();
    assert!(matches!(outside, GcodeError::OutsideRange { line: 2, axis: 'X', .. }), "{outside:?}");
    let early = run(scaled(), options(), "G28\nG1 Z-21\n").unwrap_err();
    assert!(matches!(early, GcodeError::OutsideRange { line: 2, axis: 'Z', .. }), "{early:?}");
    // Y 420 is reached at 420.84.
    let command = run(scaled(), options(), "G1 X0 Y0 Z0\nG1 Y420\n").unwrap_err();
    assert!(matches!(command, GcodeError::CommandOutsideRange { line: 2, axis: 'Y', .. }), "{command:?}");
    // Corrected to 420.00003, which is printed as 420; 420.00007 is not.
    assert!(run(scaled(), options(), "G1 X0 Y0 Z0\nG1 Y419.16002994\n").is_ok());
    let beyond = run(scaled(), options(), "G1 X0 Y0 Z0\nG1 Y419.16006986\n").unwrap_err();
    assert!(matches!(beyond, GcodeError::CommandOutsideRange { line: 2, axis: 'Y', .. }), "{beyond:?}");
    let passed = run(scaled(), passing(), "G1 X0 Y0 Z0\nG2 X430 I215\n").unwrap_err();
    assert!(matches!(passed, GcodeError::OutsideRange { line: 2, .. }), "{passed:?}");
    assert!(run(nominal(), options(), "G1 X420 Y-20 Z0\n").is_ok());
}

#[test]
fn outside_the_measured_range_is_refused_or_held() {
    let measured = Options { measured_mm: [(0.0, 300.0), (0.0, 300.0), (0.0, 300.0)], ..options() };
    let program = "G28\nG1 Z310\nG1 X0 Y0 Z0\nG1 X310\nG1 X315\n";
    let refused = run(scaled(), measured.clone(), program).unwrap_err();
    assert!(matches!(refused, GcodeError::OutsideMeasured { line: 4, axis: 'X', .. }), "{refused:?}");
    let held = Options { holds_outside_measured: true, ..measured };
    let outcome = run(scaled(), held, program).unwrap();
    let warning = outcome.warnings.iter().find(|warning| warning.kind.name() == "outside-measured").unwrap();
    assert_eq!((warning.line, warning.count), (4, 2));
    let measured = Options { measured_mm: [(0.0, 300.0); 3], holds_outside_measured: true, ..options() };
    let both = run(scaled(), measured, "G1 X310 Y421 Z0\n").unwrap_err();
    assert!(matches!(both, GcodeError::OutsideRange { axis: 'Y', .. }), "{both:?}");
}

#[test]
fn a_program_is_never_corrected_twice() {
    let once = run(bent("wbXYZt", [0.0; 3]), options(), "G28\nG1 X10 Y10 Z10\nG1 X20\n").unwrap();
    let twice = run(bent("wbXYZt", [0.0; 3]), options(), once.text()).unwrap_err();
    assert!(matches!(twice, GcodeError::AlreadyCorrected { line: 2, .. }), "{twice:?}");
    assert!(run(nominal(), options(), once.text()).is_err());
}

#[test]
fn what_is_no_text_is_refused() {
    let refuse = |bytes: &[u8]| run_bytes(scaled(), options(), &[bytes]).unwrap_err();
    assert_eq!(refuse(b"GCDE\x01\x00\x00"), GcodeError::Binary);
    assert_eq!(refuse(b"G28\nG1 X\0"), GcodeError::NulByte { line: 2 });
    let endless = vec![b'1'; (1 << 20) + 1];
    assert!(matches!(refuse(&endless), GcodeError::LineTooLong { line: 1, .. }));
}

#[test]
fn the_first_line_that_cannot_be_done_is_named() {
    // Line 3 fails when it is solved, line 4 when it is read: whatever comes first in the program counts.
    let error = run(scaled(), options(), "G28\nG1 X0 Y0 Z0\nG1 Y420\nG2 X5 I5\n").unwrap_err();
    assert_eq!(error.line(), 3);
}

#[test]
fn options_that_make_no_sense() {
    for bad in [
        Options { tolerance_mm: 0.0, ..options() },
        Options { tolerance_mm: f64::NAN, ..options() },
        Options { digits: 0, ..options() },
        Options { digits: 10, ..options() },
        Options { work_offset_mm: Some([f64::INFINITY, 0.0, 0.0]), ..options() },
    ] {
        assert!(matches!(run(scaled(), bad, ""), Err(GcodeError::Option { .. })));
    }
    let coarse = Options { digits: 2, ..options() };
    let error = run(scaled(), coarse, "G28\nG1 X10 Y0 Z0\n").unwrap_err();
    assert!(matches!(error, GcodeError::TooFewDigits { line: 2, digits: 2, .. }), "{error:?}");
}

#[test]
fn a_system_that_nobody_set_is_not_told_to_set_another() {
    let refused = reason("G90\nG55\nG0 X5\n");
    assert_eq!(refused, Unsupported::UnknownSystem { code10: 550 });
    assert!(refused.remedy().contains("G10 L2 P2 X Y Z for G55"));
    assert!(refused.remedy().contains("work in G54, whose place is --work-offset"));
}
