"""Models of terms for the tests of programs: what a printer has that tables cannot hold."""

from __future__ import annotations

import dataclasses

from geoerr.effects import catalogue
from geoerr.machine import Axis, Machine
from geoerr.model import Model
from geoerr.terms import Term

RANGE_MM = (0.0, 400.0)


def machine(chain: str = "wZbXYt") -> Machine:
    return Machine("printer", chain, {name: Axis(RANGE_MM) for name in "xyz"}, tool_offset_mm=(0.0, 5.0, -30.0))


def term(of: Machine, reference: str, **values: float) -> Term:
    """Make an effect of the catalogue with these values."""
    effect, parsed = catalogue().resolve(reference)
    made = effect.term(parsed.axis, parsed.covariate, of)
    put = [
        tuple(dataclasses.replace(p, value=values[p.name], std=0.1 * abs(values[p.name])) for p in parameters)
        for parameters in (made.coefficients, made.inner)
    ]
    return dataclasses.replace(made, coefficients=put[0], inner=put[1])


def printer(chain: str = "wZbXYt") -> Model:
    """Backlash of X and Y, a belt tooth, a bed that grows, an axis that leans."""
    of = machine(chain)
    terms = (
        term(of, "backlash:x", b=0.05),
        term(of, "backlash:y", b=0.03),
        term(of, "periodic:x", A=0.02, B=0.0, P=2.0),
        term(of, "thermal-expansion:y@temp_bed", alpha=1.7e-5, q_fixed=200.0),
        term(of, "squareness:xy", S=-5e-3),
    )
    return Model(of, None, terms)
