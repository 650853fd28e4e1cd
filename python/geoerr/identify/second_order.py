"""What the first-order arithmetic leaves: found with the exact kinematics, and taken off.

Li's equations (and every lever × angle) hold to first order. With squarenesses of 5 mrad and angles of 0.5 mrad what
they neglect is 1 µrad, as much as good cameras' noise. The same arithmetic g is therefore applied to the points F(θ₀)
that the exact chain gives for the first estimate θ₀ = g(points); g(F(θ₀)) − θ₀ is what it does to that machine:

    θ = θ₀ − (g(F(θ₀)) − θ₀)

What remains is of third order (0.02 µm and 0.2 µrad on such machines). Uncertainties are those of θ₀.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from geoerr.error_functions import ErrorFunctions, Squareness
from geoerr.identify.axis import AxisFunctions
from geoerr.identify.frames import SessionFrame
from geoerr.identify.linear import Numbers
from geoerr.identify.measurements import Measurements
from geoerr.model import Model


def exact_points(data: Measurements, errors: ErrorFunctions, frames: Mapping[str, SessionFrame]) -> Measurements:
    """Give the same rows as the exact chain with these errors would have been measured, without noise.

    A constant in a session's frame does not matter to the arithmetic, so only the frame's rotation is applied; what
    was not measured stays unmeasured.
    """
    model = Model(errors.machine, errors)
    seen_of = {"tool": model.tool_from_base, "work": model.work_from_base, "relative": model.tool_from_work}
    exact_mm = data.measured_mm.copy()
    for carrier, seen in seen_of.items():
        rows = data.carrier == carrier
        if rows.any():
            exact_mm[rows] = seen(data.commanded_mm[rows], data.offset_mm[rows])
    for session, frame in frames.items():
        if frame.base_from_measured is not None:
            rows = (data.session == session) & np.isin(data.carrier, list(seen_of))
            exact_mm[rows] = exact_mm[rows] @ frame.base_from_measured
    return replace(data, measured_mm=np.where(np.isfinite(data.measured_mm), exact_mm, np.nan))


def corrected_functions(
    first: Mapping[str, AxisFunctions], again: Mapping[str, AxisFunctions]
) -> dict[str, AxisFunctions]:
    """Take g(F(θ₀)) − θ₀ off every function of θ₀; `again` is g(F(θ₀))."""
    corrected = {}
    for axis, functions in first.items():
        curves = {}
        for name, curve in functions.functions.items():
            value = curve.linear.value
            other = again[axis].functions[name].linear.value
            curves[name] = replace(curve, linear=curve.linear.with_value(_taken_off(value, other)))
        corrected[axis] = replace(functions, functions=curves)
    return corrected


def corrected_squareness(first: Mapping[str, Squareness], again: Mapping[str, Squareness]) -> dict[str, Squareness]:
    """Do the same for the squarenesses."""
    return {
        name: replace(found, value_rad=2.0 * found.value_rad - again[name].value_rad) for name, found in first.items()
    }


def _taken_off(first: Numbers, again: Numbers) -> Numbers:
    return np.asarray(2.0 * first - again)
