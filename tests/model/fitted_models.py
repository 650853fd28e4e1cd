"""Models with terms and a record, as a fit leaves them: drawn values, any covariance."""

from __future__ import annotations

import numpy as np
from model_machines import machine

from geoerr.error_functions import LINEAR_AND_ANGULAR, NotDetermined, is_angular
from geoerr.model import FitRecord, HistoryEntry, Model
from geoerr.terms import BasisSpec, Parameter, Part, Plausible, Term

REFERENCE = "thermal-expansion:x@temp_bed"


def spline(name: str, values: np.ndarray, low_mm: float = 0.0, high_mm: float = 400.0) -> Term:
    """A cubic spline on a joint channel."""
    axis = name[2].lower()
    knots = tuple(np.linspace(low_mm, high_mm, len(values) - 2).tolist())
    unit = "rad" if is_angular(name) else "mm"
    coefficients = tuple(Parameter(f"c{place}", unit, float(value)) for place, value in enumerate(values))
    basis = BasisSpec("bspline", axis, knots_mm=knots, degree=3)
    return Term(name, f"{name} as a spline", "classic", None, axis, None, (Part(name, basis=basis),), coefficients)


def squareness(channel: str, value: float) -> Term:
    parts = (Part(channel, expression="S"),)
    return Term(channel, "squareness", "classic", None, channel[-2:], None, parts, (Parameter("S", "rad", value),))


def classic_terms(seed: int = 0, size: float = 1.0, n_functions: int = 6) -> tuple[Term, ...]:
    """All 21, in no gauge: 0.3 mm, 1 mrad, 5 mrad of squareness, times `size`."""
    generator = np.random.default_rng(seed)
    terms = []
    for name in LINEAR_AND_ANGULAR:
        amplitude = size * (1e-3 if is_angular(name) else 0.3)
        terms.append(spline(name, generator.uniform(-amplitude, amplitude, n_functions)))
    channels = ("S_xy", "S_xz", "S_yz")
    return (*terms, *(squareness(channel, size * generator.uniform(-5e-3, 5e-3)) for channel in channels))


def expansion(alpha: float = 1.17e-5, q_fixed: float = 120.0, std: float = float("nan")) -> Term:
    """Thermal expansion with an inner parameter."""
    definitions = (("q", "x"), ("T", "temp_bed - 20"))
    part = Part("EXX", expression="alpha*T*(q - q_fixed)", definitions=definitions)
    return Term(
        REFERENCE,
        "Thermal expansion of the drive",
        "effect",
        "thermal-expansion",
        "x",
        "temp_bed",
        (part,),
        (Parameter("alpha", "1/K", alpha, std, (Plausible(11.5e-6, "steel"), Plausible(23.4e-6, "aluminium"))),),
        (Parameter("q_fixed", "mm", q_fixed, std if np.isnan(std) else 2.0, low=0.0, high=400.0),),
    )


def backlash(value: float = 0.02) -> Term:
    part = Part("EYY", expression="-b/2*d", definitions=(("d", "d_y"),))
    return Term("backlash:y", "Backlash", "effect", "backlash", "y", None, (part,), (Parameter("b", "mm", value),))


def rig_scale(value: float = 1e-4) -> Term:
    part = Part("rig-scale", expression="k*(temp_room - 20)")
    return Term("rig-scale", "Scale", "effect", "rig-scale", None, None, (part,), (Parameter("k", "1/K", value),))


def all_terms(seed: int = 0, size: float = 1.0) -> tuple[Term, ...]:
    """Rig first, so that the record's order is not the machine's."""
    return (rig_scale(), *classic_terms(seed, size), expansion(), backlash())


def values_of(terms: tuple[Term, ...]) -> np.ndarray:
    """In the record's order."""
    coefficients = [parameter.value for term in terms for parameter in term.coefficients]
    return np.array([*coefficients, *(parameter.value for term in terms for parameter in term.inner)])


def drawn_record(terms: tuple[Term, ...], seed: int = 0, n_null: int = 0, relative: float = 1e-2) -> FitRecord:
    """A dense covariance; each parameter about a hundredth of its kind's size uncertain."""
    generator = np.random.default_rng(seed)
    sizes = np.maximum(np.abs(values_of(terms)), 1e-9) * relative
    size = len(sizes)
    root = (np.eye(size) + 0.3 * generator.normal(size=(size, size)) / np.sqrt(size)) * sizes[:, None]
    directions, _ = np.linalg.qr(generator.normal(size=(size, max(n_null, 1))))
    covariance = root @ root.T
    return FitRecord(
        covariance=0.5 * (covariance + covariance.T),
        null_space=directions[:, :n_null],
        not_determined=(NotDetermined("EAX", "every target is in one place on the carriage"),) if n_null else (),
        data_digest="0123456789abcdef" * 4,
        n_rows=1234,
        n_outliers=2,
        range_mm={"x": (0.0, 400.0), "y": (0.0, 400.0), "z": (0.0, 400.0)},
        covariate_spans={"temp_bed": (20.5, 61.25)},
        noise={"floor_um": 17.9, "stated_um": 18.25},
        figures={"rmse_um": 18.3, "held_out_rmse_um": float("nan"), "lack_of_fit_p": 0.31},
        history=(
            HistoryEntry(
                REFERENCE,
                "Thermal expansion of the drive",
                {"rmse_um": 41.2, "held_out_rmse_um": 43.0},
                {"rmse_um": 18.3, "held_out_rmse_um": float("nan")},
                (Parameter("alpha", "1/K", 1.17e-5, 4e-7),),
            ),
        ),
    )


def fitted(seed: int = 0, n_null: int = 0, chain: str = "wZbXYt", size: float = 1.0) -> Model:
    terms = all_terms(seed, size)
    return Model(machine(chain, (3.0, -20.0, 55.0)), None, terms, drawn_record(terms, seed, n_null))


def with_stds(model: Model) -> Model:
    """The record's uncertainties in the terms, as a fit writes them."""
    assert model.record is not None
    std = model.record.std
    first_inner = sum(len(term.coefficients) for term in model.terms)
    terms, place = [], 0
    for term in model.terms:
        own = std[place : place + len(term.coefficients)]
        place += len(own)
        own_inner = std[first_inner : first_inner + len(term.inner)]
        first_inner += len(own_inner)
        terms.append(term.with_values(coefficients_std=own.tolist(), inner_std=own_inner.tolist()))
    return Model(model.machine, None, tuple(terms), model.record)
