//! Motion on a smooth path, from rows on it: tangent and curvature of the circle through three neighbours.
//!
//! Chords a (to the row) and b (from it) of a circle lean by half their angles to either side of the tangent between
//! them, and are twice the radius times the sine of that: a/|a|² + b/|b|² lies along the tangent, exactly, for any
//! spacing. The curvature is Menger's, 2|a × b| / (|a| |b| |a + b|).

use std::ops::Range;

use super::{HistoryRows, Motion};

type Vector = [f64; 3];

/// A smooth path at one row.
#[derive(Clone, Copy, Debug)]
struct Bend {
    tangent: Vector,
    /// Curvature towards the centre.
    curvature_per_mm: Vector,
}

/// The motion at each row of a sequence; `None` where the row is on no curve, or its motion cannot be known.
pub(super) fn motions(rows: &HistoryRows<'_>, range: Range<usize>) -> impl Iterator<Item = Option<Motion>> {
    let mut all = vec![None; range.len()];
    if let Some(curve) = rows.curve {
        let is_on = |row: usize| curve[row] != 0.0 && !curve[row].is_nan();
        let mut first = range.start;
        while first < range.end {
            let mut end = first + 1;
            while is_on(first) && end < range.end && is_on(end) {
                end += 1;
            }
            if is_on(first) {
                run(rows, first..end, &mut all[first - range.start..end - range.start]);
            }
            first = end;
        }
    }
    all.into_iter()
}

/// One uninterrupted curve. A row at the place of the one before it shares its motion.
fn run(rows: &HistoryRows<'_>, range: Range<usize>, motions: &mut [Option<Motion>]) {
    let mut places: Vec<usize> = Vec::with_capacity(range.len());
    let mut place_of = Vec::with_capacity(range.len());
    for row in range.clone() {
        if places.last().is_none_or(|&last| rows.q_mm[last] != rows.q_mm[row]) {
            places.push(row);
        }
        place_of.push(places.len() - 1);
    }
    let n = places.len();
    if n < 2 {
        return;
    }
    let q = |place: usize| rows.q_mm[places[place]];
    let bend = |place: usize| {
        if n == 2 {
            let tangent = unit(difference(q(1), q(0)));
            return Bend { tangent, curvature_per_mm: [0.0; 3] };
        }
        // The ends lie on the circle of their neighbour.
        let middle = place.clamp(1, n - 2);
        let (a, b) = (difference(q(middle), q(middle - 1)), difference(q(middle + 1), q(middle)));
        let at_middle = through(a, b);
        match place {
            _ if place == middle => at_middle,
            0 => at_middle.mirrored(a),
            _ => at_middle.mirrored(b),
        }
    };
    let motion = |place: usize| {
        let Bend { tangent, curvature_per_mm } = bend(place);
        let row = places[place];
        let (from, to) = (place.saturating_sub(1), (place + 1).min(n - 1));
        let per_mm = norm(curvature_per_mm);
        let length = |from: usize, to: usize| arc(norm(difference(q(to), q(from))), per_mm);
        let feed_mm_s = rows.feed_mm_min.map_or(f64::NAN, |feed| feed[row] / 60.0);
        let is_known = !feed_mm_s.is_nan();
        let speed_mm_s = if is_known {
            feed_mm_s
        } else {
            // From the times of the neighbours, along the arcs between them.
            let length_mm: f64 = (from..to).map(|place| length(place, place + 1)).sum();
            let time = |place: usize| rows.t_s.map_or(places[place] as f64, |t_s| t_s[places[place]]);
            length_mm / (time(to) - time(from))
        };
        let step_s = if is_known && place > 0 { length(place - 1, place) / speed_mm_s } else { f64::NAN };
        (speed_mm_s.is_finite()).then(|| Motion {
            v_mm_s: tangent.map(|part| speed_mm_s * part),
            a_mm_s2: curvature_per_mm.map(|part| speed_mm_s * speed_mm_s * part),
            step_s,
        })
    };
    let by_place: Vec<Option<Motion>> = (0..n).map(motion).collect();
    for (index, &place) in place_of.iter().enumerate() {
        motions[index] = by_place[place];
        // Seen again without having moved: no time has passed on the path.
        if index > 0
            && place_of[index - 1] == place
            && let Some(motion) = &mut motions[index]
            && !motion.step_s.is_nan()
        {
            motion.step_s = 0.0;
        }
    }
}

/// The circle through three points, at the middle one; `a` and `b` lead to it and from it.
fn through(a: Vector, b: Vector) -> Bend {
    let (aa, bb) = (dot(a, a), dot(b, b));
    let tangent = unit([0, 1, 2].map(|k| a[k] / aa + b[k] / bb));
    let turned = [0, 1, 2].map(|k| b[k] / bb.sqrt() - a[k] / aa.sqrt());
    let along = dot(turned, tangent);
    let across = [0, 1, 2].map(|k| turned[k] - along * tangent[k]);
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let span = norm([0, 1, 2].map(|k| a[k] + b[k]));
    let per_mm = 2.0 * norm(cross) / (aa.sqrt() * bb.sqrt() * span);
    let length = norm(across);
    let is_bent = per_mm.is_finite() && length > 0.0;
    let curvature_per_mm = if is_bent { across.map(|part| per_mm * part / length) } else { [0.0; 3] };
    Bend { tangent, curvature_per_mm }
}

impl Bend {
    /// The same circle at the other end of a chord.
    fn mirrored(self, chord: Vector) -> Self {
        let along = unit(chord);
        let (t, c) = (dot(self.tangent, along), dot(self.curvature_per_mm, along));
        Self {
            tangent: [0, 1, 2].map(|k| 2.0 * t * along[k] - self.tangent[k]),
            curvature_per_mm: [0, 1, 2].map(|k| self.curvature_per_mm[k] - 2.0 * c * along[k]),
        }
    }
}

/// Length of the arc over a chord.
fn arc(chord_mm: f64, per_mm: f64) -> f64 {
    let half = 0.5 * chord_mm * per_mm;
    if half < 1e-8 { chord_mm } else { 2.0 / per_mm * half.min(1.0).asin() }
}

fn difference(a: Vector, b: Vector) -> Vector {
    [0, 1, 2].map(|k| a[k] - b[k])
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn norm(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

fn unit(a: Vector) -> Vector {
    let length = norm(a);
    a.map(|part| part / length)
}
