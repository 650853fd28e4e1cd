"""Parameters of terms by name, and what their covariance says of pairs of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.errors import GeoerrError
from geoerr.model.record import FitRecord
from geoerr.terms import Parameter, Term


@dataclass(frozen=True)
class Correlation:
    """Correlation of two parameters, named as `Model.parameter` takes them."""

    first: str
    second: str
    value: float


def parameter_names(terms: Sequence[Term]) -> tuple[str, ...]:
    """Name all parameters in the core's order: coefficients of all terms, then inner parameters of all."""
    coefficients = [f"{term.id}.{parameter.name}" for term in terms for parameter in term.coefficients]
    return (*coefficients, *(f"{term.id}.{parameter.name}" for term in terms for parameter in term.inner))


def find_parameter(terms: Sequence[Term], name: str) -> Parameter:
    """Give one parameter by its name; see `Model.parameter`."""
    term_id, dot, own = name.rpartition(".")
    by_id = {term.id: term for term in terms}
    term = by_id.get(term_id if dot else own)
    if term is None:
        raise GeoerrError(f"the model has no term {term_id or own!r}\nhint: its terms are {', '.join(by_id)}")
    parameters = {parameter.name: parameter for parameter in term.coefficients + term.inner}
    if not dot or own not in parameters:
        known = ", ".join(f"{term.id}.{known}" for known in parameters)
        raise GeoerrError(f"{name!r} names no parameter of {term.id}\nhint: write one of {known}")
    return parameters[own]


def correlations_of(record: FitRecord, terms: Sequence[Term], minimum: float) -> tuple[Correlation, ...]:
    """Give pairs of parameters by the size of their correlation; see `Model.correlations`."""
    has_basis = [any(part.basis is not None for part in term.parts) for term in terms]
    owners = [place for place, term in enumerate(terms) for _ in term.coefficients]
    owners += [place for place, term in enumerate(terms) for _ in term.inner]
    owner, on_basis = np.array(owners, dtype=np.int64), np.array(has_basis, dtype=bool)
    is_determined = ~record.null_space.any(axis=1)
    std = np.where(is_determined, record.std, 0.0)
    product = np.multiply.outer(std, std)
    value = np.divide(record.covariance, product, out=np.zeros_like(product), where=product > 0.0)
    of_one_curve = (owner[:, None] == owner[None, :]) & on_basis[owner][:, None]
    first, second = np.nonzero(np.triu(np.abs(value) >= minimum, 1) & ~of_one_curve)
    order = np.argsort(-np.abs(value[first, second]), kind="stable")
    names = parameter_names(terms)
    return tuple(
        Correlation(names[i], names[j], float(np.clip(value[i, j], -1.0, 1.0)))
        for i, j in zip(first[order].tolist(), second[order].tolist(), strict=True)
    )


def with_independent(record: FitRecord, n_coefficients: int, term: Term) -> FitRecord | None:
    """Give the record with a term's parameters behind their kind; None where their uncertainty is not stated."""
    coefficients = [parameter.std for parameter in term.coefficients]
    inner = [0.0 if parameter.is_fixed else parameter.std for parameter in term.inner]
    if np.isnan([*coefficients, *inner]).any():
        return None
    old = record.n_parameters
    places = np.concatenate([np.arange(n_coefficients), np.arange(n_coefficients, old) + len(coefficients)])
    size = old + len(coefficients) + len(inner)
    covariance = np.diag(np.zeros(size))
    covariance[np.ix_(places, places)] = record.covariance
    new = [*range(n_coefficients, n_coefficients + len(coefficients)), *range(size - len(inner), size)]
    covariance[new, new] = np.square([*coefficients, *inner])
    null_space = np.zeros((size, record.null_space.shape[1]))
    null_space[places] = record.null_space
    return dataclasses.replace(record, covariance=covariance, null_space=null_space)
