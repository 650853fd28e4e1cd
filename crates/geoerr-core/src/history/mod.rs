//! What follows from the order of rows: direction, travel and time since the reversal, speed, acceleration.
//!
//! One place for measured rows and for the moves of a program: [`History`] takes one moment after the other,
//! [`history`] whole tables of them.
//!
//! | name | unit | what it is, for each axis |
//! |---|---|---|
//! | `d` | – | direction of the last motion, −1 or 1: as given, else from the order of rows; NaN before the first motion |
//! | `s` | mm | travel since the last reversal |
//! | `t_rev` | s | time since the last reversal |
//! | `v` | mm/s | speed at the moment: 0 at rest; else the feed along the last move; without a feed, `mean_v` |
//! | `a` | mm/s² | acceleration at the moment: 0 at rest; else the change of `v` since the previous row (which was moving too) over the time between them |
//! | `mean_v` | mm/s | mean speed since the previous row, signed; 0 at the first row of a sequence |
//!
//! # What rows can and cannot show
//! - `s` is the travel that rows show. Before the first reversal it counts from the first row of the sequence, as does
//!   `t_rev`: the axis may have come a longer way. Where a
//!   given direction says that the axis came back without any row having been taken on the way (an approach from
//!   beyond the point), the travel is not known: NaN at that row, and counted from there at the next.
//! - The moment of a reversal lies after the row before it: `t_rev` counts from that row.
//! - A row of the same time and place as the one before it is the same moment seen again, and has the same history.
//! - A time that is unknown, or before the last one, leaves `t_rev`, `mean_v` and what needs them NaN at that row.
//!
//! # Curves
//! Rows taken on a smooth path without a stop (a circular test) are told as such. Their velocity is the feed along the
//! tangent of the circle through each row and its two neighbours, their acceleration v² times its curvature (towards its
//! centre, exact for a circle at a constant feed whatever the spacing of rows); `d` is the sign of `v`, and a reversal
//! lies where `v` on a straight line between two rows is 0.
//!
//! # Verified
//! `tests/history/`: there and back by hand, circles against sines and cosines, invariances, sequences. The package's
//! `tests/expression/test_history.py`: a second implementation with NumPy.

mod curve;

use std::ops::Range;

use curve::motions;

/// One moment: where the axes are commanded to be, and how they got there.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// Commanded positions.
    pub q_mm: [f64; 3],
    /// Time; NaN = unknown.
    pub t_s: f64,
    /// Whether the axes move at this moment.
    pub is_moving: bool,
    /// Feed of the last move; NaN = unknown.
    pub feed_mm_min: f64,
    /// Direction of each axis's last motion; 0 or NaN = from the order of moments.
    pub direction: [f64; 3],
    /// Velocity and acceleration where the path is known to be smooth (a curve); then direction follows from it.
    pub motion: Option<Motion>,
}

/// Motion at one moment of a smooth path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Velocity.
    pub v_mm_s: [f64; 3],
    /// Acceleration.
    pub a_mm_s2: [f64; 3],
    /// Time since the moment before on the same path; NaN = take it from the moments' times.
    pub step_s: f64,
}

/// What follows for one moment, by axis; see the head of this file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Past {
    /// Direction of the last motion.
    pub d: [f64; 3],
    /// Travel since the last reversal.
    pub s_mm: [f64; 3],
    /// Time since it.
    pub t_rev_s: [f64; 3],
    /// Speed at the moment.
    pub v_mm_s: [f64; 3],
    /// Acceleration at the moment.
    pub a_mm_s2: [f64; 3],
    /// Mean speed since the previous moment.
    pub mean_v_mm_s: [f64; 3],
}

/// The stroke of one axis.
#[derive(Clone, Copy, Debug)]
struct Stroke {
    /// −1, 1, or NaN while nothing has moved.
    d: f64,
    /// Travel shown since the reversal; 0 = a reversal whose travel nothing shows.
    shown_mm: f64,
    since_s: f64,
}

/// The moment before.
#[derive(Clone, Copy, Debug)]
struct Before {
    moment: Moment,
    past: Past,
}

/// History of one sequence of moments.
#[derive(Clone, Debug, Default)]
pub struct History {
    before: Option<Before>,
    /// Last known time.
    t_s: Option<f64>,
    /// The last move that was one.
    move_mm: Option<[f64; 3]>,
    strokes: Option<[Stroke; 3]>,
}

impl History {
    /// A sequence of which nothing is known yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes the next moment, and says what led to it.
    pub fn step(&mut self, moment: &Moment) -> Past {
        let mut moment = *moment;
        if self.t_s.is_some_and(|last| moment.t_s < last) {
            moment.t_s = f64::NAN;
        }
        let past = match self.before {
            None => self.first(&moment),
            Some(before) if is_same(&moment, &before) => before.past,
            Some(before) => self.next(&moment, &before),
        };
        if !moment.t_s.is_nan() {
            self.t_s = Some(moment.t_s);
        }
        self.before = Some(Before { moment, past });
        past
    }

    fn first(&mut self, moment: &Moment) -> Past {
        let strokes = [0, 1, 2].map(|axis| {
            let d = direction(moment, axis);
            Stroke { d, shown_mm: 0.0, since_s: if d.is_nan() { f64::NAN } else { 0.0 } }
        });
        self.strokes = Some(strokes);
        let at_rest = if moment.is_moving { [f64::NAN; 3] } else { [0.0; 3] };
        Past {
            d: strokes.map(|stroke| stroke.d),
            s_mm: [f64::NAN; 3],
            t_rev_s: [f64::NAN; 3],
            v_mm_s: moment.motion.map_or(at_rest, |motion| motion.v_mm_s),
            a_mm_s2: moment.motion.map_or(at_rest, |motion| motion.a_mm_s2),
            mean_v_mm_s: [0.0; 3],
        }
    }

    fn next(&mut self, moment: &Moment, before: &Before) -> Past {
        let moved_mm = [0, 1, 2].map(|axis| moment.q_mm[axis] - before.moment.q_mm[axis]);
        if moved_mm.iter().any(|&moved| moved != 0.0) {
            self.move_mm = Some(moved_mm);
        }
        let since_before_s = moment.t_s - before.moment.t_s;
        let mean_v_mm_s = moved_mm.map(|moved| mean_speed(moved, since_before_s));
        // Over rows without a time, the time runs on from the last that had one.
        let step_s = match moment.motion {
            Some(motion) if !motion.step_s.is_nan() => motion.step_s,
            _ => moment.t_s - self.t_s.unwrap_or(f64::NAN),
        };
        let v_mm_s = self.speed(moment, &mean_v_mm_s);
        let was_moving = before.moment.is_moving;
        let change = |axis: usize| (v_mm_s[axis] - before.past.v_mm_s[axis]) / since_before_s;
        let a_mm_s2 = match moment.motion {
            Some(motion) => motion.a_mm_s2,
            None if !moment.is_moving => [0.0; 3],
            None if was_moving && since_before_s > 0.0 => [0, 1, 2].map(change),
            None => [f64::NAN; 3],
        };
        let strokes =
            self.strokes.get_or_insert([Stroke { d: f64::NAN, shown_mm: 0.0, since_s: f64::NAN }; 3]);
        let mut past = Past {
            d: [f64::NAN; 3],
            s_mm: [f64::NAN; 3],
            t_rev_s: [f64::NAN; 3],
            v_mm_s,
            a_mm_s2,
            mean_v_mm_s,
        };
        for (axis, stroke) in strokes.iter_mut().enumerate() {
            let speeds = match (moment.motion, before.moment.motion) {
                (Some(now), Some(then)) => Some((then.v_mm_s[axis], now.v_mm_s[axis])),
                _ => None,
            };
            stroke.advance(direction(moment, axis), moved_mm[axis], step_s, speeds);
            past.d[axis] = stroke.d;
            if stroke.shown_mm > 0.0 {
                past.s_mm[axis] = stroke.shown_mm;
            }
            if !step_s.is_nan() {
                past.t_rev_s[axis] = stroke.since_s;
            }
        }
        past
    }

    fn speed(&self, moment: &Moment, mean_v_mm_s: &[f64; 3]) -> [f64; 3] {
        if let Some(motion) = moment.motion {
            return motion.v_mm_s;
        }
        if !moment.is_moving {
            return [0.0; 3];
        }
        match self.move_mm {
            Some([x, y, z]) if !moment.feed_mm_min.is_nan() => {
                let length_mm = x.hypot(y).hypot(z);
                [x, y, z].map(|moved| moment.feed_mm_min / 60.0 * moved / length_mm)
            }
            _ => *mean_v_mm_s,
        }
    }
}

impl Stroke {
    /// Takes the next moment: `d` is the direction known for it (NaN = from `moved_mm`), `speeds` those of the moment
    /// before and of this one where the path between them is smooth.
    fn advance(&mut self, d: f64, moved_mm: f64, step_s: f64, speeds: Option<(f64, f64)>) {
        let shown_d = if moved_mm == 0.0 { f64::NAN } else { moved_mm.signum() };
        let d = if d.is_nan() { shown_d } else { d };
        let is_shown = shown_d == d;
        if d.is_nan() || d == self.d && (is_shown || moved_mm == 0.0) {
            // On in the same direction, or not moved.
            self.shown_mm += moved_mm.abs();
            if !step_s.is_nan() {
                self.since_s += step_s;
            }
            return;
        }
        let is_first = self.d.is_nan();
        self.d = d;
        self.shown_mm = if is_shown { moved_mm.abs() } else { 0.0 };
        self.since_s = step_s;
        if let Some((then, now)) = speeds
            && !is_first
            && then * now <= 0.0
            && now != 0.0
        {
            self.since_s = step_s * now.abs() / (now.abs() + then.abs());
            self.shown_mm = 0.5 * now.abs() * self.since_s;
        }
    }
}

/// The direction that a moment itself knows.
fn direction(moment: &Moment, axis: usize) -> f64 {
    let known = match moment.motion {
        Some(motion) => {
            // A quadrant of a circle is 0 but for round-off.
            let [x, y, z] = motion.v_mm_s;
            let v = motion.v_mm_s[axis];
            if v.abs() <= 1e-9 * x.hypot(y).hypot(z) { 0.0 } else { v }
        }
        None => moment.direction[axis],
    };
    if known == 0.0 || known.is_nan() { f64::NAN } else { known.signum() }
}

fn is_same(moment: &Moment, before: &Before) -> bool {
    let turns = |axis: usize| {
        let d = direction(moment, axis);
        !d.is_nan() && d != before.past.d[axis]
    };
    moment.t_s == before.moment.t_s && moment.q_mm == before.moment.q_mm && ![0, 1, 2].into_iter().any(turns)
}

fn mean_speed(moved_mm: f64, step_s: f64) -> f64 {
    if step_s > 0.0 {
        moved_mm / step_s
    } else if moved_mm == 0.0 && step_s == 0.0 {
        0.0
    } else {
        f64::NAN
    }
}

/// Rows in the order in which they were taken. Optional columns that are absent are `None`.
#[derive(Clone, Copy, Debug)]
pub struct HistoryRows<'a> {
    /// Commanded positions.
    pub q_mm: &'a [[f64; 3]],
    /// Times; without them, the number of the row (and `t_rev` in rows, speeds in mm a row).
    pub t_s: Option<&'a [f64]>,
    /// Whether the axes move at each row (0 or NaN = not); without it, never.
    pub moving: Option<&'a [f64]>,
    /// Feed of the last move; NaN = unknown.
    pub feed_mm_min: Option<&'a [f64]>,
    /// Directions of the last motion; 0 or NaN = from the order of rows.
    pub direction: Option<&'a [[f64; 3]]>,
    /// Whether each row was taken on a smooth path without a stop (0 or NaN = not). Such rows are moving, and their
    /// directions follow from the path.
    pub curve: Option<&'a [f64]>,
    /// First row of each sequence; empty = one sequence.
    pub starts: &'a [usize],
}

/// Why rows are refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum HistoryError {
    /// A column of a wrong length.
    #[error("`{column}` has {found} entries for {n_rows} rows")]
    Length {
        /// Name of the column.
        column: &'static str,
        /// Number of rows.
        n_rows: usize,
        /// Entries found.
        found: usize,
    },
    /// A first row of a sequence that is out of order.
    #[error("start {index} is row {row}: starts begin with 0, rise, and stay below the {n_rows} rows")]
    BadStart {
        /// Index among the starts.
        index: usize,
        /// The row that it names.
        row: usize,
        /// Number of rows.
        n_rows: usize,
    },
}

/// What follows from the order of rows, for every row.
///
/// # Errors
/// [`HistoryError`] for columns and starts that do not fit.
pub fn history(rows: &HistoryRows<'_>) -> Result<Vec<Past>, HistoryError> {
    rows.check()?;
    let n_rows = rows.q_mm.len();
    let mut all = Vec::with_capacity(n_rows);
    let whole = [0];
    let starts = if rows.starts.is_empty() { &whole[..] } else { rows.starts };
    for (index, &start) in starts.iter().enumerate() {
        let end = starts.get(index + 1).copied().unwrap_or(n_rows);
        all.extend(sequence(rows, start..end));
    }
    Ok(all)
}

fn sequence(rows: &HistoryRows<'_>, range: Range<usize>) -> impl Iterator<Item = Past> {
    let mut history = History::new();
    let mut motion = motions(rows, range.clone());
    let is_set = |column: Option<&[f64]>, row: usize| {
        column.is_some_and(|column| column[row] != 0.0 && !column[row].is_nan())
    };
    range.map(move |row| {
        history.step(&Moment {
            q_mm: rows.q_mm[row],
            t_s: rows.t_s.map_or(row as f64, |t_s| t_s[row]),
            is_moving: is_set(rows.moving, row) || is_set(rows.curve, row),
            feed_mm_min: rows.feed_mm_min.map_or(f64::NAN, |feed| feed[row]),
            direction: rows.direction.map_or([f64::NAN; 3], |direction| direction[row]),
            motion: motion.next().flatten(),
        })
    })
}

impl HistoryRows<'_> {
    fn check(&self) -> Result<(), HistoryError> {
        let n_rows = self.q_mm.len();
        let lengths = [
            ("t", self.t_s.map(<[f64]>::len)),
            ("moving", self.moving.map(<[f64]>::len)),
            ("feed", self.feed_mm_min.map(<[f64]>::len)),
            ("direction", self.direction.map(<[[f64; 3]]>::len)),
            ("curve", self.curve.map(<[f64]>::len)),
        ];
        for (column, found) in lengths {
            if let Some(found) = found
                && found != n_rows
            {
                return Err(HistoryError::Length { column, n_rows, found });
            }
        }
        for (index, &row) in self.starts.iter().enumerate() {
            let is_in_order = if index == 0 { row == 0 } else { row > self.starts[index - 1] };
            if !is_in_order || row >= n_rows {
                return Err(HistoryError::BadStart { index, row, n_rows });
            }
        }
        Ok(())
    }
}
