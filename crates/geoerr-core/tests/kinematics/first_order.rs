//! The exact chain against the first-order sums, written out from the theory for any chain.

use geoerr_core::kinematics::{Axis, Chain, ErrorTables, MachineModel};

use super::machines::{
    add, all_chains, assert_second_order, cross, delta_and_epsilon, drawn_errors, drawn_machine, sub,
};
use crate::draws::Draws;

/// Σ q_b b̂ over some axes.
fn travel(axes: &[Axis], q: [f64; 3]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for axis in axes {
        sum[axis.index()] += q[axis.index()];
    }
    sum
}

/// What squareness takes from the travel of one axis, first order: −S_xy y along x for Y, and so on.
fn square(errors: &ErrorTables, axis: Axis, q: [f64; 3]) -> [f64; 3] {
    let s = errors.squareness();
    match axis {
        Axis::X => [0.0; 3],
        Axis::Y => [-s.s_xy_rad * q[1], 0.0, 0.0],
        Axis::Z => [-s.s_xz_rad * q[2], -s.s_yz_rad * q[2], 0.0],
    }
}

/// Σ_tool δ_a + ε_a × (l + Σ_{tool axes outside a} q_b b̂)
fn tool_from_base(chain: &Chain, errors: &ErrorTables, q: [f64; 3], l: [f64; 3]) -> [f64; 3] {
    let tool = chain.tool_axes();
    let mut sum = [0.0; 3];
    for (place, &axis) in tool.iter().enumerate() {
        let (delta, epsilon) = delta_and_epsilon(errors, axis, q);
        let lever = add(l, travel(&tool[place + 1..], q));
        sum = add(sum, add(add(delta, square(errors, axis, q)), cross(epsilon, lever)));
    }
    sum
}

/// The tool side's sum + Σ_work δ_a + ε_a × (l + Σ_tool q_b b̂ + q_a â + Σ_{work axes inside a} q_b b̂)
fn tool_from_work(chain: &Chain, errors: &ErrorTables, q: [f64; 3], l: [f64; 3]) -> [f64; 3] {
    let (tool, work) = (chain.tool_axes(), chain.work_axes());
    let mut sum = tool_from_base(chain, errors, q, l);
    for (place, &axis) in work.iter().enumerate() {
        let (delta, epsilon) = delta_and_epsilon(errors, axis, q);
        let lever = add(add(l, travel(tool, q)), travel(&work[..=place], q));
        sum = add(sum, add(add(delta, square(errors, axis, q)), cross(epsilon, lever)));
    }
    sum
}

/// −Σ_work δ_a + ε_a × (w − Σ_{work axes outside a} q_b b̂)
fn work_from_base(chain: &Chain, errors: &ErrorTables, q: [f64; 3], w: [f64; 3]) -> [f64; 3] {
    let work = chain.work_axes();
    let mut sum = [0.0; 3];
    for (place, &axis) in work.iter().enumerate() {
        let (delta, epsilon) = delta_and_epsilon(errors, axis, q);
        let lever = sub(w, travel(&work[place + 1..], q));
        sum = sub(sum, add(add(delta, square(errors, axis, q)), cross(epsilon, lever)));
    }
    sum
}

/// Commanded positions and target offsets, a few hundred millimetres each.
fn places() -> Vec<([f64; 3], [f64; 3])> {
    let mut draws = Draws::new(7);
    (0..20).map(|_| (draws.three(320.0), draws.three(200.0))).collect()
}

type FirstOrder = fn(&Chain, &ErrorTables, [f64; 3], [f64; 3]) -> [f64; 3];
type Exact = fn(&MachineModel, [f64; 3], [f64; 3]) -> [f64; 3];

fn compare(what: &str, exact: Exact, first_order: FirstOrder, has_axes: fn(&Chain) -> bool) {
    for (seed, code) in all_chains().iter().enumerate() {
        let chain = Chain::parse(code).unwrap();
        if !has_axes(&chain) {
            continue;
        }
        assert_second_order(&format!("{what} of {code}"), |scale| {
            let machine = drawn_machine(code, seed as u64, scale);
            let errors = drawn_errors(seed as u64, scale);
            let each = |(q, offset)| sub(exact(&machine, q, offset), first_order(&chain, &errors, q, offset));
            places().into_iter().map(each).collect()
        });
    }
}

/// With the tool offset that `drawn_machine` has.
fn lever(machine: &MachineModel, offset: [f64; 3]) -> [f64; 3] {
    add(*machine.tool_offset_mm(), offset)
}

#[test]
fn tool_from_work_all_chains() {
    compare(
        "tool from the work",
        |machine, q, offset| sub(machine.tool_from_work(&q, &offset), add(q, lever(machine, offset))),
        |chain, errors, q, offset| tool_from_work(chain, errors, q, add([3.0, -20.0, 55.0], offset)),
        |_| true,
    );
}

#[test]
fn tool_from_base_all_chains() {
    compare(
        "tool from the base",
        |machine, q, offset| {
            let nominal = add(travel(machine.chain().tool_axes(), q), lever(machine, offset));
            sub(machine.tool_from_base(&q, &offset), nominal)
        },
        |chain, errors, q, offset| tool_from_base(chain, errors, q, add([3.0, -20.0, 55.0], offset)),
        |chain| !chain.tool_axes().is_empty(),
    );
}

#[test]
fn work_from_base_all_chains() {
    compare(
        "work from the base",
        |machine, q, w| {
            let nominal = sub(w, travel(machine.chain().work_axes(), q));
            sub(machine.work_from_base(&q, &w), nominal)
        },
        work_from_base,
        |chain| !chain.work_axes().is_empty(),
    );
}

/// Li's Eq. 8 as derived for wZbXYt, literally, with the squareness terms that hold in every chain.
fn li_equation_8(errors: &ErrorTables, q: [f64; 3], l: [f64; 3]) -> [f64; 3] {
    let ([d_xx, d_yx, d_zx], [e_xx, e_yx, e_zx]) = delta_and_epsilon(errors, Axis::X, q);
    let ([d_xy, d_yy, d_zy], [e_xy, e_yy, e_zy]) = delta_and_epsilon(errors, Axis::Y, q);
    let ([d_xz, d_yz, d_zz], [e_xz, e_yz, e_zz]) = delta_and_epsilon(errors, Axis::Z, q);
    let ([x, y, z], [l_x, l_y, l_z]) = (q, l);
    let s = errors.squareness();
    [
        d_xx + d_xy + d_xz - y * (e_zx + e_zz) + z * e_yz + l_z * (e_yx + e_yy + e_yz)
            - l_y * (e_zx + e_zy + e_zz)
            - (s.s_xy_rad * y + s.s_xz_rad * z),
        d_yx + d_yy + d_yz + x * e_zz - z * e_xz + l_x * (e_zx + e_zy + e_zz)
            - l_z * (e_xx + e_xy + e_xz)
            - s.s_yz_rad * z,
        d_zx + d_zy + d_zz - x * e_yz + y * (e_xx + e_xz) - l_x * (e_yx + e_yy + e_yz)
            + l_y * (e_xx + e_xy + e_xz),
    ]
}

#[test]
fn li_equation_8_is_the_sum_for_his_chain() {
    let chain = Chain::parse("wZbXYt").unwrap();
    let errors = drawn_errors(8, 1.0);
    for (q, l) in places() {
        let difference = sub(li_equation_8(&errors, q, l), tool_from_work(&chain, &errors, q, l));
        // Sums of a dozen terms below 3 mm: a few rounding errors.
        assert!(difference.iter().all(|d| d.abs() < 1e-14), "{difference:?}");
    }
}

#[test]
fn li_equation_8_is_the_first_order_of_the_exact_chain() {
    assert_second_order("Li's Eq. 8", |scale| {
        let errors = drawn_errors(9, scale);
        let machine = MachineModel::new(Chain::parse("wZbXYt").unwrap(), errors.clone(), [0.0; 3]);
        let each = |(q, l)| sub(machine.error(&q, &l), li_equation_8(&errors, q, l));
        places().into_iter().map(each).collect()
    });
}
