//! Rising positions, and which cell between two of them a position lies in.

use super::BasisError;

/// Farthest position from 0: a thousand kilometres.
const MOST_MM: f64 = 1e9;
/// Least distance of neighbouring positions: a nanometre. Powers of its inverse stay far from overflow.
pub(super) const LEAST_STEP_MM: f64 = 1e-6;

/// Refuses a position that is not finite or not on a machine.
pub(super) fn check_position(what: &'static str, index: usize, position_mm: f64) -> Result<(), BasisError> {
    // Written so that NaN is refused.
    if position_mm.abs() <= MOST_MM {
        Ok(())
    } else {
        Err(BasisError::Position { what, index, position_mm, most_mm: MOST_MM })
    }
}

/// Refuses positions that are not finite, or that do not rise by at least a nanometre.
pub(super) fn check_rising(what: &'static str, positions_mm: &[f64]) -> Result<(), BasisError> {
    for (index, &position_mm) in positions_mm.iter().enumerate() {
        check_position(what, index, position_mm)?;
    }
    for (index, pair) in positions_mm.windows(2).enumerate() {
        if pair[1] - pair[0] < LEAST_STEP_MM {
            return Err(BasisError::NotRising {
                what,
                index: index + 1,
                previous_mm: pair[0],
                position_mm: pair[1],
                least_mm: LEAST_STEP_MM,
            });
        }
    }
    Ok(())
}

/// How many of some rising positions lie at or below a given one, in nearly constant time.
///
/// The range is cut into as many equal buckets as there are cells; each knows the cells that it touches. The bucket
/// of a position never falls while the position rises, in floating point too, so that the bounds are sure.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Search {
    positions_mm: Vec<f64>,
    buckets_per_mm: f64,
    /// Least and largest answer in each bucket.
    buckets: Vec<(u32, u32)>,
}

impl Search {
    /// `positions_mm` must rise; they may be none.
    pub(super) fn new(positions_mm: Vec<f64>) -> Self {
        let (Some(&low_mm), Some(&high_mm)) = (positions_mm.first(), positions_mm.last()) else {
            return Self::default();
        };
        let n_buckets = positions_mm.len().max(2) - 1;
        let buckets_per_mm = if high_mm > low_mm { n_buckets as f64 / (high_mm - low_mm) } else { 0.0 };
        let bucket_of =
            |position_mm: f64| (((position_mm - low_mm) * buckets_per_mm) as usize).min(n_buckets - 1);
        let mut buckets = vec![(u32::MAX, 0); n_buckets];
        for (index, pair) in positions_mm.windows(2).enumerate() {
            let count = index as u32 + 1;
            for bucket in &mut buckets[bucket_of(pair[0])..=bucket_of(pair[1])] {
                bucket.0 = bucket.0.min(count);
                bucket.1 = bucket.1.max(count);
            }
        }
        Self { positions_mm, buckets_per_mm, buckets }
    }

    pub(super) fn positions_mm(&self) -> &[f64] {
        &self.positions_mm
    }

    /// Number of positions at or below `q_mm`; 0 for NaN.
    #[inline]
    pub(super) fn count(&self, q_mm: f64) -> usize {
        let (Some(&low_mm), Some(&high_mm)) = (self.positions_mm.first(), self.positions_mm.last()) else {
            return 0;
        };
        if q_mm >= high_mm {
            return self.positions_mm.len();
        }
        if q_mm < low_mm || q_mm.is_nan() {
            return 0;
        }
        let bucket = (((q_mm - low_mm) * self.buckets_per_mm) as usize).min(self.buckets.len() - 1);
        let (least, largest) = self.buckets[bucket];
        let (mut least, largest) = (least as usize, largest as usize);
        if largest - least > 8 {
            return least + self.positions_mm[least..largest].partition_point(|&position| position <= q_mm);
        }
        while least < largest && self.positions_mm[least] <= q_mm {
            least += 1;
        }
        least
    }

    /// The cell of a position: 0 to the number of positions less 2, positions outside in the end cells.
    #[inline]
    pub(super) fn cell(&self, q_mm: f64) -> usize {
        self.count(q_mm).clamp(1, self.positions_mm.len() - 1) - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

        /// Against the binary search of the standard library, at, just beside and between the positions.
        #[test]
        fn counts_as_a_binary_search(
            start in -1e3..1e3_f64,
            steps in prop::collection::vec(prop_oneof![1e-6..1e-3_f64, 0.1..90.0_f64], 0..60),
            between in prop::collection::vec(-0.2..1.2_f64, 20),
        ) {
            let mut positions = vec![start];
            positions.extend(steps.iter().scan(start, |at, step| { *at += step; Some(*at) }));
            let search = Search::new(positions.clone());
            let length = positions[positions.len() - 1] - start;
            let beside = positions.iter().flat_map(|&p| [p.next_down(), p, p.next_up()]);
            for q in beside.chain(between.iter().map(|t| start + t * length)).chain([f64::INFINITY, f64::NAN]) {
                prop_assert_eq!(search.count(q), positions.partition_point(|&p| p <= q), "at {}", q);
            }
        }
    }

    #[test]
    fn none_and_one() {
        assert_eq!(Search::new(vec![]).count(3.0), 0);
        let one = Search::new(vec![5.0]);
        assert_eq!([4.9, 5.0, 6.0].map(|q| one.count(q)), [0, 1, 1]);
    }
}
