//! What is refused, by line, with the line's text and a remedy.

use super::common::{bent, nominal, options, passing, run, run_bytes, scaled};
use geoerr_core::gcode::{GcodeError, Options, Unsupported};

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
    let cases: [(&str, Unsupported); 45] = [
        ("G2 X10 I5", Unsupported::Arc { code10: 20 }),
        ("g03 x10 r5", Unsupported::Arc { code10: 30 }),
        ("G2 I5", Unsupported::Arc { code10: 20 }),
        ("G2 F500\nX10 I5", Unsupported::Arc { code10: 20 }),
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
        ("G92.1", Unsupported::ZeroShift { code10: 921 }),
        ("G10 L20 P1 X0", Unsupported::ZeroShift { code10: 100 }),
        ("G10 P0 X5", Unsupported::ZeroShift { code10: 100 }),
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
        ("M98 P100", Unsupported::FlowControl),
        ("while iterations < 3", Unsupported::FlowControl),
        ("G1 X5 X6", Unsupported::RepeatedWord { letter: b'X' }),
        ("G1 X Y5", Unsupported::MissingNumber { letter: b'X' }),
        ("G1 X5 R2", Unsupported::OddWord { letter: b'R' }),
        ("G1 X5 H1", Unsupported::OddWord { letter: b'H' }),
        ("G1 X--5", Unsupported::Unreadable { column: 5 }),
        ("/G1 X5", Unsupported::BlockSkip),
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
        Options { work_offset_mm: [f64::INFINITY, 0.0, 0.0], ..options() },
    ] {
        assert!(matches!(run(scaled(), bad, ""), Err(GcodeError::Option { .. })));
    }
    let coarse = Options { digits: 2, ..options() };
    let error = run(scaled(), coarse, "G28\nG1 X10 Y0 Z0\n").unwrap_err();
    assert!(matches!(error, GcodeError::TooFewDigits { line: 2, digits: 2, .. }), "{error:?}");
}
