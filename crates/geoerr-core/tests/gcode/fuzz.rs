//! Arbitrary bytes and soups of words: no panic, and what passes passes whole.

use super::common::{bent, nominal, options, passing, run_bytes};
use proptest::prelude::*;

/// Lines made of words that mean something, in any combination.
fn soup() -> impl Strategy<Value = String> {
    let number = prop_oneof![
        (-50.0_f64..450.0).prop_map(|x| format!("{x:.3}")),
        Just(String::new()),
        Just("5".to_owned()),
        Just("[1+2]".to_owned()),
        Just("{depth}".to_owned()),
        Just("#1".to_owned()),
        Just("-.".to_owned()),
    ];
    let letter = proptest::sample::select(b"XYZEFIJKRABCPLSTNHDO".to_vec());
    let word = (letter, number).prop_map(|(letter, number)| format!("{}{number}", char::from(letter)));
    let code = proptest::sample::select(vec![
        "G0", "G1", "G2", "G3", "G4", "G5", "G10", "G17", "G20", "G21", "G28", "G29", "G33", "G38.2", "G40",
        "G41", "G43", "G49", "G52", "G53", "G54", "G55", "G60", "G61", "G68", "G69", "G80", "G81", "G90",
        "G91", "G92", "G92.1", "G93", "G94", "M6", "M82", "M83", "M84", "M98", "M117", "T1", "%", "/", ";",
        "(a)", "(", "*12", "PARK", "L2 P1", "g1", "N5",
    ]);
    let part = prop_oneof![3 => word, 2 => code.prop_map(str::to_owned)];
    let line = proptest::collection::vec(part, 0..6).prop_map(|parts| parts.join(" "));
    let ordinary = (-10.0_f64..400.0, -10.0_f64..400.0, 0.0_f64..400.0)
        .prop_map(|(x, y, z)| format!("G1 X{x:.2} Y{y:.2} Z{z:.2} E1"));
    let end = proptest::sample::select(vec!["\n", "\r\n", "\r"]);
    let ended = (prop_oneof![line, ordinary], end).prop_map(|(line, end)| format!("{line}{end}"));
    proptest::collection::vec(ended, 0..12).prop_map(|lines| lines.concat())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_bytes_are_rewritten_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        let _ = run_bytes(bent("wXbYZt", [0.0; 3]), passing(), &[&bytes]);
        let _ = run_bytes(bent("wXbYZt", [0.0; 3]), options(), &[&bytes]);
    }

    #[test]
    fn any_words_are_rewritten_or_refused(program in soup()) {
        let _ = run_bytes(bent("wXbYZt", [0.0; 3]), options(), &[program.as_bytes()]);
        if let Ok(outcome) = run_bytes(bent("wXbYZt", [0.0; 3]), passing(), &[program.as_bytes()]) {
            let summary = outcome.summary;
            prop_assert!(summary.moves_out >= summary.moves_in);
            prop_assert_eq!(summary.extrusion_in, summary.extrusion_out);
            // What is no straight move comes out as it went in.
            let is_straight = |line: &&str| line.contains("G1 ") || line.contains("G0 ") || line.contains("g1 ");
            let kept = |text: &str| {
                let is_mark = |line: &str| line.contains("corrected by geoerr");
                let lines = text.split(['\n', '\r']).filter(|line| !line.is_empty() && !is_mark(line));
                lines.filter(|line| !is_straight(line) && !line.contains(['X', 'Y', 'Z', 'x'])).map(str::to_owned)
                    .collect::<Vec<_>>()
            };
            let written = String::from_utf8(outcome.bytes).unwrap();
            prop_assert_eq!(kept(&program), kept(&written));
        }
    }

    #[test]
    fn without_errors_nothing_changes(program in soup()) {
        if let Ok(outcome) = run_bytes(nominal(), passing(), &[program.as_bytes()]) {
            prop_assert_eq!(outcome.bytes, program.into_bytes());
        }
    }

    #[test]
    fn cutting_the_stream_changes_nothing(program in soup(), cut in 0.0_f64..1.0) {
        let bytes = program.as_bytes();
        let (head, tail) = bytes.split_at((bytes.len() as f64 * cut) as usize);
        let machine = || bent("wYbXZt", [3.0, 0.0, -40.0]);
        prop_assert_eq!(
            run_bytes(machine(), passing(), &[bytes]),
            run_bytes(machine(), passing(), &[head, b"", tail])
        );
    }
}
