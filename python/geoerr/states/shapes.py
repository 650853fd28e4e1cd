r"""What a function may gain with temperature: a straight line, a bow, an S.

For a function of q over [a, b], L = b − a, u = (q − a)/L:

    order 1:  q − a                                   (positioning, angles)
    order 2, 3:  (q − a) u^(order−1), less its least-squares line

so that order 1 is the mean slope (of positioning the expansion, 1/K), and orders 2 and 3 are in the gauge of
straightness. Times T or T², T the temperature less the machine's reference. A squareness has the one shape 1. All of
them lie within the function's own basis, so that a model with temperature in it is, at each temperature, one of those
that the states were fitted with. What is rougher, a heater at one place, is seen as misfit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.bases import basis_of
from geoerr.effects import catalogue
from geoerr.error_functions import LI_NAMES, LI_SQUARENESS, is_angular
from geoerr.fit.classic import is_straightness, title_of
from geoerr.fit.sightings import Numbers
from geoerr.model.groups import POSITIONING
from geoerr.states.functions import Functions, term_id_of
from geoerr.terms import BasisSpec, Parameter, Part, Plausible, Term, UsualSpan

# A shape's order to what it is, in words.
_WHAT = {0: "turn", 1: "slope", 2: "bow", 3: "S-shape"}
# Places at which a shape is brought into a basis that holds it exactly.
_PLACES = 201


@dataclass(frozen=True, eq=False)
class Shape:
    """One shape of one error.

    Attributes
    ----------
    name
        ISO name of the error.
    order
        See the module's text; 0 for a squareness.
    power
        Of T: 1 or 2.
    text
        The formula in `q`, without its coefficient and T.
    parameters : (m,)
        The shape as parameters of the common terms.
    """

    name: str
    order: int
    power: int
    text: str
    parameters: Numbers

    @property
    def key(self) -> tuple[str, int, int]:
        """What it is: name, order, power."""
        return self.name, self.order, self.power

    @property
    def needs(self) -> tuple[tuple[str, int, int], ...]:
        """Keys of the shapes without which this one is not looked at: the next lower order, and T before T²."""
        lowest = 0 if self.order == 0 else 2 if is_straightness(self.name) else 1
        lower = [(self.name, self.order - 1, self.power)] if self.order > lowest else []
        return (*lower, *([(self.name, self.order, 1)] if self.power == 2 else []))


def shapes_of(functions: Functions, *, with_squares: bool) -> tuple[Shape, ...]:
    """List all shapes of the determined errors, simplest first; those of T² only where they are asked for."""
    n_parameters = functions.compiled.n_coefficients
    found: list[Shape] = []
    specs = {term.id: term.parts[0].basis for term in functions.terms}
    for power in (1, 2) if with_squares else (1,):
        for name in functions.names:
            own = functions.own[term_id_of(name)]
            spec = specs[term_id_of(name)]
            for order, text, coefficients in _turn(name) if spec is None else _along(name, spec):
                parameters = np.zeros(n_parameters)
                parameters[own] = coefficients
                found.append(Shape(name, order, power, text, parameters))
    return tuple(found)


def _turn(name: str) -> list[tuple[int, str, Numbers]]:
    """Give the one shape of a squareness: in the sense of its ISO name, where its channel may have the other one."""
    sense = LI_SQUARENESS[name][1]
    return [(0, "1" if sense > 0.0 else "(-1)", np.full(1, sense))]


def _along(name: str, spec: BasisSpec) -> list[tuple[int, str, Numbers]]:
    """Give order, formula and coefficients of the shapes that a basis holds."""
    basis = basis_of(spec)
    low, high = basis.range
    length = high - low
    places = np.linspace(low, high, _PLACES)
    design = basis.evaluate(places)
    q, u = _number("q", low), f"(q - {_text(low)})/{_text(length)}"
    raw = [(1, q, places - low)] if not is_straightness(name) else []
    most = 3 if spec.kind == "bspline" else min(spec.degree or 0, 3)
    raw += [
        (k, f"({q})*({u})^{k - 1}", (places - low) * ((places - low) / length) ** (k - 1)) for k in range(2, most + 1)
    ]
    shapes: list[tuple[int, str, Numbers]] = []
    for order, text, values in raw:
        coefficients = np.linalg.lstsq(design, values, rcond=None)[0]
        if order > 1:
            slope = float(basis.slope_row() @ coefficients)
            straight = np.linalg.lstsq(design, places - low, rcond=None)[0]
            coefficients = coefficients - slope * straight
            text = f"({text} - {_text(slope)}*({q}))"
        else:
            text = f"({text})"
        shapes.append((order, text, np.asarray(coefficients, dtype=np.float64)))
    return shapes


def temperature_terms(
    shapes: Sequence[Shape], functions: Functions, covariate: str, reference_degc: float
) -> list[Term]:
    """Give the shapes as terms of a model, one for each error and power of T; values unknown."""
    groups: dict[tuple[str, int], list[Shape]] = {}
    for shape in shapes:
        groups.setdefault((shape.name, shape.power), []).append(shape)
    return [
        _term(name, power, sorted(members, key=lambda shape: shape.order), functions, covariate, reference_degc)
        for (name, power), members in groups.items()
    ]


def coefficient_name(shape: Shape) -> str:
    """Name a shape's coefficient: `alpha` for an expansion, `k` for a squareness, else `c` and its order."""
    if shape.order == 0:
        return "k"
    return "alpha" if shape.order == 1 and shape.power == 1 and shape.name in POSITIONING else f"c{shape.order}"


def term_id(name: str, power: int, covariate: str) -> str:
    """Name the term of one error and one power of T."""
    return f"{name}*T{'' if power == 1 else '^2'}@{covariate}"


def _term(
    name: str, power: int, shapes: Sequence[Shape], functions: Functions, covariate: str, reference_degc: float
) -> Term:
    heat = "T" if power == 1 else "T^2"
    definitions = [("T", _number(covariate, reference_degc))]
    axis, title = None, f"squareness {LI_NAMES[name]}"
    if name not in LI_SQUARENESS:
        axis = name[2].lower()
        (spec,) = (term.parts[0].basis for term in functions.terms if term.id == name)
        assert spec is not None
        low, high = basis_of(spec).range
        # Outside the measured range the end value holds, as everywhere.
        definitions.append(("q", f"min(max({axis}, {_text(low)}), {_text(high)})"))
        title = f"{title_of(name)} ({LI_NAMES[name]})"
    sum_of_shapes = " + ".join(
        coefficient_name(shape) if shape.text == "1" else f"{coefficient_name(shape)}*{shape.text}"
        for shape in shapes
    )
    unit = {1: "/K", 2: "/K^2"}[power]
    if name in LI_SQUARENESS:
        unit = "rad" + unit
    elif is_angular(name):
        unit = "rad/(mm*K)" if power == 1 else "rad/(mm*K^2)"
    else:
        unit = "1" + unit
    return Term(
        term_id(name, power, covariate),
        f"{title} per {'kelvin' if power == 1 else 'kelvin squared'}",
        "empirical",
        None,
        axis if axis is not None else term_id_of(name)[2:],
        covariate,
        (Part(term_id_of(name), f"{heat}*({sum_of_shapes})", tuple(definitions)),),
        tuple(
            Parameter(coefficient_name(shape), unit, plausible=_plausible(shape), what=_what(shape))
            for shape in shapes
        ),
    )


def _what(shape: Shape) -> str:
    return "expansion" if coefficient_name(shape) == "alpha" else _WHAT[shape.order]


def _plausible(shape: Shape) -> tuple[Plausible | UsualSpan, ...]:
    """Give what an expansion may be of: the metals of the catalogue."""
    if coefficient_name(shape) != "alpha":
        return ()
    return next(one.plausible for one in catalogue()["thermal-expansion"].coefficients if one.name == "alpha")


def _number(name: str, less: float) -> str:
    if less == 0.0:
        return name
    return f"{name} - {_text(less)}" if less > 0.0 else f"{name} + {_text(-less)}"


def _text(value: float) -> str:
    """Write a number so that the formula's reader gets the same number back."""
    text = repr(float(value))
    return text if value >= 0.0 else f"({text})"
