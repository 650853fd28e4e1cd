"""Programs that move in ways that a model was not fitted to say so."""

from __future__ import annotations

import dataclasses

from term_models import machine, term
from test_term_programs import with_record

from geoerr.compensate.program import compensate_bytes
from geoerr.model import Model
from geoerr.terms import Parameter, Part, Term


def notes_of(model: Model, program: bytes, **at: float) -> list[str]:
    told = compensate_bytes(model, program, at=at)[1].notes
    return [note for note in told if "moves at up to" in note or "wind-up" in note]


def wound_over(length: str) -> Model:
    """Give a machine whose drive along X winds up over a length, which may be a formula of the place."""
    of = machine("wbXYZt")
    part = Part("EXX", f"b*windup({length})", (("d", "d_x"), ("s", "s_x")))
    play = Parameter("b", "mm", value=0.06)
    return Model(of, None, (Term("soft", "soft drive", "effect", "soft", "x", None, (part,), (play,)),))


def test_a_wind_up_that_is_not_followed_is_told() -> None:
    """Over a length that differs from place to place no stroke says what it leaves to the next."""
    there_and_back = b"G1 X10 Y10 Z5\nG1 X150\nG1 X149\nG1 X200 Y30\n"
    (note,) = notes_of(wound_over("4 + x/100"), there_and_back)
    assert note.startswith("the wind-up of soft is not followed from stroke to stroke")
    assert "x (after 1 mm)" in note
    assert not notes_of(wound_over("4 + 1"), there_and_back)
    # Who turns round nowhere has no strokes.
    assert not notes_of(wound_over("4 + x/100"), b"G1 X10 Y10 Z5\nG1 X11\nG1 X12\nG1 X20 Y30\n")
    # Whoever states direction and travel has none either.
    assert not notes_of(wound_over("4 + x/100"), there_and_back, d_x=1.0, s_x=100.0)


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
