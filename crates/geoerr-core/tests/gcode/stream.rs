//! The stream: several blocks under way at a time, and what that must not change.

use super::common::{Outcome, RANGE_MM, bent, options, passing, run, run_bytes};
use geoerr_core::gcode::{Firmware, GcodeError, Options, Rewriter};
use proptest::prelude::*;
use std::fmt::Write as _;

/// Some thousand lines: short moves, long ones that are split, other lines, changes of mode.
fn program(n_moves: u32) -> String {
    let mut text = String::from("M83\nG1 X100 Y100 Z5 F3000\n");
    for i in 0..n_moves {
        let turn = f64::from(i) * 0.013;
        let (x, y) = (200.0 + 150.0 * turn.sin(), 200.0 + 150.0 * (1.7 * turn).cos());
        match i % 97 {
            13 => text += ";TYPE:Perimeter\n",
            20 => text += "G92 E0\r\n",
            31 => text += "G91\nG1 X.5 Y-.25\nG90\n",
            47 => text += "G20\n",
            52 => text += "G21\n",
            60 => text += "G1 X20 Y380\n",
            80 => text += "M204 S800\n",
            _ => {}
        }
        let unit = if (47..52).contains(&(i % 97)) { 25.4 } else { 1.0 };
        let _ = writeln!(text, "G1 X{:.4} Y{:.4} E.0123", x / unit, y / unit);
    }
    text
}

fn in_chunks(program: &str, chunk_bytes: usize) -> Outcome {
    let chunks: Vec<&[u8]> = program.as_bytes().chunks(chunk_bytes).collect();
    run_bytes(bent("wZbXYt", [0.0; 3]), passing(), &chunks).unwrap()
}

#[test]
fn how_the_program_comes_in_changes_nothing() {
    let program = program(6_000);
    let whole = run(bent("wZbXYt", [0.0; 3]), passing(), &program).unwrap();
    assert!(whole.summary.moves_out > whole.summary.moves_in);
    for chunk_bytes in [997, 4_096, 50_000] {
        assert!(in_chunks(&program, chunk_bytes) == whole, "{chunk_bytes} bytes at a time");
    }
}

#[test]
fn plain_lines_and_lines_that_only_the_lexer_reads_are_one_program() {
    let program = program(3_000);
    // A blank behind the letter means the same, and is not plain.
    let spaced = program.replace("G1 X", "G1  X ").replace(" Y", " Y ");
    let machine = || bent("wbXYZt", [1.0, -2.0, 3.0]);
    let (plain, lexed) =
        (run(machine(), passing(), &program).unwrap(), run(machine(), passing(), &spaced).unwrap());
    let mut summary = lexed.summary;
    summary.lines = plain.summary.lines;
    assert_eq!(plain.summary, summary);
    let squeezed = |text: &str| text.replace(' ', "");
    assert_eq!(squeezed(plain.text()), squeezed(lexed.text()));
}

/// Lines that change what a usual move means, or end a run of them.
const OTHER_LINES: [&str; 32] = [
    "G90",
    "G91",
    "G90",
    "G20",
    "G21",
    "G92 X5 Y5",
    "G92 Z1",
    "G92.1",
    "G92 E0",
    "M82",
    "M83",
    "G54",
    "G55",
    "G53 G0 X9 Y9",
    "G28",
    "G28 X",
    "G68 R5",
    "G69",
    "G41 D1",
    "G40",
    "G93",
    "G94",
    "T1",
    "M220 S50",
    "; a comment",
    "(another)",
    "O1234",
    "G1 Z3 F600",
    "G0 X5 Y6",
    "G1 X7 Y8 F900",
    "G2 X1 Y1 I1",
    "%",
];

fn line() -> impl Strategy<Value = String> {
    let number = || prop_oneof![20 => 0_i32..400_000, 1 => -40_000_i32..460_000];
    let usual = (number(), number(), proptest::option::of(-900_i32..9_000)).prop_map(|(x, y, e)| {
        let number = |thousandths: i32| f64::from(thousandths) / 1000.0;
        let e = e.map_or(String::new(), |e| format!(" E{}", number(e)));
        format!("G1 X{} Y{}{e}", number(x), number(y))
    });
    prop_oneof![8 => usual, 1 => proptest::sample::select(&OTHER_LINES[..]).prop_map(str::to_owned)]
}

proptest! {
    #[test]
    fn a_run_of_usual_moves_means_what_its_lines_mean(
        lines in proptest::collection::vec(line(), 1..60),
        begin in prop_oneof![Just("G90\nM83\nG1 X100 Y100 Z5 F3000\n"), Just("")],
        firmware in prop_oneof![Just(None), Just(Some(Firmware::Klipper)), Just(Some(Firmware::Marlin))],
        refuses in any::<bool>(),
    ) {
        let program = format!("{begin}{}\n", lines.join("\n"));
        // A blank behind the letter means the same, and is not usual.
        let spaced = program.replace("G1 X", "G1  X ");
        let told = |program: &str| {
            let options = Options { firmware, ..if refuses { options() } else { passing() } };
            format!("{:?}", run(bent("wZbXYt", [0.0; 3]), options, program).map(|outcome| {
                (outcome.text().to_owned(), outcome.summary, outcome.warnings, outcome.movers)
            })).replace(' ', "")
        };
        prop_assert_eq!(told(&program), told(&spaced));
    }
}

#[test]
fn what_is_before_a_refused_line_comes_out_first() {
    let program = program(5_000);
    let machine = || bent("wZbXYt", [0.0; 3]);
    let options = || Options { firmware: Some(Firmware::RepRapFirmware), ..options() };
    let before = run(machine(), options(), &program).unwrap().bytes;
    let mut rewriter = Rewriter::new(machine(), options()).unwrap();
    rewriter.push(format!("{program}G2 X1 Y1 I1\n{program}").as_bytes(), true);
    let mut out = Vec::new();
    let refusal = loop {
        match rewriter.pull(&mut out) {
            Ok(went_on) => assert!(went_on),
            Err(error) => break error,
        }
    };
    let line = program.lines().count() as u64 + 1;
    assert!(matches!(refusal, GcodeError::Unsupported { line: at, .. } if at == line), "{refusal:?}");
    assert!(out == before);
    assert_eq!(rewriter.pull(&mut out), Err(refusal), "a second time");
}

#[test]
fn the_first_refusal_in_the_order_of_lines_counts() {
    // The command of line 2 leaves the range; line 3 cannot be read; both lie in one block.
    let edge = RANGE_MM.1;
    let program = format!("G1 X100 Y100 Z5\nG1 X{edge} Y{edge} Z{edge}\nG1 X1=2\n");
    let refusal = run(bent("wZbXYt", [0.0; 3]), options(), &program).unwrap_err();
    assert!(matches!(refusal, GcodeError::CommandOutsideRange { line: 2, .. }), "{refusal:?}");
}

#[test]
fn pulling_before_the_end_gives_what_can_be_given() {
    let program = program(20_000);
    let mut rewriter = Rewriter::new(bent("wZbXYt", [0.0; 3]), passing()).unwrap();
    let mut out = Vec::new();
    let mut most_behind = 0;
    let mut n_pushed = 0;
    for chunk in program.as_bytes().chunks(40_000) {
        rewriter.push(chunk, false);
        n_pushed += chunk.len();
        while rewriter.pull(&mut out).unwrap() {}
        most_behind = most_behind.max(n_pushed.saturating_sub(out.len()));
    }
    assert!(most_behind < 3 * 40_000, "{most_behind} bytes are kept");
    rewriter.push(b"", true);
    while rewriter.pull(&mut out).unwrap() {}
    assert!(out == run(bent("wZbXYt", [0.0; 3]), passing(), &program).unwrap().bytes);
}
