//! Edges of boxes along one axis.

/// Widest box.
const WIDEST_MM: f64 = 10.0;

/// More edges than this are no use: boxes are listed.
const MOST_EDGES: usize = 1 << 19;

/// Edges of the boxes along one axis, with a way to find the cell of a position without searching.
#[derive(Debug)]
pub struct Edges {
    edges_mm: Vec<f64>,
    low_mm: f64,
    buckets_per_mm: f64,
    /// The cell in which each bucket begins.
    first: Vec<u32>,
}

impl Edges {
    /// Edges within a range: its ends, the knots, and as many between them as keep boxes narrow; None for too many.
    pub fn new(range_mm: (f64, f64), knots_mm: &[f64]) -> Option<Self> {
        let (low_mm, high_mm) = range_mm;
        let length_mm = high_mm - low_mm;
        if !(length_mm > 0.0 && length_mm.is_finite()) {
            return None;
        }
        let inner = knots_mm.iter().copied().filter(|&knot| low_mm < knot && knot < high_mm);
        let kinks_mm: Vec<f64> = std::iter::once(low_mm).chain(inner).chain([high_mm]).collect();
        let wanted: f64 = kinks_mm.windows(2).map(|pair| ((pair[1] - pair[0]) / WIDEST_MM).ceil()).sum();
        if wanted > MOST_EDGES as f64 {
            return None;
        }
        let mut edges_mm = Vec::new();
        for pair in kinks_mm.windows(2) {
            let n_cells = ((pair[1] - pair[0]) / WIDEST_MM).ceil().max(1.0);
            let inside =
                (0..n_cells as u32).map(|cell| pair[0] + f64::from(cell) / n_cells * (pair[1] - pair[0]));
            edges_mm.extend(inside);
        }
        edges_mm.push(high_mm);
        let n_buckets = 4 * (edges_mm.len() - 1);
        let buckets_per_mm = n_buckets as f64 / length_mm;
        let begin_mm = |bucket: usize| low_mm + bucket as f64 / buckets_per_mm;
        // A bucket too early is put right by the search for the cell; one too late would not be.
        let cell_of = |at_mm: f64| edges_mm.partition_point(|&edge| edge <= at_mm).saturating_sub(1);
        let first =
            (0..n_buckets).map(|bucket| cell_of(begin_mm(bucket) - 1e-9 * length_mm) as u32).collect();
        Some(Self { low_mm, buckets_per_mm, first, edges_mm })
    }

    /// Number of cells.
    #[inline]
    pub fn n_cells(&self) -> usize {
        self.edges_mm.len() - 1
    }

    /// Lower and upper edge of a cell.
    #[inline]
    pub fn ends(&self, cell: usize) -> (f64, f64) {
        (self.edges_mm[cell], self.edges_mm[cell + 1])
    }

    /// The cell from its lower edge to below its upper one; None outside.
    #[inline]
    pub fn cell(&self, at_mm: f64) -> Option<usize> {
        let bucket = (at_mm - self.low_mm) * self.buckets_per_mm;
        // Not a number is outside; what is too large is no bucket's number.
        let is_inside = bucket >= 0.0;
        let first = *is_inside.then(|| self.first.get(bucket as u32 as usize)).flatten()? as usize;
        let n_passed = self.edges_mm.get(first + 1..)?.iter().position(|&edge| at_mm < edge)?;
        Some(first + n_passed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_cell_is_found_without_searching(
            knots in proptest::collection::btree_set(0_u32..2000, 0..30),
            at in proptest::collection::vec(-10.0_f64..220.0, 20),
        ) {
            let knots: Vec<f64> = knots.into_iter().map(|knot| f64::from(knot) * 0.1).collect();
            let edges = Edges::new((0.0, 200.0), &knots).unwrap();
            prop_assert!(edges.edges_mm.windows(2).all(|pair| pair[0] < pair[1] && pair[1] - pair[0] <= 10.0 + 1e-9));
            prop_assert!(knots.iter().all(|knot| edges.edges_mm.contains(knot)));
            for at_mm in at.into_iter().chain(edges.edges_mm.clone()) {
                let n_below = edges.edges_mm.partition_point(|&edge| edge <= at_mm);
                let expected = (n_below > 0 && n_below < edges.edges_mm.len()).then(|| n_below - 1);
                prop_assert_eq!(edges.cell(at_mm), expected, "at {}", at_mm);
            }
        }
    }
}
