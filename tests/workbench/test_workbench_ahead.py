"""What a search listed is added while a person reads: the same numbers, nothing lost, and nothing after its time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from workbench_scenes import fitted, settle

from geoerr.diagnose import Change, Diagnosis
from geoerr.model.document import document_of
from geoerr.workbench import actions, wiring
from geoerr.workbench.addition import Addition
from geoerr.workbench.ahead import Ahead
from geoerr.workbench.session import Session

PATIENCE_S = 60.0


class HeldUp:
    """Adds effects when it is let, and says when it has begun."""

    def __init__(self, addition: Addition) -> None:
        self._addition = addition
        self.has_begun, self.may_go_on = threading.Event(), threading.Event()
        self.asked: list[str] = []

    def of(self, reference: str, diagnosis: Diagnosis, on_step: Callable[[str], None]) -> Change:
        """Wait, and add."""
        self.asked.append(reference)
        self.has_begun.set()
        assert self.may_go_on.wait(PATIENCE_S)
        on_step("held up")
        return self._addition.of(reference, diagnosis, on_step=on_step)


@pytest.fixture(name="session")
def _session(tmp_path: Path) -> Session:
    """Give a session that has been searched, with nothing added ahead any more."""
    session = fitted(tmp_path)
    wiring.do(session, "diagnose", "")
    settle(session)
    session.prepared, session.ahead = (), None
    return session


def _begun(session: Session, addition: Any) -> Ahead:
    ahead = Ahead(session, addition, session.diagnosis)
    session.ahead = ahead.awaited
    ahead.start()
    return ahead


def test_every_name_that_is_listed_is_added_with_the_numbers_that_it_has_when_asked_for(session: Session) -> None:
    diagnosis = session.diagnosis
    listed = dict.fromkeys(str(one.reference) for one in (*diagnosis.found, *diagnosis.candidates))

    _begun(session, Addition.to(session)).wait(PATIENCE_S)

    assert len(listed) > 1
    assert {one.reference for one in session.prepared} >= set(listed)
    last = session.prepared[-1]
    asked = Addition.to(session).of(last.reference, diagnosis)
    assert document_of(last.seen.comparison.model) == document_of(asked.result.model)
    assert last.seen.comparison.points.held_out.figures == asked.after.held_out.figures


def test_who_asks_for_what_is_under_way_gets_just_that(session: Session) -> None:
    addition = HeldUp(Addition.to(session))
    _begun(session, addition)
    assert addition.has_begun.wait(PATIENCE_S)

    actions.add(session, addition.asked[0])
    addition.may_go_on.set()
    settle(session)

    assert session.step.name == f"+ {addition.asked[0]}"
    # Once, by what had begun before.
    assert addition.asked == addition.asked[:1]


def test_what_another_model_is_looked_at_for_is_given_up(session: Session) -> None:
    addition = HeldUp(Addition.to(session))
    ahead = _begun(session, addition)
    assert addition.has_begun.wait(PATIENCE_S)

    actions.show(session, 0)
    settle(session)
    addition.may_go_on.set()
    ahead.wait(PATIENCE_S)

    assert len(addition.asked) == 1
    assert session.prepared == ()


def test_it_rests_while_other_work_is_under_way(session: Session) -> None:
    addition = HeldUp(Addition.to(session))
    ahead = _begun(session, addition)
    assert addition.has_begun.wait(PATIENCE_S)
    is_done = threading.Event()

    def work(_: object) -> Callable[[], None]:
        assert is_done.wait(PATIENCE_S)
        return lambda: None

    session.begin("other work", actions.DATA, work)
    addition.may_go_on.set()
    ahead.wait(0.3)
    assert session.prepared == ()
    is_done.set()
    settle(session)
    ahead.wait(PATIENCE_S)

    assert session.prepared_of(addition.asked[0]) is not None


def test_undo_goes_on_where_it_was_left(session: Session) -> None:
    _begun(session, Addition.to(session)).wait(PATIENCE_S)
    first, *others = session.prepared
    session.prepared = (first,)
    actions.add(session, first.reference)
    assert (session.prepared, session.ahead) == ((), None)

    actions.undo(session)

    assert session.ahead.__self__.wait(PATIENCE_S) is None
    assert [one.reference for one in session.prepared] == [first.reference, *(one.reference for one in others)]
