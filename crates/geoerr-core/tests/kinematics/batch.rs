//! Many rows at once: each as alone, the same bytes from any number of threads, wrong lengths refused.

use geoerr_core::kinematics::{
    BLOCK_ROWS, Carrier, Chain, Displacements, KinematicsError, MachineModel, Points, View, jacobians,
    measured_from_base, positions, rig_columns,
};
use geoerr_core::newton::{Commands, Status, command_for, commands_for};

use super::displacements::{drawn_channels, drawn_pose};
use super::machines::drawn_machine;
use crate::draws::Draws;

fn rows(n: usize) -> Vec<[f64; 3]> {
    let mut draws = Draws::new(31);
    (0..n).map(|_| draws.three(350.0)).collect()
}

fn on_threads<T: Send>(n: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap().install(work)
}

fn bits(rows: &[[f64; 3]]) -> Vec<[u64; 3]> {
    rows.iter().map(|row| row.map(f64::to_bits)).collect()
}

#[test]
fn each_row_as_alone() {
    let machine = drawn_machine("wZbXYt", 1, 1.0);
    let (q, offsets) = (rows(300), rows(600).split_off(300));
    type Alone = fn(&MachineModel, &[f64; 3], &[f64; 3]) -> [f64; 3];
    let single: [(View, Alone); 4] = [
        (View::ToolFromWork, MachineModel::tool_from_work),
        (View::ToolError, MachineModel::error),
        (View::ToolFromBase, MachineModel::tool_from_base),
        (View::WorkFromBase, MachineModel::work_from_base),
    ];
    for (view, alone) in single {
        let each: Vec<_> = q.iter().zip(&offsets).map(|(q, l)| alone(&machine, q, l)).collect();
        assert_eq!(positions(&machine, view, &q, &offsets).unwrap(), each, "{view:?}");
        let each: Vec<_> = q.iter().map(|q| alone(&machine, q, &offsets[0])).collect();
        assert_eq!(positions(&machine, view, &q, &offsets[..1]).unwrap(), each, "{view:?}");
    }
    let each: Vec<_> = q.iter().zip(&offsets).map(|(q, l)| machine.jacobian(q, l)).collect();
    assert_eq!(jacobians(&machine, &q, &offsets).unwrap(), each);
}

#[test]
fn same_bytes_from_any_number_of_threads() {
    let machine = drawn_machine("wXbYZt", 2, 1.0);
    let q = rows(5 * BLOCK_ROWS + 17);
    let run = |threads| {
        on_threads(threads, || {
            let Commands { command_mm, remaining_mm, status } = commands_for(&machine, &q, 1e-9).unwrap();
            let remaining: Vec<u64> = remaining_mm.iter().map(|r| r.to_bits()).collect();
            let seen = positions(&machine, View::ToolFromWork, &q, &[[1.0, 2.0, 3.0]]).unwrap();
            (bits(&command_mm), remaining, status, bits(&seen))
        })
    };
    let one = run(1);
    assert!(one.2.iter().all(|&status| status == Status::Converged));
    for threads in [2, 8] {
        assert!(run(threads) == one, "{threads} threads");
    }
}

#[test]
fn a_bad_row_is_alone() {
    let machine = drawn_machine("wZbXYt", 3, 1.0);
    let mut targets = rows(5);
    targets[1][2] = f64::NAN;
    targets[3][0] = f64::INFINITY;
    let commands = commands_for(&machine, &targets, 1e-9).unwrap();
    for (row, target) in targets.iter().enumerate() {
        if row == 1 || row == 3 {
            assert_eq!(commands.status[row], Status::NonFinite);
            assert!(
                commands.command_mm[row].iter().all(|c| c.is_nan()) && commands.remaining_mm[row].is_nan()
            );
        } else {
            let alone = command_for(&machine, target, 1e-9).unwrap();
            assert_eq!(commands.status[row], Status::Converged);
            assert_eq!(commands.command_mm[row], alone.command_mm);
            assert_eq!(commands.remaining_mm[row], alone.remaining_mm);
        }
    }
}

#[test]
fn offsets_must_pair() {
    let machine = drawn_machine("wZbXYt", 4, 1.0);
    let refused = Err(KinematicsError::OffsetCount { n_offsets: 2, n_positions: 3 });
    assert_eq!(positions(&machine, View::ToolFromWork, &rows(3), &rows(2)), refused);
    let refused = Err(KinematicsError::OffsetCount { n_offsets: 0, n_positions: 3 });
    assert_eq!(jacobians(&machine, &rows(3), &[]), refused);
    assert_eq!(positions(&machine, View::ToolFromWork, &[], &[]), Ok(vec![]));
}

#[test]
fn points_of_a_chain_each_as_alone_on_any_number_of_threads() {
    let chain = Chain::parse("wXbYZt").unwrap();
    let n = 2 * BLOCK_ROWS + 17;
    let mut draws = Draws::new(32);
    let (q, offsets) = (rows(n), rows(2 * n).split_off(n));
    let carriers: Vec<Carrier> = (0..n).map(|row| Carrier::ALL[row % 4]).collect();
    let channels: Vec<_> = (0..n).map(|_| drawn_channels(&mut draws, 0.1)).collect();
    let rig: Vec<_> = (0..n).map(|_| std::array::from_fn(|_| 1e-3 * draws.symmetric())).collect();
    let pose = drawn_pose(&mut draws);
    let tool_offset_mm = [1.0, 2.0, 3.0];
    let points =
        Points { chain: &chain, tool_offset_mm, carriers: &carriers, q_mm: &q, offsets_mm: &offsets };
    let run = |threads| {
        on_threads(threads, || {
            (
                points.position(&channels).unwrap(),
                points.displacement(&channels).unwrap(),
                points.nominal().unwrap(),
                points.channel_columns().unwrap(),
                rig_columns(&pose, &q),
                measured_from_base(&pose, &rig, &q).unwrap(),
            )
        })
    };
    let one = run(1);
    for row in [0, 1, 2, 3, 2047, 2048, n - 1] {
        let (carrier, q, offset) = (carriers[row], &q[row], &offsets[row]);
        let d = Displacements::from_channels(&channels[row]);
        assert_eq!(one.0[row], chain.position(carrier, q, offset, &tool_offset_mm, &d));
        assert_eq!(one.1[row], chain.displacement(carrier, q, offset, &tool_offset_mm, &d));
        assert_eq!(one.2[row], chain.nominal(carrier, q, offset, &tool_offset_mm));
        assert_eq!(one.3[row], chain.channel_columns(carrier, q, offset, &tool_offset_mm));
        assert_eq!(one.4[row], pose.rig_columns(q));
        assert_eq!(one.5[row], pose.measured_from_base(&rig[row], q));
    }
    for threads in [2, 8] {
        assert!(run(threads) == one, "{threads} threads");
    }

    let refused = |what| KinematicsError::RowCount { what, n_found: 5, n_positions: n };
    let short = Points { carriers: &carriers[..5], ..points };
    assert_eq!(short.nominal(), Err(refused("carriers")));
    let short = Points { offsets_mm: &offsets[..5], ..points };
    assert_eq!(short.channel_columns(), Err(refused("offsets")));
    assert_eq!(points.position(&channels[..5]), Err(refused("channels")));
    assert_eq!(measured_from_base(&pose, &rig[..5], &q), Err(refused("rig numbers")));
}
