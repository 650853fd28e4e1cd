"""What of a model changes from session to session, at a later time: as it was in the last."""

from __future__ import annotations

from dataclasses import replace

from geoerr.model.model import Model
from geoerr.terms import SESSION_NAME


def since_last_session(model: Model) -> Model:
    """Give a model for measurements that it was not fitted to.

    The sessions of other data are others, and their numbers have nothing to do with the model's: what was knocked
    between two of those stays as it was in the last.
    """
    spans = {} if model.record is None else model.record.covariate_spans
    if SESSION_NAME not in spans:
        return model
    last = round(spans[SESSION_NAME][1])
    return replace(model, terms=tuple(term.in_session(last) for term in model.terms))
