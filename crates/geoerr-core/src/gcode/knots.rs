//! Where a smooth function has to be cut so that a parabola follows it between the cuts.

/// Samples of the whole range: of 400 mm one each 0.05 mm, so that a period of 0.2 mm (four full steps of a usual drive)
/// is seen.
const SAMPLES: usize = 8192;

/// Largest distance of the function from a parabola through both ends and the middle of a piece, mm: what path splitting
/// leaves to terms beyond the quadratic.
const TOLERANCE_MM: f64 = 2e-5;

/// Rising positions that cut `range_mm` so that between neighbours `error` is all but a parabola, each of `kinks_mm` among
/// them.
///
/// Halves a piece until the parabola through its ends and its middle meets all samples in between. Kinks that are not named
/// are found to a sample's width.
pub(super) fn knots(range_mm: (f64, f64), kinks_mm: &[f64], error: impl Fn(f64) -> [f64; 3]) -> Vec<f64> {
    let (low_mm, high_mm) = range_mm;
    let length_mm = high_mm - low_mm;
    let mut knots_mm = kinks_mm.to_vec();
    if !(length_mm > 0.0 && length_mm.is_finite()) {
        return knots_mm;
    }
    let mut edges_mm = vec![low_mm];
    edges_mm.extend(kinks_mm.iter().filter(|&&kink| low_mm < kink && kink < high_mm));
    edges_mm.push(high_mm);
    for ends in edges_mm.windows(2) {
        let (begin_mm, width_mm) = (ends[0], ends[1] - ends[0]);
        let wanted = (width_mm / length_mm * SAMPLES as f64).ceil() as usize;
        let n_cells = wanted.max(2).next_power_of_two();
        let position = |sample: usize| {
            if sample == n_cells { ends[1] } else { begin_mm + width_mm * sample as f64 / n_cells as f64 }
        };
        // A value at a kink belongs to the piece on its right.
        let inside = |sample: usize| position(sample).min(ends[1] - 1e-9 * width_mm);
        let samples: Vec<[f64; 3]> = (0..=n_cells).map(|sample| error(inside(sample))).collect();
        cut(&samples, 0, n_cells, &mut |sample| knots_mm.push(position(sample)));
    }
    knots_mm.sort_by(f64::total_cmp);
    knots_mm.dedup();
    knots_mm
}

/// Halves `first..=last` where the parabola misses a sample.
fn cut(samples: &[[f64; 3]], first: usize, last: usize, at: &mut impl FnMut(usize)) {
    let width = last - first;
    if width < 2 {
        return;
    }
    let middle = first + width / 2;
    let [a, b, c] = [samples[first], samples[middle], samples[last]];
    let misses = (first..=last).any(|sample| {
        let s = (sample - first) as f64 / width as f64;
        let weights = [(1.0 - s) * (1.0 - 2.0 * s), 4.0 * s * (1.0 - s), s * (2.0 * s - 1.0)];
        let off: [f64; 3] = std::array::from_fn(|k| {
            samples[sample][k] - weights[0] * a[k] - weights[1] * b[k] - weights[2] * c[k]
        });
        off.iter().map(|x| x * x).sum::<f64>() > TOLERANCE_MM * TOLERANCE_MM
    });
    if misses {
        cut(samples, first, middle, at);
        at(middle);
        cut(samples, middle, last, at);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polygon_is_cut_at_its_kinks_only() {
        let polygon = |q: f64| [if q < 100.0 { 1e-3 * q } else { 0.1 - 2e-3 * (q - 100.0) }, 0.0, 0.0];
        assert_eq!(knots((0.0, 400.0), &[100.0], polygon), [100.0]);
        assert_eq!(knots((0.0, 400.0), &[], |q| [1e-5 * q * q, 0.0, 0.0]), [0.0; 0]);
    }

    #[test]
    fn between_cuts_a_parabola_follows() {
        let wave = |q: f64| [0.02 * (std::f64::consts::TAU * q / 2.0).sin(), 0.0, 1e-9 * q * q * q];
        let cuts = knots((0.0, 400.0), &[], wave);
        let edges: Vec<f64> = std::iter::once(0.0).chain(cuts).chain([400.0]).collect();
        for ends in edges.windows(2) {
            let [a, b, c] = [ends[0], 0.5 * (ends[0] + ends[1]), ends[1]].map(|q| wave(q)[0]);
            for i in 0..=20 {
                let s = f64::from(i) / 20.0;
                let parabola =
                    (1.0 - s) * (1.0 - 2.0 * s) * a + 4.0 * s * (1.0 - s) * b + s * (2.0 * s - 1.0) * c;
                let off = (wave(ends[0] + s * (ends[1] - ends[0]))[0] - parabola).abs();
                assert!(off < 2.0 * TOLERANCE_MM, "{off} at {ends:?}");
            }
        }
    }

    #[test]
    fn a_kink_that_is_not_named_is_found_to_a_sample() {
        let cuts = knots((0.0, 400.0), &[], |q| [1e-3 * (q - 123.4).abs(), 0.0, 0.0]);
        let nearest = cuts.iter().map(|cut| (cut - 123.4).abs()).fold(f64::INFINITY, f64::min);
        assert!(nearest < 400.0 / SAMPLES as f64, "{nearest}");
        assert!(cuts.len() < 20);
    }
}
