//! One position at a time: the value and its gradient by x, y and z, as compensation asks for them.

use super::functions::{Binary, Unary, select};
use super::graph::{Graph, Node, NodeId};

/// One number from those before it.
#[derive(Clone, Copy, Debug)]
enum Number {
    Constant(f64),
    Variable(usize),
    Inner(usize),
    Unary(Unary, usize),
    Binary(Binary, usize, usize),
    Select([usize; 3]),
    /// What the stroke before left unwound, by the number of the wind-up.
    Unwound(usize),
}

/// A term of a result: coefficient that multiplies it, if any, and place of the number.
#[derive(Clone, Copy, Debug)]
struct Term {
    coefficient: Option<usize>,
    number: usize,
}

/// A formula for single positions, history settled; see [`super::derive::settled`].
#[derive(Clone, Debug)]
pub(super) struct PointTape {
    numbers: Vec<Number>,
    value: Vec<Term>,
    gradient: [Vec<Term>; 3],
}

/// Numbers that are kept without a heap.
const ON_STACK: usize = 64;

/// Coefficient and what it multiplies.
pub(super) type PointTerm = (Option<usize>, NodeId);

impl PointTape {
    /// Compiles sums of terms, for the value and for its three derivatives.
    pub(super) fn compile(graph: &Graph, value: &[PointTerm], gradient: &[Vec<PointTerm>; 3]) -> Self {
        let all = value.iter().chain(gradient.iter().flatten());
        let is_needed = graph.needed_by(all.map(|&(_, node)| node));
        let mut place = vec![0; graph.len()];
        let mut numbers = Vec::new();
        for id in graph.ids().filter(|id| is_needed[id.index()]) {
            let at = |id: NodeId| place[id.index()];
            let number = match graph.node(id) {
                Node::Constant(bits) => Number::Constant(f64::from_bits(bits)),
                Node::Variable(index) => Number::Variable(index as usize),
                Node::Inner(index) => Number::Inner(index as usize),
                Node::Unary(operation, a) => Number::Unary(operation, at(a)),
                Node::Binary(operation, a, b) => Number::Binary(operation, at(a), at(b)),
                Node::Select(operands) => Number::Select(operands.map(at)),
                Node::Unwound(number) => Number::Unwound(number as usize),
                // A settled formula has none.
                Node::Lag(_) | Node::LagTangent(_) | Node::Windup(_) | Node::WindupTangent(_) => {
                    Number::Constant(f64::NAN)
                }
            };
            place[id.index()] = numbers.len();
            numbers.push(number);
        }
        let terms = |terms: &[PointTerm]| {
            terms
                .iter()
                .map(|&(coefficient, node)| Term { coefficient, number: place[node.index()] })
                .collect()
        };
        let [x, y, z] = gradient;
        Self { value: terms(value), gradient: [terms(x), terms(y), terms(z)], numbers }
    }

    /// Value and gradient at one point; `unwound` tells what the stroke before left of each wind-up.
    pub(super) fn evaluate(
        &self,
        point: &[f64],
        coefficients: &[f64],
        inner: &[f64],
        unwound: impl Fn(usize) -> f64,
    ) -> (f64, [f64; 3]) {
        if self.numbers.len() <= ON_STACK {
            self.evaluate_in(&mut [0.0; ON_STACK], point, coefficients, inner, unwound)
        } else {
            self.evaluate_in(&mut vec![0.0; self.numbers.len()], point, coefficients, inner, unwound)
        }
    }

    fn evaluate_in(
        &self,
        values: &mut [f64],
        point: &[f64],
        coefficients: &[f64],
        inner: &[f64],
        unwound: impl Fn(usize) -> f64,
    ) -> (f64, [f64; 3]) {
        for (index, number) in self.numbers.iter().enumerate() {
            values[index] = match *number {
                Number::Constant(value) => value,
                Number::Variable(index) => point[index],
                Number::Inner(index) => inner[index],
                Number::Unary(operation, a) => operation.apply(values[a]),
                Number::Binary(operation, a, b) => operation.apply(values[a], values[b]),
                Number::Unwound(number) => unwound(number),
                Number::Select([condition, a, b]) => select(values[condition], values[a], values[b]),
            };
        }
        let sum = |terms: &[Term]| -> f64 {
            let factor = |term: &Term| term.coefficient.map_or(1.0, |index| coefficients[index]);
            terms.iter().map(|term| factor(term) * values[term.number]).sum()
        };
        (sum(&self.value), [0, 1, 2].map(|axis| sum(&self.gradient[axis])))
    }
}
