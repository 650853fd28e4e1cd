"""What a command takes as MODEL, by suffix or content; and model.json written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from geoerr.error_functions import errors_from_document
from geoerr.errors import InputFileError
from geoerr.files import check_written, read_json, refusing_unreadable, write_json
from geoerr.machine import read_machine
from geoerr.model.document import document_of, is_model_document, model_from_document
from geoerr.model.model import Model

# Three thousand parameters' covariance takes half of it.
MAX_BYTES = 256 << 20
# What measurements come in.
_TABLES = (".csv", ".parquet")
_WHAT_MODELS_ARE = "a model is a model.json, an errors.json or a machine.toml"


def load_model(path: str | Path) -> Model:
    """Read what a command takes as MODEL: model.json, errors.json, or machine.toml for the nominal machine.

    The suffix tells which; where it is neither `.json` nor `.toml`, the first character does (JSON begins with `{`).

    Raises
    ------
    InputFileError
        for a file that is none of these, or not as it should be.
    """
    if Path(path).suffix.lower() in _TABLES and Path(path).is_file():
        raise InputFileError(
            path,
            "is a table of measurements, and no model of a machine",
            remedy=f"{_WHAT_MODELS_ARE}; `geoerr fit` makes one of measurements",
        )
    if not _is_json(Path(path)):
        return Model(read_machine(path))
    document = _read(path)
    if is_model_document(document):
        return model_from_document(document, path)
    if isinstance(document, dict) and "errors" not in document and "K_left" in document:
        raise InputFileError(
            path,
            "is a rig, two cameras, and no model of a machine",
            remedy=f"where measurements are given it belongs to them, as --rig {path}; {_WHAT_MODELS_ARE}",
        )
    errors = errors_from_document(document, path)
    return Model(errors.machine, errors)


def write_model(path: str | Path, model: Model) -> None:
    """Write model.json, whole or not at all."""
    check_written(path, model, Model, "write_model(path, model)")
    write_json(path, document_of(model))


def _read(path: str | Path) -> Any:
    with refusing_unreadable(path):
        size = Path(path).stat().st_size
    if size > MAX_BYTES:
        raise InputFileError(path, f"has {size >> 20} MiB: no model is larger than {MAX_BYTES >> 20} MiB")
    return read_json(path)


def _is_json(path: Path) -> bool:
    suffix = path.suffix.lower()
    if suffix in (".json", ".toml"):
        return suffix == ".json"
    try:
        with path.open("rb") as stream:
            return stream.read(4096).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")
    except OSError:
        # The reader says what is wrong with the file.
        return False
