"""Tables (errors.json) as terms, and their squareness in Li's signs."""

from __future__ import annotations

from geoerr.error_functions import LI_NAMES, LI_SQUARENESS, LINEAR_AND_ANGULAR, SQUARENESS, ErrorFunctions, is_angular
from geoerr.terms import BasisSpec, Parameter, Part, Term


def squareness_of_li_rad(errors: ErrorFunctions | None) -> tuple[float, float, float]:
    """Give (S_xy, S_xz, S_yz), included angles minus 90°, from the ISO signs of `errors`; absent ones are 0."""
    li = dict.fromkeys(("S_xy", "S_xz", "S_yz"), 0.0)
    for name, squareness in ({} if errors is None else errors.squareness).items():
        symbol, sign = LI_SQUARENESS[name]
        li[symbol] = sign * squareness.value_rad
    return li["S_xy"], li["S_xz"], li["S_yz"]


def terms_of_errors(errors: ErrorFunctions | None) -> tuple[Term, ...]:
    """Give the same errors as terms: polygons (two-node elements at the tables' positions) and constants.

    Uncertainties of a table's entries become those of its coefficients; what entries have in common is not known.
    """
    if errors is None:
        return ()
    terms = []
    for name in LINEAR_AND_ANGULAR:
        function = errors.functions.get(name)
        if function is None:
            continue
        unit = "rad" if is_angular(name) else "mm"
        values = function.value.tolist()
        stds = [float("nan")] * len(values) if function.std is None else function.std.tolist()
        coefficients = tuple(
            Parameter(f"c{place}", unit, value, std)
            for place, (value, std) in enumerate(zip(values, stds, strict=True))
        )
        axis = name[2].lower()
        if len(values) == 1:
            part = Part(name, expression="c0")
        else:
            part = Part(name, basis=BasisSpec("linear", axis, knots_mm=tuple(function.position_mm.tolist())))
        terms.append(Term(name, LI_NAMES[name], "classic", None, axis, None, (part,), coefficients))
    for name in SQUARENESS:
        squareness = errors.squareness.get(name)
        if squareness is None:
            continue
        symbol, sign = LI_SQUARENESS[name]
        std = float("nan") if squareness.std_rad is None else squareness.std_rad
        parameter = Parameter("S", "rad", sign * squareness.value_rad, std)
        parts = (Part(symbol, expression="S"),)
        terms.append(Term(symbol, "squareness", "classic", None, symbol[-2:], None, parts, (parameter,)))
    return tuple(terms)
