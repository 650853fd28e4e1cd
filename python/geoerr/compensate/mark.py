"""The mark that says by which model a program was corrected."""

from __future__ import annotations

import hashlib
from pathlib import Path

from geoerr.files import digest

# Twelve digits tell any two models of a workshop apart.
_MODEL_NAME_DIGITS = 12

# As the core writes it, before the first line that is changed; the model's name and a comma follow.
_MARK = b"corrected by geoerr: model "

_BLOCK_BYTES = 1 << 20


def name_of_model(path: str | Path) -> str:
    """Give what names a model's file in the mark of a corrected program: the first digits of its SHA-256."""
    return digest(path)[:_MODEL_NAME_DIGITS]


def name_of_content(model: bytes) -> str:
    """Give what `name_of_model` gives of a file with this content."""
    return hashlib.sha256(model).hexdigest()[:_MODEL_NAME_DIGITS]


def is_corrected_by(program: Path, model_name: str) -> bool:
    """Say whether a program bears the mark of a model; one that came out as it went in bears none.

    It is read as far as its mark: there is no second one, for a program that has one is not corrected again.
    """
    mark = _MARK + f"{model_name},".encode()
    kept = b""
    with program.open("rb") as stream:
        while block := stream.read(_BLOCK_BYTES):
            read = kept + block
            begin = read.find(_MARK)
            if begin >= 0:
                return (read[begin:] + stream.read(len(mark))).startswith(mark)
            # The mark may begin in one block and end in the next.
            kept = read[-len(_MARK) :]
    return False
