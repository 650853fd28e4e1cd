//! How many of the singular values are not noise.

use serde::{Deserialize, Serialize};

/// The first tolerance is multiplied by this to bound the range in which a gap may move the cut.
const GAP_WINDOW: f64 = 1e3;

/// Where singular values were cut.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RankDecision {
    /// Singular values kept.
    pub rank: usize,
    /// Relative to the largest singular value: what was asked for, or rows × ε.
    pub tolerance: f64,
    /// Last singular value kept over the first one dropped, which counts as at least ε times the largest.
    ///
    /// Below about 1000 the decision hangs on the tolerance: the data nearly determine, or nearly do not.
    pub gap: f64,
}

/// The tolerance, relative to the largest singular value, that rounding of the entries makes necessary.
pub(super) fn default_tolerance(n_rows: usize, n_columns: usize) -> f64 {
    n_rows.max(n_columns).max(1) as f64 * f64::EPSILON
}

/// A relative singular value above which no cut is made unless a tolerance is asked for.
pub(super) fn surely_kept(n_rows: usize, n_columns: usize, tolerance: Option<f64>) -> f64 {
    tolerance.unwrap_or(GAP_WINDOW * default_tolerance(n_rows, n_columns))
}

/// Cuts falling singular values.
///
/// With a tolerance: there. Without: at rows × ε, or, where the neighbourhood shows a wider gap, there. Entries that are
/// themselves computed carry errors of several ε, so zero singular values turn up some orders above ε, close to one another;
/// the cut is moved to the widest gap whose upper side is above ε and whose lower side is below 1000 × rows × ε.
pub(super) fn decide(values: &[f64], n_rows: usize, n_columns: usize, asked: Option<f64>) -> RankDecision {
    let tolerance = asked.unwrap_or(default_tolerance(n_rows, n_columns));
    let largest = values.first().copied().unwrap_or(0.0);
    if largest == 0.0 {
        return RankDecision { rank: 0, tolerance, gap: f64::INFINITY };
    }
    let floor = f64::EPSILON;
    let relative = |index: usize| values.get(index).map_or(floor, |value| (value / largest).max(floor));
    let gap_after = |rank: usize| relative(rank - 1) / relative(rank);
    let at_tolerance = values.iter().take_while(|&&value| value > tolerance * largest).count().max(1);
    let rank = if asked.is_some() {
        at_tolerance
    } else {
        (1..=values.len())
            .filter(|&rank| rank == at_tolerance || relative(rank) < GAP_WINDOW * tolerance)
            .fold(at_tolerance, |best, rank| if gap_after(rank) > gap_after(best) { rank } else { best })
    };
    RankDecision { rank, tolerance, gap: gap_after(rank) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clean_values_are_cut_at_the_tolerance() {
        let decision = decide(&[1.0, 0.3, 1e-3, 1e-17], 100, 4, None);
        assert_eq!(decision.rank, 3);
        assert!(decision.gap > 1e12);
    }

    #[test]
    fn zeros_above_the_tolerance_are_recognised_by_the_gap() {
        // 3000 rows: the tolerance is 6.7e-13; errors of computed entries leave the zeros at 1e-12.
        assert_eq!(decide(&[1.0, 0.3, 1e-4, 2e-12, 1e-12, 5e-13], 3000, 6, None).rank, 3);
    }

    #[test]
    fn a_small_value_that_stands_alone_is_kept() {
        assert_eq!(decide(&[1.0, 1e-4, 3e-10], 3000, 3, None).rank, 3);
        assert_eq!(decide(&[1.0, 1e-4, 3e-10, 1e-16], 3000, 4, None).rank, 3);
    }

    #[test]
    fn an_asked_tolerance_is_final() {
        assert_eq!(decide(&[1.0, 1e-4, 3e-10], 3000, 3, Some(1e-6)).rank, 2);
        assert_eq!(decide(&[1.0, 1e-4, 3e-10], 3000, 3, Some(0.0)).rank, 3);
    }

    #[test]
    fn nothing_has_rank_zero() {
        assert_eq!(decide(&[], 0, 0, None).rank, 0);
        assert_eq!(decide(&[0.0, 0.0], 5, 2, None).rank, 0);
    }
}
