//! Terms with their parameters and conditions put in: curves of each axis, constants, and formulas that remain.

use std::collections::BTreeMap;

use super::{Approach, MAX_WINDUPS, MachineError, MotionNeeds, Windup};
use crate::bases::{Curve, CurveSet};
use crate::expression::{Expression, FollowedWindup};
use crate::kinematics::{Axis, Channel, Component, Displacements};
use crate::volumetric::values::check_parameters;
use crate::volumetric::{Shape, VolumetricError, VolumetricModel};

/// Where the value of a variable comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    Position(usize),
    Offset(usize),
    /// Place on the work: `bed_x bed_y`.
    Place(usize),
    Direction(usize),
    Travel(usize),
    Velocity(usize),
    Feed,
}

impl Source {
    /// What position and motion give; none for a condition.
    fn of(name: &str) -> Option<Self> {
        let axis = |letter: &str| ["x", "y", "z"].iter().position(|&known| known == letter);
        if name == "feed" {
            return Some(Self::Feed);
        }
        if let Some(axis) = axis(name) {
            return Some(Self::Position(axis));
        }
        if let Some(axis) = name.strip_prefix('t').and_then(axis) {
            return Some(Self::Offset(axis));
        }
        let (head, letter) = name.rsplit_once('_')?;
        let axis = axis(letter)?;
        match head {
            "bed" if axis < 2 => Some(Self::Place(axis)),
            "d" => Some(Self::Direction(axis)),
            "s" => Some(Self::Travel(axis)),
            "v" => Some(Self::Velocity(axis)),
            _ => None,
        }
    }

    fn is_motion(self) -> bool {
        matches!(self, Self::Direction(_) | Self::Travel(_) | Self::Velocity(_) | Self::Feed)
    }
}

/// A function of more than its own axis's position, on a channel.
#[derive(Debug, Clone)]
struct Law {
    channel: Channel,
    function: Function,
}

#[derive(Debug, Clone)]
enum Function {
    Formula {
        /// Number of its term.
        term: usize,
        factor: f64,
        expression: Expression,
        coefficients: Vec<f64>,
        inner: Vec<f64>,
        /// For each of its wind-ups, the place among the machine's; none where it follows long strokes.
        windups: Vec<Option<usize>>,
    },
    /// On a channel that is no joint error of this axis.
    Curve { axis: Axis, curve: Curve },
}

impl Function {
    /// Value and gradient by x, y, z; `point` holds the variables of formulas.
    #[inline]
    fn at(&self, q_mm: &[f64; 3], point: &[f64], left_unwound: &[f64; MAX_WINDUPS]) -> (f64, [f64; 3]) {
        match self {
            Self::Formula { factor, expression, coefficients, inner, windups, .. } => {
                let unwound = |number: usize| windups[number].map_or(0.0, |place| left_unwound[place]);
                // Lengths were checked when it was bound.
                let at = expression.evaluate_behind(point, coefficients, inner, unwound);
                let (value, gradient) = at.unwrap_or((f64::NAN, [f64::NAN; 3]));
                (factor * value, gradient.map(|by| factor * by))
            }
            Self::Curve { axis, curve } => {
                let (value, slope) = curve.value_and_slope(q_mm[axis.index()]);
                let mut gradient = [0.0; 3];
                gradient[axis.index()] = slope;
                (value, gradient)
            }
        }
    }
}

/// What one position asks of formulas.
#[derive(Debug, Clone, Copy)]
pub(super) struct Question<'a> {
    pub(super) q_mm: &'a [f64; 3],
    pub(super) offset_mm: &'a [f64; 3],
    /// Place on the work.
    pub(super) place_mm: &'a [f64; 3],
    pub(super) approach: &'a Approach,
}

/// Numbers of the channels, and their derivatives by x, y and z.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Numbers {
    pub(super) values: Displacements,
    pub(super) rates: [Displacements; 3],
}

/// Terms with everything put in that does not change from position to position.
#[derive(Debug, Clone)]
pub(super) struct Bound {
    pub(super) curves: [CurveSet<6>; 3],
    /// Squarenesses and bodies' displacements that are the same everywhere; constant joint errors are in the curves.
    pub(super) constants: Displacements,
    laws: Vec<Law>,
    /// Values of the variables, with the conditions in their places.
    template: Vec<f64>,
    sources: Vec<(usize, Source)>,
    pub(super) needs: MotionNeeds,
    /// Names of the variables that each move gives.
    pub(super) motion_names: Vec<String>,
    pub(super) is_nominal: bool,
    /// Wind-ups that are followed from stroke to stroke.
    pub(super) windups: Vec<Windup>,
    /// Numbers of the terms with wind-ups that are not: they are as behind a long stroke.
    pub(super) long_stroke_terms: Vec<usize>,
}

/// Variables that formulas take from a heap-free copy of the conditions.
const ON_STACK: usize = 32;

impl Bound {
    pub(super) fn new(
        model: &VolumetricModel,
        coefficients: &[f64],
        inner: &[f64],
        variables: &[String],
        conditions: &BTreeMap<String, f64>,
    ) -> Result<Self, MachineError> {
        check_parameters(model, coefficients, inner)?;
        let mut parts = Parts::default();
        for (term, part) in model.parts().filter(|(_, part)| !part.channel.is_rig()) {
            let own = &coefficients[model.first_coefficient(term)..];
            match &part.shape {
                Shape::Basis { axis, basis } => {
                    let scaled: Vec<f64> = own[..basis.len()].iter().map(|c| part.factor * c).collect();
                    if scaled.iter().any(|&c| c != 0.0) {
                        parts.curve(part.channel, *axis, basis.curve(&scaled)?);
                    }
                }
                Shape::Expression { expression, coefficients: places, inner: inner_places } => {
                    let theta: Vec<f64> = places.iter().map(|&place| own[place]).collect();
                    let first = model.first_inner(term);
                    let phi: Vec<f64> = inner_places.iter().map(|&place| inner[first + place]).collect();
                    if theta.iter().chain(&phi).any(|value| !value.is_finite()) {
                        return Err(MachineError::NoValue { term });
                    }
                    // Linear and homogeneous: without a coefficient that is not 0 there is nothing.
                    if theta.is_empty() || theta.iter().any(|&c| c != 0.0) {
                        let function = Function::Formula {
                            term,
                            factor: part.factor,
                            expression: expression.clone(),
                            coefficients: theta,
                            inner: phi,
                            windups: Vec::new(),
                        };
                        parts.laws.push(Law { channel: part.channel, function });
                    }
                }
            }
        }
        parts.bound(variables, conditions)
    }

    /// Whether some number is no constant and no curve of its own axis.
    #[inline]
    pub(super) fn has_laws(&self) -> bool {
        !self.laws.is_empty()
    }

    /// Whether a squareness depends on the position.
    pub(super) fn has_squareness_laws(&self) -> bool {
        self.laws.iter().any(|law| matches!(law.channel, Channel::Squareness(_)))
    }

    /// Positions of an axis where a curve on a channel that is no joint error of it has kinks.
    pub(super) fn kinks_of_laws(&self, of: Axis) -> impl Iterator<Item = f64> {
        self.laws
            .iter()
            .flat_map(move |law| match &law.function {
                Function::Curve { axis, curve } if *axis == of => curve.kinks(),
                _ => &[],
            })
            .copied()
    }

    /// Numbers of all channels but what the curves give.
    pub(super) fn numbers(&self, question: &Question<'_>) -> Numbers {
        let mut buffer = [0.0; ON_STACK];
        let mut heap = Vec::new();
        let point = match buffer.get_mut(..self.template.len()) {
            Some(point) => point,
            None => {
                heap.resize(self.template.len(), 0.0);
                heap.as_mut_slice()
            }
        };
        point.copy_from_slice(&self.template);
        let approach = question.approach;
        for &(place, source) in &self.sources {
            point[place] = match source {
                Source::Position(axis) => question.q_mm[axis],
                Source::Offset(axis) => question.offset_mm[axis],
                Source::Place(axis) => question.place_mm[axis],
                Source::Direction(axis) => approach.direction[axis],
                Source::Travel(axis) => approach.travel_mm[axis],
                Source::Velocity(axis) => approach.velocity_mm_s[axis],
                Source::Feed => approach.feed_mm_min,
            };
        }
        let mut numbers = Numbers { values: self.constants, ..Numbers::default() };
        for Law { channel, function } in &self.laws {
            let (value, gradient) = function.at(question.q_mm, point, &approach.left_unwound);
            *slot(&mut numbers.values, *channel) += value;
            for (rates, by) in numbers.rates.iter_mut().zip(gradient) {
                *slot(rates, *channel) += by;
            }
        }
        numbers
    }
}

/// Parts by kind, while they are collected.
#[derive(Debug, Default)]
struct Parts {
    joints: [[Option<Curve>; 6]; 3],
    laws: Vec<Law>,
}

impl Parts {
    fn curve(&mut self, channel: Channel, of: Axis, curve: Curve) {
        match channel {
            Channel::Joint(axis, component) if axis == of => self.add(axis, component, curve),
            _ => self.laws.push(Law { channel, function: Function::Curve { axis: of, curve } }),
        }
    }

    fn add(&mut self, axis: Axis, component: Component, curve: Curve) {
        let slot = &mut self.joints[axis.index()][component.index()];
        *slot = Some(match slot.take() {
            Some(before) => before.plus(&curve),
            None => curve,
        });
    }

    fn bound(
        mut self,
        variables: &[String],
        conditions: &BTreeMap<String, f64>,
    ) -> Result<Bound, MachineError> {
        let place_of = |name: &str| variables.iter().position(|known| known == name);
        let mut template = vec![0.0; variables.len()];
        let mut sources: Vec<(usize, Source)> = Vec::new();
        let mut missing: Vec<String> = Vec::new();
        let mut needs = MotionNeeds::default();
        let mut motion_names = Vec::new();
        for law in &self.laws {
            let Function::Formula { expression, .. } = &law.function else { continue };
            let found = expression.symbols().variables.len();
            if found != variables.len() {
                return Err(MachineError::VariableCount { found, needed: variables.len() });
            }
            for name in expression.variables_used() {
                let Some(place) = place_of(name) else {
                    missing.push(name.to_owned());
                    continue;
                };
                match (conditions.get(name), Source::of(name)) {
                    (Some(&value), source) if source.is_none_or(Source::is_motion) => template[place] = value,
                    (_, Some(source)) => {
                        if sources.contains(&(place, source)) {
                            continue;
                        }
                        sources.push((place, source));
                        if source.is_motion() {
                            motion_names.push(name.to_owned());
                        }
                        match source {
                            Source::Direction(axis) | Source::Travel(axis) => needs.direction[axis] = true,
                            Source::Velocity(_) | Source::Feed => needs.speed = true,
                            _ => {}
                        }
                    }
                    // What is asked for is asked of a machine at work.
                    (_, None) if name == "moving" => template[place] = 1.0,
                    (_, None) => missing.push(name.to_owned()),
                }
            }
        }
        if !missing.is_empty() {
            missing.sort();
            missing.dedup();
            return Err(MachineError::MissingConditions { names: missing });
        }
        let (windups, long_stroke_terms) = self.follow_windups(&sources)?;
        let constants = self.fold(&template, &sources);
        let nothing = Curve::constant(0.0);
        let is_nominal = self.laws.is_empty()
            && constants == Displacements::default()
            && self.joints.iter().flatten().all(Option::is_none);
        let curves = self.joints.map(|joints| {
            CurveSet::new(std::array::from_fn(|component| joints[component].as_ref().unwrap_or(&nothing)))
        });
        let laws = self.laws;
        Ok(Bound {
            curves,
            constants,
            laws,
            template,
            sources,
            needs,
            motion_names,
            is_nominal,
            windups,
            long_stroke_terms,
        })
    }

    /// Finds the wind-ups of formulas that moves give direction and travel to; equal ones are one. Gives them, and the
    /// numbers of the terms with others: of a length that differs from place to place, or beyond the most.
    fn follow_windups(
        &mut self,
        sources: &[(usize, Source)],
    ) -> Result<(Vec<Windup>, Vec<usize>), MachineError> {
        let mut windups: Vec<Windup> = Vec::new();
        let mut long_stroke_terms: Vec<usize> = Vec::new();
        for law in &mut self.laws {
            let Function::Formula { term, expression, inner, windups: places, .. } = &mut law.function else {
                continue;
            };
            for of_formula in expression.windups(inner).map_err(VolumetricError::from)? {
                let followed = followed(&of_formula, sources);
                let place = match followed {
                    Followed::Moves(windup) => place_of(windup, &mut windups),
                    Followed::Formula | Followed::Conditions => None,
                };
                let is_stated = matches!(followed, Followed::Conditions);
                if place.is_none() && !is_stated && !long_stroke_terms.contains(term) {
                    long_stroke_terms.push(*term);
                }
                places.push(place);
            }
        }
        Ok((windups, long_stroke_terms))
    }

    /// Takes out the laws that are the same everywhere, and gives their sums on the channels that are no joints.
    fn fold(&mut self, template: &[f64], sources: &[(usize, Source)]) -> Displacements {
        let mut constants = Displacements::default();
        for law in std::mem::take(&mut self.laws) {
            let changes = match &law.function {
                Function::Curve { .. } => true,
                Function::Formula { expression, .. } => {
                    let symbols = &expression.symbols().variables;
                    let mut used = expression.variables_used();
                    used.any(|name| sources.iter().any(|&(place, _)| symbols[place] == name))
                }
            };
            if changes {
                self.laws.push(law);
                continue;
            }
            let (value, _) = law.function.at(&[0.0; 3], template, &[0.0; MAX_WINDUPS]);
            match law.channel {
                Channel::Joint(axis, component) if value != 0.0 => {
                    self.add(axis, component, Curve::constant(value));
                }
                channel => *slot(&mut constants, channel) += value,
            }
        }
        constants
    }
}

/// Where direction and travel of a wind-up come from.
enum Followed {
    /// From the moves.
    Moves(Windup),
    /// From conditions: there are no strokes.
    Conditions,
    /// They or its length are formulas.
    Formula,
}

/// The place of a wind-up among those of the machine, which takes it in; none where there are too many.
fn place_of(windup: Windup, windups: &mut Vec<Windup>) -> Option<usize> {
    let known = windups.iter().position(|&one| one == windup);
    if known.is_none() && windups.len() < MAX_WINDUPS {
        windups.push(windup);
        return Some(windups.len() - 1);
    }
    known
}

fn followed(windup: &FollowedWindup, sources: &[(usize, Source)]) -> Followed {
    let (Some(direction), Some(travel)) = (windup.direction, windup.travel) else { return Followed::Formula };
    let source_of =
        |variable: usize| sources.iter().find(|&&(place, _)| place == variable).map(|&(_, source)| source);
    match (source_of(direction), source_of(travel), windup.length_mm) {
        (Some(Source::Direction(axis)), Some(Source::Travel(of)), Some(length_mm)) if axis == of => {
            Followed::Moves(Windup { axis, length_mm })
        }
        (Some(_), Some(_), _) => Followed::Formula,
        _ => Followed::Conditions,
    }
}

/// The number of a channel of the machine; rig channels are never asked for.
#[inline]
fn slot(numbers: &mut Displacements, channel: Channel) -> &mut f64 {
    match channel {
        Channel::Joint(axis, component) => &mut numbers.joints[axis.index()][component.index()],
        Channel::Squareness(pair) => &mut numbers.squareness[pair.index()],
        Channel::Tool(axis) | Channel::Motion(axis) => &mut numbers.tool[axis.index()],
        Channel::Work(axis) => &mut numbers.work[axis.index()],
        Channel::Target(axis) => &mut numbers.target[axis.index()],
        Channel::Rig(_) => &mut numbers.target[0],
    }
}
