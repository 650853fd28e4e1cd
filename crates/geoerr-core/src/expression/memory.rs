//! What a sequence of rows leaves behind: lags and wind-up, with their derivatives.
//!
//! A row that cannot be used (a value, a time constant or a time that is unknown, a time before the last one) gets NaN
//! and leaves no trace: the next row follows the last good one, over the whole time between them.
//!
//! # Lag
//! `dy/dt = (u − y)/τ` from `y = u` at the first row, solved exactly over each step h for `u` on a straight line between
//! rows, or, where `u` is a mean since the previous row, constant over the step. With r = h/τ:
//!
//! ```math
//! y_k = a\,y_{k-1} + (\varphi - a)\,u_{k-1} + (1 - \varphi)\,u_k,\qquad a = e^{-r},\quad \varphi = \frac{1 - e^{-r}}{r}
//! ```
//! ```math
//! y_k = a\,y_{k-1} + (1 - a)\,u_k \qquad\text{(u constant over the step)}
//! ```
//!
//! τ = 0 gives u; a negative τ gives NaN. Where τ differs between rows, a row's τ holds for the step that ends there.
//!
//! # Wind-up
//! For a direction d, travel s since the reversal and length λ,
//! `w = −d/2 + (w_rev + d/2)·e^(−s/λ)`, `w_rev` the value before the reversal. After a long stroke `w_rev = d/2`, so
//! `w = −(d/2)(1 − 2e^(−s/λ))`; so it is where the first row of a sequence has a travel (it says where the reversal
//! was), and where s shrinks while d stays (the axis went away and came back between two rows).
//!
//! At the start of a sequence the direction may be known and the travel not: no row has shown a reversal, and the axis
//! may have come any way. As a lag begins in its steady state, `w = −d/2` then, the value after a long way in this
//! direction, and stays so until d turns. Of an unknown travel that is the least wrong: w is within ±1/2, and off −d/2
//! by more than 5 % of its span only within 3λ behind a reversal. Where the travel gets lost later on (an approach
//! from beyond, which no row shows), there was a reversal, how far away is unknown, and w is NaN.
//!
//! Where the direction is 0, from where the axis came is unknown: w is 0, between its two ends, and the row leaves no
//! trace.

use super::functions::decay;

/// Weights of one step of a lag.
#[derive(Clone, Copy, Debug)]
struct Weights {
    /// Of the value before.
    y: f64,
    /// Of the input before.
    u_before: f64,
    /// Of the input now.
    u: f64,
}

impl Weights {
    fn new(step: f64, tau: f64, is_held: bool) -> Self {
        if tau == 0.0 {
            return Self { y: 0.0, u_before: 0.0, u: 1.0 };
        }
        let r = step / tau;
        let gained = -(-r).exp_m1();
        let a = (-r).exp();
        if is_held {
            return Self { y: a, u_before: 0.0, u: gained };
        }
        let phi = if r == 0.0 { 1.0 } else { gained / r };
        Self { y: a, u_before: phi - a, u: 1.0 - phi }
    }

    /// Derivatives by τ.
    fn by_tau(step: f64, tau: f64, is_held: bool) -> Self {
        if step == 0.0 {
            return Self { y: 0.0, u_before: 0.0, u: 0.0 };
        }
        let r = step / tau;
        // Towards τ = 0, e^(−r) goes to 0 faster than any power of τ.
        let da = if tau == 0.0 || r > 700.0 { 0.0 } else { (-r).exp() * r / tau };
        if is_held {
            return Self { y: da, u_before: 0.0, u: -da };
        }
        // d φ/dτ = (1 − e^(−r)(1 + r))/h; the difference cancels for small r.
        let gained = if r < 1e-2 {
            r * r * (0.5 - r * (1.0 / 3.0 - r * (1.0 / 8.0 - r * (1.0 / 30.0 - r / 144.0))))
        } else if r > 700.0 {
            1.0
        } else {
            1.0 - (-r).exp() * (1.0 + r)
        };
        let dphi = gained / step;
        Self { y: da, u_before: dphi - da, u: -dphi }
    }
}

/// State of a lag or wind-up, or of its derivative, behind the last good row.
#[derive(Clone, Copy, Debug)]
pub(super) enum Memory {
    /// Before the first good row of a sequence.
    Fresh,
    Lag {
        t: f64,
        u: f64,
        y: f64,
    },
    LagTangent {
        t: f64,
        u: f64,
        y: f64,
        du: f64,
        dy: f64,
    },
    Windup(Stroke),
}

/// A stroke: the travel since a reversal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stroke {
    d: f64,
    /// NaN where the sequence has not shown any travel yet.
    s: f64,
    /// Value before the reversal, and now.
    w_rev: f64,
    w: f64,
    /// Their derivatives.
    dw_rev: f64,
    dw: f64,
}

/// What a lag sees of one row.
#[derive(Clone, Copy, Debug)]
pub(super) struct LagRow {
    pub(super) t: f64,
    pub(super) u: f64,
    pub(super) tau: f64,
}

/// The next value of a lag.
pub(super) fn lag(memory: &mut Memory, row: LagRow, is_held: bool) -> f64 {
    let LagRow { t, u, tau } = row;
    if is_unusable(row) {
        return f64::NAN;
    }
    let next = match *memory {
        Memory::Lag { t: before, u: u_before, y } => {
            if t < before {
                return f64::NAN;
            }
            if tau == 0.0 {
                u
            } else {
                let weights = Weights::new(t - before, tau, is_held);
                weights.y * y + weights.u_before * u_before + weights.u * u
            }
        }
        _ => u,
    };
    if !next.is_nan() {
        *memory = Memory::Lag { t, u, y: next };
    }
    next
}

/// The next derivative of a lag whose value at this row is `y`.
pub(super) fn lag_tangent(
    memory: &mut Memory,
    row: LagRow,
    y: f64,
    (du, dtau): (f64, f64),
    is_held: bool,
    is_own_row: bool,
) -> f64 {
    let LagRow { t, u, tau } = row;
    // The value is NaN exactly where the row leaves no trace.
    if y.is_nan() || is_unusable(row) {
        return f64::NAN;
    }
    let next = match *memory {
        Memory::LagTangent { t: before, u: u_before, y: y_before, du: du_before, dy: dy_before } => {
            let step = t - before;
            let weights = Weights::new(step, tau, is_held);
            let mut next = weights.u * du;
            if !is_own_row {
                next += weights.y * dy_before + weights.u_before * du_before;
            }
            if dtau != 0.0 {
                let by_tau = Weights::by_tau(step, tau, is_held);
                next += dtau * (by_tau.y * y_before + by_tau.u_before * u_before + by_tau.u * u);
            }
            next
        }
        _ => du,
    };
    *memory = Memory::LagTangent { t, u, y, du, dy: next };
    next
}

fn is_unusable(row: LagRow) -> bool {
    row.u.is_nan() || row.t.is_nan() || row.tau.is_nan() || row.tau < 0.0
}

/// What wind-up sees of one row.
#[derive(Clone, Copy, Debug)]
pub(super) struct WindupRow {
    pub(super) d: f64,
    pub(super) s: f64,
    pub(super) lambda: f64,
}

/// The next value of wind-up.
pub(super) fn windup(memory: &mut Memory, row: WindupRow) -> f64 {
    if is_between(row) {
        return 0.0;
    }
    wound(memory, row, (0.0, 0.0), false).map_or(f64::NAN, |stroke| stroke.w)
}

/// The next derivative of wind-up.
pub(super) fn windup_tangent(
    memory: &mut Memory,
    row: WindupRow,
    tangents: (f64, f64),
    is_own_row: bool,
) -> f64 {
    if is_between(row) {
        return 0.0;
    }
    wound(memory, row, tangents, is_own_row).map_or(f64::NAN, |stroke| stroke.dw)
}

fn is_between(row: WindupRow) -> bool {
    row.d == 0.0 && row.lambda >= 0.0
}

fn wound(memory: &mut Memory, row: WindupRow, (ds, dlambda): (f64, f64), is_own_row: bool) -> Option<Stroke> {
    let WindupRow { d, s, lambda } = row;
    if d.is_nan() || lambda.is_nan() || lambda < 0.0 {
        return None;
    }
    let settled = Stroke { d, s: f64::NAN, w_rev: -0.5 * d, w: -0.5 * d, dw_rev: 0.0, dw: 0.0 };
    let stroke = match *memory {
        Memory::Windup(before) if s.is_nan() && before.s.is_nan() && before.d == d => settled,
        Memory::Windup(_) if s.is_nan() => return None,
        _ if s.is_nan() => settled,
        ref past => {
            let left = decay(s, lambda);
            if left.is_nan() || s < 0.0 {
                return None;
            }
            let (w_rev, dw_rev) = match *past {
                Memory::Windup(before) if before.d != d => (before.w, before.dw),
                Memory::Windup(before) if before.s.is_nan() || s >= before.s => (before.w_rev, before.dw_rev),
                _ => (0.5 * d, 0.0),
            };
            let dw_rev = if is_own_row { 0.0 } else { dw_rev };
            // Without travel, or with λ = 0 (where all of it is gone), the fraction left does not change with λ or s.
            let dleft =
                if left == 0.0 || lambda == 0.0 { 0.0 } else { left / lambda * (s / lambda * dlambda - ds) };
            Stroke {
                d,
                s,
                w_rev,
                w: -0.5 * d + (w_rev + 0.5 * d) * left,
                dw_rev,
                dw: dw_rev * left + (w_rev + 0.5 * d) * dleft,
            }
        }
    };
    *memory = Memory::Windup(stroke);
    Some(stroke)
}
