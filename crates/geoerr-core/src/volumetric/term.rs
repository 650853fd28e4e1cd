//! Terms: expressions and bases on channels, with the coefficients that they share.

use serde::{Deserialize, Serialize};

use super::VolumetricError;
use crate::bases::Basis;
use crate::expression::Expression;
use crate::kinematics::{Axis, Chain, Channel};

/// A scalar function of a row, linear in its coefficients.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum Shape {
    /// Functions of one axis position; the k-th belongs to the term's k-th coefficient.
    Basis {
        /// The axis whose position they take.
        axis: Axis,
        /// The functions.
        basis: Basis,
    },
    /// A formula.
    Expression {
        /// The formula.
        expression: Expression,
        /// For each coefficient of the formula, its place among the term's.
        coefficients: Vec<usize>,
        /// For each inner parameter of the formula, its place among the term's.
        inner: Vec<usize>,
    },
}

/// A shape on a channel.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Part {
    /// Where the displacement enters the chain.
    pub channel: Channel,
    /// What the shape is multiplied with.
    pub factor: f64,
    /// The shape.
    pub shape: Shape,
}

/// Parts that share their coefficients: a classic error, or a physical effect.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Term {
    /// Where and how it acts.
    pub parts: Vec<Part>,
    /// Number of linear coefficients.
    pub n_coefficients: usize,
    /// Number of inner parameters.
    pub n_inner: usize,
}

/// A machine whose errors are a sum of terms.
///
/// Coefficients of all terms stand one after the other, in the order of the terms; so do the inner parameters.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct VolumetricModel {
    chain: Chain,
    tool_offset_mm: [f64; 3],
    terms: Vec<Term>,
    first_coefficient: Vec<usize>,
    first_inner: Vec<usize>,
    /// Channels on which some part acts, each once, in the order of [`Channel::index`].
    channels: Vec<Channel>,
}

impl VolumetricModel {
    /// Joins terms on a machine.
    ///
    /// # Errors
    /// [`VolumetricError::PartCoefficients`] where a part does not fit its term's coefficients.
    pub fn new(chain: Chain, tool_offset_mm: [f64; 3], terms: Vec<Term>) -> Result<Self, VolumetricError> {
        for (term, parts) in terms.iter().enumerate() {
            for part in &parts.parts {
                check(term, part, parts)?;
            }
        }
        let mut channels: Vec<Channel> =
            terms.iter().flat_map(|term| &term.parts).map(|p| p.channel).collect();
        channels.sort_by_key(|channel| channel.index());
        channels.dedup();
        let starts = |count: fn(&Term) -> usize| {
            terms
                .iter()
                .scan(0, |next, term| {
                    let first = *next;
                    *next += count(term);
                    Some(first)
                })
                .collect()
        };
        let (first_coefficient, first_inner) = (starts(|t| t.n_coefficients), starts(|t| t.n_inner));
        Ok(Self { chain, tool_offset_mm, terms, first_coefficient, first_inner, channels })
    }

    /// The order of the axes.
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// From the carriage origin to the tool point.
    pub fn tool_offset_mm(&self) -> &[f64; 3] {
        &self.tool_offset_mm
    }

    /// The terms.
    pub fn terms(&self) -> &[Term] {
        &self.terms
    }

    /// Place of a term's first coefficient among all.
    pub fn first_coefficient(&self, term: usize) -> usize {
        self.first_coefficient[term]
    }

    /// Place of a term's first inner parameter among all.
    pub fn first_inner(&self, term: usize) -> usize {
        self.first_inner[term]
    }

    /// Number of coefficients of all terms.
    pub fn n_coefficients(&self) -> usize {
        self.terms.iter().map(|term| term.n_coefficients).sum()
    }

    /// Number of inner parameters of all terms.
    pub fn n_inner(&self) -> usize {
        self.terms.iter().map(|term| term.n_inner).sum()
    }

    /// The machine as it is, without what only explains measurements of it; parameters keep their places.
    #[must_use]
    pub fn without_rig(&self) -> Self {
        let mut machine = self.clone();
        for term in &mut machine.terms {
            term.parts.retain(|part| !part.channel.is_rig());
        }
        machine.channels.retain(|channel| !channel.is_rig());
        machine
    }

    /// Channels on which some part acts.
    pub(super) fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// All parts with their term's number.
    pub(super) fn parts(&self) -> impl Iterator<Item = (usize, &Part)> {
        self.terms.iter().enumerate().flat_map(|(term, all)| all.parts.iter().map(move |part| (term, part)))
    }
}

fn check(term: usize, part: &Part, parts: &Term) -> Result<(), VolumetricError> {
    let fits = match &part.shape {
        Shape::Basis { basis, .. } => basis.len() == parts.n_coefficients,
        Shape::Expression { expression, coefficients, inner } => {
            coefficients.len() == expression.coefficients().len()
                && inner.len() == expression.inner().len()
                && coefficients.iter().all(|&place| place < parts.n_coefficients)
                && inner.iter().all(|&place| place < parts.n_inner)
        }
    };
    if fits { Ok(()) } else { Err(VolumetricError::PartCoefficients { term, channel: part.channel.name() }) }
}
