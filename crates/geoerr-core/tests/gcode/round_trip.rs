//! Compensate, then run the machine: the actual path is the programmed one.

use super::common::{RANGE_MM, bent, options, passing, run, run_bytes};
use geoerr_core::gcode::Options;
use geoerr_core::kinematics::MachineModel;
use proptest::prelude::*;

/// A step of a drawn program.
#[derive(Clone, Debug)]
enum Draw {
    /// To this machine position; which axes are written (at least one), in which distance mode.
    To { at_mm: [f64; 3], axes: [bool; 3], relative: bool },
    /// `G92` of these axes.
    Shift { axes: [bool; 3], at: f64 },
    /// `G20` or `G21`.
    Unit { inch: bool },
}

fn draws() -> impl Strategy<Value = Vec<Draw>> {
    let (low, high) = (RANGE_MM.0 + 15.0, RANGE_MM.1 - 15.0);
    let position = [low..high, low..high, low..high];
    let axes = any::<[bool; 3]>().prop_map(|axes| if axes == [false; 3] { [true; 3] } else { axes });
    let draw = prop_oneof![
        8 => (position, axes.clone(), any::<bool>())
            .prop_map(|(at_mm, axes, relative)| Draw::To { at_mm, axes, relative }),
        1 => (axes, -50.0_f64..50.0).prop_map(|(axes, at)| Draw::Shift { axes, at }),
        1 => any::<bool>().prop_map(|inch| Draw::Unit { inch }),
    ];
    proptest::collection::vec(draw, 1..12)
}

/// The program as text, and the machine positions that it means.
fn written(draws: &[Draw], work_offset_mm: [f64; 3]) -> (String, Vec<[f64; 3]>) {
    let mut text = String::from("G90\nG21\n");
    let mut at = [0.0; 3];
    let mut zero = work_offset_mm;
    let mut unit = 1.0;
    let mut positions = Vec::new();
    let first = Draw::To { at_mm: [50.0, 60.0, 70.0], axes: [true; 3], relative: false };
    for draw in std::iter::once(&first).chain(draws) {
        match draw {
            Draw::To { at_mm, axes, relative } => {
                text += &format!("M117 {}\n{}\n", positions.len(), if *relative { "G91" } else { "G90" });
                text += if positions.len() % 3 == 0 { "G0" } else { "G1" };
                for axis in 0..3 {
                    if axes[axis] {
                        let from = if *relative { at[axis] } else { zero[axis] };
                        let word = format!("{:.5}", (at_mm[axis] - from) / unit);
                        at[axis] = from + word.parse::<f64>().unwrap() * unit;
                        text += &format!(" {}{word}", ["X", "Y", "Z"][axis]);
                    }
                }
                text += "\n";
                positions.push(at);
            }
            Draw::Shift { axes, at: word } => {
                text += "G92";
                for axis in 0..3 {
                    if axes[axis] {
                        let word = format!("{:.3}", word / unit);
                        zero[axis] = at[axis] - word.parse::<f64>().unwrap() * unit;
                        text += &format!(" {}{word}", ["X", "Y", "Z"][axis]);
                    }
                }
                text += "\n";
            }
            Draw::Unit { inch } => {
                unit = if *inch { 25.4 } else { 1.0 };
                text += if *inch { "G20\n" } else { "G21\n" };
            }
        }
    }
    (text, positions)
}

/// A plain reader of programs such as these: for each `M117 n` the commands up to the next.
fn commands(text: &str, work_offset_mm: [f64; 3]) -> Vec<Vec<[f64; 3]>> {
    let mut groups: Vec<Vec<[f64; 3]>> = Vec::new();
    let (mut at, mut zero, mut unit, mut relative) = ([0.0; 3], work_offset_mm, 1.0, false);
    for line in text.lines() {
        let mut words = line.split(' ');
        let code = words.next().unwrap_or_default();
        let numbers = words.filter_map(|word| {
            let axis = "XYZ".find(word.chars().next()?)?;
            Some((axis, word[1..].parse::<f64>().ok()?))
        });
        match code {
            "M117" => groups.push(Vec::new()),
            "G90" | "G91" => relative = code == "G91",
            "G20" => unit = 25.4,
            "G21" => unit = 1.0,
            "G92" => numbers.for_each(|(axis, word)| zero[axis] = at[axis] - word * unit),
            "G0" | "G1" => {
                for (axis, word) in numbers {
                    at[axis] = if relative { at[axis] } else { zero[axis] } + word * unit;
                }
                groups.last_mut().unwrap().push(at);
            }
            _ => assert!(code == ";", "{line}"),
        }
    }
    groups
}

fn actual(machine: &MachineModel, command_mm: &[f64; 3]) -> [f64; 3] {
    let nominal = machine.nominal_tool_from_work(&[0.0; 3], &[0.0; 3]);
    let tool = machine.tool_from_work(command_mm, &[0.0; 3]);
    std::array::from_fn(|axis| tool[axis] - nominal[axis])
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1]).hypot(a[2] - b[2])
}

/// Distance of `p` from the segment `a b`.
fn off_segment(p: &[f64; 3], a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let along: [f64; 3] = std::array::from_fn(|i| b[i] - a[i]);
    let length2: f64 = along.iter().map(|x| x * x).sum();
    let dot: f64 = (0..3).map(|i| (p[i] - a[i]) * along[i]).sum();
    let share = if length2 > 0.0 { (dot / length2).clamp(0.0, 1.0) } else { 0.0 };
    distance(p, &std::array::from_fn(|i| a[i] + share * along[i]))
}

const CHAINS: [&str; 4] = ["wZbXYt", "wbXYZt", "wXYbZt", "wXYZbt"];

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_actual_path_of_the_output_is_the_programmed_one(
        draws in draws(),
        chain in 0_usize..4,
        tolerance_mm in prop_oneof![Just(0.005), Just(0.02), Just(0.001)],
    ) {
        let work_offset_mm = [3.0, -2.0, 1.5];
        let machine = || bent(CHAINS[chain], [10.0, -20.0, -35.0]);
        let options = Options { work_offset_mm: Some(work_offset_mm), tolerance_mm, ..options() };
        let (program, positions) = written(&draws, work_offset_mm);
        let outcome = run(machine(), options, &program).unwrap();
        let groups = commands(outcome.text(), work_offset_mm);
        let machine = machine();
        prop_assert_eq!(groups.len(), positions.len());
        let mut from = groups[0][0];
        for (number, (group, end)) in groups.iter().zip(&positions).enumerate() {
            // Ends: the model's inverse to 0.1 µm, and words of 0.1 µm or 0.254 µm steps.
            let last = group.last().unwrap();
            prop_assert!(distance(&actual(&machine, last), end) < 1e-3 * 0.5);
            if number > 0 {
                let begin = &positions[number - 1];
                for command in group {
                    for i in 0..=50 {
                        let share = f64::from(i) / 50.0;
                        let at = std::array::from_fn(|axis| from[axis] + share * (command[axis] - from[axis]));
                        let off = off_segment(&actual(&machine, &at), begin, end);
                        prop_assert!(off <= tolerance_mm, "{off} mm off at move {number}");
                    }
                    from = *command;
                }
            }
            from = *last;
        }
    }

    #[test]
    fn moves_are_counted(draws in draws()) {
        let (program, positions) = written(&draws, [0.0; 3]);
        let outcome = run(bent("wZbXYt", [0.0; 3]), options(), &program).unwrap();
        prop_assert_eq!(outcome.summary.moves_in as usize, positions.len());
        let groups = commands(outcome.text(), [0.0; 3]);
        prop_assert_eq!(outcome.summary.moves_out as usize, groups.iter().map(Vec::len).sum::<usize>());
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    // Long enough for several blocks.
    let moves = (0..60_000).map(|i: i32| {
        // Every hundredth move goes far and is split.
        let t = f64::from(i) * 0.01 + f64::from(i / 100);
        format!(
            "G1 X{:.3} Y{:.3} Z{:.3} E.0123\n",
            200.0 + 150.0 * t.sin(),
            200.0 + 150.0 * (1.3 * t).cos(),
            t / 10.0
        )
    });
    let program: String = std::iter::once("M83\n".to_owned()).chain(moves).collect();
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run_bytes(bent("wZbXYt", [0.0; 3]), passing(), &[program.as_bytes()]).unwrap())
    };
    let one = with(1);
    assert!(one.summary.moves_out > 60_000);
    for threads in [2, 8] {
        assert!(with(threads) == one, "{threads} threads");
    }
}
