"""model.json: a model with its record, whole, so that the file stands alone.

The same model gives the same bytes: keys in a fixed order, numbers with all their digits, no dates, paths or command
lines. A file from anywhere is safe to open: everything is checked before it is used, formulas go through the core's
parser only, and every refusal names the file and the key.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from geoerr.effects.wording import with_words
from geoerr.error_functions import NotDetermined
from geoerr.errors import GeoerrError, InputFileError
from geoerr.machine import machine_from_document
from geoerr.model.arrays import Numbers
from geoerr.model.model import Model
from geoerr.model.record import MAX_PARAMETERS, FitRecord, HistoryEntry
from geoerr.terms import MAX_ITEMS, Parameter, Term

SCHEMA_NAME = "geoerr-model"
SCHEMA_VERSION = 1
SCHEMA = f"{SCHEMA_NAME}/{SCHEMA_VERSION}"

# Deeper than any document of ours; what walks it later does so by calls.
_MAX_DEPTH = 40
_LARGEST = 1e300

_Built = TypeVar("_Built")


def document_of(model: Model) -> dict[str, Any]:
    """Give the content of model.json as plain values. Tables (`errors`) become terms: polygons."""
    terms = model.all_machine_terms + model.rig_terms if model.errors is not None else model.terms
    document: dict[str, Any] = {
        "schema": SCHEMA,
        "machine": model.machine.to_document(),
        "terms": [term.to_document() for term in terms],
    }
    record = model.record
    if record is not None:
        document |= {
            "parameters": list(model.parameter_names),
            "covariance": [row[place:].tolist() for place, row in enumerate(record.covariance)],
            "null_space": record.null_space.T.tolist(),
            "not_determined": [{"name": item.name, "why": item.why} for item in record.not_determined],
            "data": {
                "digest": record.data_digest,
                "n_rows": record.n_rows,
                "n_outliers": record.n_outliers,
                "range_mm": {axis: list(span) for axis, span in record.range_mm.items()},
                "stood_mm": dict(record.stood_mm),
                "covariate_spans": {name: list(span) for name, span in record.covariate_spans.items()},
                # Of few models: files of the others stay as they were.
                **({"sessions": dict(record.sessions)} if record.sessions else {}),
            },
            "noise": _numbers_of(record.noise),
            "figures": _numbers_of(record.figures),
            "history": [_entry_of(entry) for entry in record.history],
        }
        # Said where it is so: files of fits that came to rest stay as they were.
        if not record.has_settled:
            document["has_settled"] = False
    return document


def is_model_document(document: Any) -> bool:
    """Tell a model.json by what only it has: its schema, or terms."""
    if not isinstance(document, dict):
        return False
    schema = document.get("schema")
    return "terms" in document or (isinstance(schema, str) and schema.startswith(SCHEMA_NAME))


def model_from_document(document: Any, path: str | Path) -> Model:
    """Check the content of a model.json and make the model.

    Raises
    ------
    InputFileError
        for anything missing or malformed, naming the file and the key.
    """
    if not isinstance(document, dict):
        raise InputFileError(path, "is not a table of keys and values")
    _check_schema(document.get("schema"), path)
    _check_plain(document, path)
    machine = machine_from_document(document.get("machine"), path)
    content = _list(document.get("terms"), "terms", path)
    read = (Term.from_document(item, path, f"terms[{place}]") for place, item in enumerate(content, start=1))
    terms = tuple(with_words(term, machine) for term in read)
    count = sum(len(term.coefficients) + len(term.inner) for term in terms)
    _refuse(count > MAX_PARAMETERS, path, "terms", f"have {count} parameters, at most {MAX_PARAMETERS} are read")
    model = _made(path, "terms", lambda: Model(machine, None, terms))
    if document.get("covariance") is None:
        return model
    names = document.get("parameters", list(model.parameter_names))
    if names != list(model.parameter_names):
        raise InputFileError(path, "does not name the parameters of the terms in their order", column="parameters")
    record = _record(document, len(names), path)
    return _made(path, "covariance", lambda: Model(machine, None, terms, record))


def _record(document: dict[str, Any], n_parameters: int, path: str | Path) -> FitRecord:
    covariance = _covariance(document["covariance"], n_parameters, path)
    null_space = _null_space(document.get("null_space", []), n_parameters, path)
    data = _table(document.get("data", {}), "data", path)
    not_determined = [
        NotDetermined(_text(item, "name", place, path), _text(item, "why", place, path))
        for place, item in _tables(document.get("not_determined", []), "not_determined", path)
    ]
    history = [
        HistoryEntry(
            reference=_text(item, "reference", place, path),
            title=_text(item, "title", place, path),
            figures_before=_figures(item.get("figures_before", {}), f"{place}.figures_before", path),
            figures_after=_figures(item.get("figures_after", {}), f"{place}.figures_after", path),
            parameters=tuple(
                Parameter.from_document(parameter, path, f"{place}.parameters[{number}]")
                for number, parameter in enumerate(
                    _list(item.get("parameters", []), f"{place}.parameters", path), start=1
                )
            ),
            action=_action(item.get("action", "added"), place, path),
        )
        for place, item in _tables(document.get("history", []), "history", path)
    ]
    digest = _text(data, "digest", "data", path)
    return _made(
        path,
        "covariance",
        lambda: FitRecord(
            covariance=covariance,
            null_space=null_space,
            not_determined=tuple(not_determined),
            data_digest=digest,
            n_rows=_count(data, "n_rows", path),
            n_outliers=_count(data, "n_outliers", path),
            range_mm=_spans(data.get("range_mm", {}), "data.range_mm", path),
            covariate_spans=_spans(data.get("covariate_spans", {}), "data.covariate_spans", path),
            noise=_figures(document.get("noise", {}), "noise", path),
            figures=_figures(document.get("figures", {}), "figures", path),
            history=tuple(history),
            stood_mm=_figures(data.get("stood_mm", {}), "data.stood_mm", path),
            has_settled=_truth(document, "has_settled", path),
            sessions=_sessions(data.get("sessions", {}), path),
        ),
    )


def _sessions(found: Any, path: str | Path) -> dict[str, int]:
    if not isinstance(found, dict):
        raise InputFileError(
            path,
            "is not a table of names and numbers",
            column="data.sessions",
            remedy="leave it as `geoerr fit` wrote it",
        )
    return dict(found)


def _numbers_of(numbers: Mapping[str, float]) -> dict[str, float | None]:
    return {name: None if math.isnan(value) else value for name, value in numbers.items()}


def _entry_of(entry: HistoryEntry) -> dict[str, Any]:
    return {
        "action": entry.action,
        "reference": entry.reference,
        "title": entry.title,
        "figures_before": _numbers_of(entry.figures_before),
        "figures_after": _numbers_of(entry.figures_after),
        "parameters": [parameter.to_document() for parameter in entry.parameters],
    }


def _check_schema(schema: Any, path: str | Path) -> None:
    match = re.fullmatch(rf"{SCHEMA_NAME}/([0-9]{{1,9}})", schema) if isinstance(schema, str) else None
    if match is None:
        raise InputFileError(
            path,
            "the schema is missing" if schema is None else f"{_shown(schema)} is not a schema of model.json",
            column="schema",
            remedy=f"a model.json says {SCHEMA!r}",
        )
    if int(match[1]) != SCHEMA_VERSION:
        raise InputFileError(
            path,
            f"schema {schema!r} is not known to this version, which reads {SCHEMA!r}",
            column="schema",
            remedy="update geoerr, or fit the model again with this version",
        )


def _check_plain(document: Any, path: str | Path) -> None:
    """Refuse numbers that are not finite or beyond all use, and depth that no model has."""
    pending: list[tuple[Any, str, int]] = [(document, "", 0)]
    while pending:
        value, place, depth = pending.pop()
        if depth > _MAX_DEPTH:
            raise InputFileError(path, f"is nested deeper than {_MAX_DEPTH} levels", column=place[:200])
        if isinstance(value, int | float) and not (isinstance(value, bool) or abs(value) <= _LARGEST):
            raise InputFileError(path, "is not a finite number", column=place[:200])
        if isinstance(value, dict):
            pending += [(item, f"{place}.{key}" if place else key, depth + 1) for key, item in value.items()]
        elif isinstance(value, list):
            pending += [
                (item, f"{place}[{number}]", depth + 1)
                for number, item in enumerate(value, start=1)
                if not isinstance(item, float) or not abs(item) <= _LARGEST
            ]


def _covariance(content: Any, size: int, path: str | Path) -> Numbers:
    rows = _list(content, "covariance", path)
    _refuse(len(rows) != size, path, "covariance", f"has {len(rows)} rows for {size} parameters")
    matrix = np.zeros((size, size))
    for place, row in enumerate(rows):
        numbers = _row(row, size - place, f"covariance[{place + 1}]", path)
        matrix[place, place:] = numbers
        matrix[place:, place] = numbers
    return matrix


def _null_space(content: Any, size: int, path: str | Path) -> Numbers:
    directions = _list(content, "null_space", path)
    _refuse(len(directions) > size, path, "null_space", f"has {len(directions)} directions of {size} parameters")
    rows = [_row(row, size, f"null_space[{place}]", path) for place, row in enumerate(directions, start=1)]
    return np.array(rows, dtype=np.float64).reshape(len(rows), size).T


def _row(content: Any, size: int, place: str, path: str | Path) -> list[float]:
    row = _list(content, place, path)
    _refuse(len(row) != size, path, place, f"has {len(row)} numbers, {size} are needed")
    _refuse(not all(map(_is_number, row)), path, place, "has an entry that is not a number")
    return [float(number) for number in row]


def _spans(content: Any, place: str, path: str | Path) -> dict[str, tuple[float, float]]:
    spans = {}
    for name, span in _table(content, place, path).items():
        low, high = _row(span, 2, f"{place}.{name}"[:200], path)
        spans[name] = (low, high)
    return spans


def _figures(content: Any, place: str, path: str | Path) -> dict[str, float]:
    figures = {}
    for name, value in _table(content, place, path).items():
        good = value is None or _is_number(value)
        _refuse(not good, path, f"{place}.{name}"[:200], f"{_shown(value)} is not a number")
        figures[name] = math.nan if value is None else float(value)
    return figures


def _count(data: dict[str, Any], name: str, path: str | Path) -> int:
    value = data.get(name, 0)
    good = isinstance(value, int) and not isinstance(value, bool) and value >= 0
    _refuse(not good, path, f"data.{name}", f"{_shown(value)} is not a number of rows")
    return int(value)


def _truth(document: dict[str, Any], name: str, path: str | Path) -> bool:
    value = document.get(name, True)
    _refuse(not isinstance(value, bool), path, name, f"{_shown(value)} is neither true nor false")
    return bool(value)


def _action(value: Any, place: str, path: str | Path) -> Any:
    _refuse(value not in ("added", "removed"), path, f"{place}.action", "is neither 'added' nor 'removed'")
    return value


def _text(item: dict[str, Any], name: str, place: str, path: str | Path) -> str:
    value = item.get(name, "")
    _refuse(not isinstance(value, str), path, f"{place}.{name}", f"{_shown(value)} is not a text")
    return str(value)


def _tables(content: Any, place: str, path: str | Path) -> Iterator[tuple[str, dict[str, Any]]]:
    for number, item in enumerate(_list(content, place, path), start=1):
        yield f"{place}[{number}]", _table(item, f"{place}[{number}]", path)


def _table(content: Any, place: str, path: str | Path) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise InputFileError(path, f"{_shown(content)} is not a table of keys and values", column=place)
    return content


def _list(content: Any, place: str, path: str | Path) -> Sequence[Any]:
    if not isinstance(content, list) or len(content) > MAX_ITEMS:
        raise InputFileError(path, f"{_shown(content)} is not a list of at most {MAX_ITEMS} entries", column=place)
    return content


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _refuse(condition: bool, path: str | Path, place: str, problem: str) -> None:
    if condition:
        raise InputFileError(path, problem, column=place)


def _made(path: str | Path, place: str, make: Callable[[], _Built]) -> _Built:
    """Turn a refusal of content into one that names the file and the key."""
    try:
        return make()
    except InputFileError:
        raise
    except GeoerrError as error:
        raise InputFileError(path, str(error), column=place) from error


def _shown(value: Any) -> str:
    if isinstance(value, dict | list):
        return f"a {'table' if isinstance(value, dict) else 'list'} of {len(value)} entries"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
