//! Three-dimensional eight-node elements on a grid: what Dobariya argues against, for comparison only.

use super::BasisError;
use super::cells::{Search, check_rising};

/// Most nodes of a grid.
const MOST_NODES: usize = 4096;

/// Eight-node hexahedra that fill a box: the error between eight nodes is trilinear.
///
/// The shape function of a corner is the product of three two-node ones, `N = N_i(x) N_j(y) N_k(z)`. Node (i, j, k) has
/// the number `(i·n_y + j)·n_z + k`. Outside the box the error is that of its nearest point.
///
/// # Source
/// The element of Chen et al. and Wang et al. that Dobariya et al. §4 compare one-dimensional elements with.
#[derive(Debug, Clone, PartialEq)]
pub struct Hexahedra {
    axes: [Search; 3],
}

impl Hexahedra {
    /// Elements between grid lines at these positions.
    ///
    /// # Errors
    /// [`BasisError`] for fewer than two positions along an axis, positions that do not rise, and too many nodes.
    pub fn new(nodes_mm: [Vec<f64>; 3]) -> Result<Self, BasisError> {
        for nodes_mm in &nodes_mm {
            if nodes_mm.len() < 2 {
                return Err(BasisError::TooFew { what: "grid lines", found: nodes_mm.len(), needed: 2 });
            }
            check_rising("grid line", nodes_mm)?;
        }
        let found =
            nodes_mm.iter().fold(1, |product: usize, nodes_mm| product.saturating_mul(nodes_mm.len()));
        if found > MOST_NODES {
            return Err(BasisError::TooManyFunctions { found, most: MOST_NODES });
        }
        Ok(Self { axes: nodes_mm.map(Search::new) })
    }

    /// Number of nodes.
    pub fn n_nodes(&self) -> usize {
        self.axes.iter().map(|axis| axis.positions_mm().len()).product()
    }

    /// The eight nodes around a point, and the values of their shape functions there; NaN for NaN.
    pub fn shape(&self, q_mm: &[f64; 3]) -> ([usize; 8], [f64; 8]) {
        let mut first = [0; 3];
        let mut shares = [[0.0; 2]; 3];
        for (c, axis) in self.axes.iter().enumerate() {
            let nodes_mm = axis.positions_mm();
            let held_mm = q_mm[c].clamp(nodes_mm[0], nodes_mm[nodes_mm.len() - 1]);
            first[c] = axis.cell(held_mm);
            let (start_mm, end_mm) = (nodes_mm[first[c]], nodes_mm[first[c] + 1]);
            shares[c] =
                [(end_mm - held_mm) / (end_mm - start_mm), (held_mm - start_mm) / (end_mm - start_mm)];
        }
        let [_, n_y, n_z] = [0, 1, 2].map(|c: usize| self.axes[c].positions_mm().len());
        let corner = |n: usize| [n >> 2 & 1, n >> 1 & 1, n & 1];
        let nodes = std::array::from_fn(|n| {
            let [i, j, k] = corner(n);
            ((first[0] + i) * n_y + first[1] + j) * n_z + first[2] + k
        });
        let values = std::array::from_fn(|n| {
            let [i, j, k] = corner(n);
            shares[0][i] * shares[1][j] * shares[2][k]
        });
        (nodes, values)
    }

    /// One row of all nodes' shape functions for each point: point by point.
    pub fn rows(&self, q_mm: &[[f64; 3]]) -> Vec<f64> {
        let n_nodes = self.n_nodes();
        let mut rows = vec![0.0; q_mm.len() * n_nodes];
        for (q_mm, row) in q_mm.iter().zip(rows.chunks_exact_mut(n_nodes)) {
            let (nodes, values) = self.shape(q_mm);
            for (node, value) in nodes.iter().zip(values) {
                row[*node] = value;
            }
        }
        rows
    }
}
