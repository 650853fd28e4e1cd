"""What of a model changes from session to session, at a later time: as it was in the last."""

from __future__ import annotations

from dataclasses import replace

from geoerr.model.model import Model
from geoerr.terms import SESSION_NAME


def last_session(model: Model) -> int | None:
    """Give the number of the last session that a model was fitted to; None where nothing in it follows sessions."""
    if model.record is None or SESSION_NAME not in model.record.covariate_spans:
        return None
    numbers = list(model.record.sessions.values())
    return numbers[-1] if numbers else round(model.record.covariate_spans[SESSION_NAME][1])


def since_last_session(model: Model) -> Model:
    """Give a model for measurements that it was not fitted to.

    The sessions of other data are others, and their numbers have nothing to do with the model's: what was knocked
    between two of those stays as it was in the last.
    """
    last = last_session(model)
    if last is None:
        return model
    return replace(model, terms=tuple(term.in_session(last) for term in model.terms))
