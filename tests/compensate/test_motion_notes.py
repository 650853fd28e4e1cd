"""Programs that move in ways that a model was not fitted to say so."""

from __future__ import annotations

import dataclasses

import pytest
from term_models import machine, term
from test_term_programs import with_record

from geoerr.compensate.program import compensate_bytes
from geoerr.model import Model


def notes_of(model: Model, program: bytes, **at: float) -> list[str]:
    told = compensate_bytes(model, program, at=at)[1].notes
    return [note for note in told if "moves at up to" in note or "turns round" in note]


@pytest.mark.parametrize(("back", "is_told"), [(b"X149", True), (b"X139", True), (b"X137", False)])
def test_strokes_too_short_to_wind_up_are_told(back: bytes, is_told: bool) -> None:
    """What short strokes leave was corrected as behind long ones, without a word: by up to 11 µm of 30 wrongly."""
    of = machine("wbXYZt")
    model = Model(of, None, (term(of, "reversal-windup:x", b=0.06, **{"lambda": 4.0}),))
    found = notes_of(model, b"G1 X10 Y10 Z5\nG1 X150\nG1 " + back + b"\nG1 X200 Y30\n")
    if is_told:
        (note,) = found
        stroke = 150 - int(back[1:])
        assert note.startswith(f"x turns round after {stroke} mm, where reversal-windup:x takes 12 mm to build up")
        assert note.endswith("up to 60 µm")
    else:
        assert not found


def test_one_direction_turns_round_nowhere() -> None:
    of = machine("wbXYZt")
    model = Model(of, None, (term(of, "reversal-windup:x", b=0.06, **{"lambda": 4.0}),))
    assert not notes_of(model, b"G1 X10 Y10 Z5\nG1 X11\nG1 X12\nG1 X20 Y30\nG1 Y29\nG1 Y30\n")


def test_speeds_that_were_not_measured_are_told() -> None:
    of = machine("wbXYZt")
    model = with_record(Model(of, None, (term(of, "lag:x", tau=1e-3),)), 1e-6)
    assert model.record is not None
    spans = {"v_x": (-50.0, 40.0)}
    model = dataclasses.replace(model, record=dataclasses.replace(model.record, covariate_spans=spans))
    # 50 mm/s is what was measured; of 70 mm/s along a diagonal X has 49.5.
    assert not notes_of(model, b"G1 X10 Y10 Z5 F3000\nG1 X110\nG1 X10 Y110 F4200\n")
    (note,) = notes_of(model, b"G1 X10 Y10 Z5 F3000\nG1 X110\nG1 X10 F6000\n")
    assert note.startswith("x moves at up to 100 mm/s")
    assert "was fitted to up to 50: there it is extrapolated" in note
    # Who states a speed has the program's own left out.
    assert not notes_of(model, b"G1 X10 Y10 Z5 F3000\nG1 X110 F6000\n", v_x=0.0)
