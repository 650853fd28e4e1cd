"""A diagnosis as the page tells it: plain texts, alike of points and of circles, that a session's file can keep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

from geoerr.diagnose import Diagnosis, Finding, Unknown
from geoerr.diagnose.circles import Cause, CircleDiagnosis
from geoerr.diagnose.findings import Alias, Named
from geoerr.diagnose.words import chance_words, sure_words, um_words
from geoerr.effects import Effect, catalogue
from geoerr.report.diagnosis_page import circle_diagnosis_sentences
from geoerr.summaries import capitalised, listed
from geoerr.workbench.page_words import on_the_page

_MOST_ALIKE = 4
# What is said, and of what; the first may be empty.
Line = tuple[str, str]


@dataclass(frozen=True)
class Card:
    """One candidate.

    Attributes
    ----------
    reference
        What `add` takes, and what the pictures know it by.
    title, rank
        Its heading, and its place among the others.
    worth
        How much it is, and what that does to the error.
    said, more
        What is read at once, and what is unfolded.
    apart
        The measurement that would tell it from what looks the same.
    adds
        What its button says; empty where nothing can be added.
    is_main, is_rig
        Whether adding it is the thing to do, and whether it is the measuring device's own.
    can_show
        Whether it is known row by row, so that the pictures can show it.
    """

    reference: str
    title: str
    rank: str = ""
    worth: str = ""
    said: tuple[Line, ...] = ()
    more: tuple[Line, ...] = ()
    apart: str = ""
    adds: str = "Add"
    is_main: bool = False
    is_rig: bool = False
    can_show: bool = True


@dataclass(frozen=True)
class Told:
    """The answer as the panel shows it.

    Attributes
    ----------
    verdict, sentences
        The answer in a sentence, and what it rests on.
    cards
        What was found, what looks the same, what has no name.
    others, others_title
        What was looked at beside, folded away.
    not_offered
        Effect and why it was not looked for.
    """

    verdict: str
    sentences: tuple[str, ...]
    cards: tuple[Card, ...]
    others: tuple[Card, ...]
    others_title: str
    not_offered: tuple[Line, ...]

    def to_document(self) -> dict[str, Any]:
        """Give plain values."""
        return asdict(self)

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Told:
        """Read it.

        Raises
        ------
        KeyError, TypeError, ValueError
            for a document that is none.
        """
        plain = {one.name: document[one.name] for one in fields(cls)}
        for name in ("cards", "others"):
            plain[name] = tuple(_card_from(one) for one in plain[name])
        return cls(**plain | {"sentences": tuple(plain["sentences"]), "not_offered": _lines(plain["not_offered"])})


def told_of(diagnosis: Diagnosis | CircleDiagnosis, own_effects: Sequence[Effect]) -> Told:
    """Tell a diagnosis."""
    titles = {one.id: one.title for one in own_effects}
    return _of_circles(diagnosis, titles) if isinstance(diagnosis, CircleDiagnosis) else _of_points(diagnosis, titles)


def _of_points(diagnosis: Diagnosis, titles: Mapping[str, str]) -> Told:
    found = {str(one.reference) for one in diagnosis.found}
    cards = [_finding(one, _rank(number, diagnosis), titles) for number, one in enumerate(diagnosis.found)]
    tied = diagnosis.not_told_apart
    first = {one.reference for one in diagnosis.tied}
    cards += [_finding(one, _rank_of_tied(one, diagnosis, one.reference in first), titles) for one in tied]
    if diagnosis.unknown is not None:
        cards.append(_unknown(diagnosis.unknown))
    known = found | {str(one.reference) for one in tied}
    why = "looked at, and not needed" if found else "not beyond chance"
    left = (one for one in diagnosis.candidates if str(one.reference) not in known)
    others = [_finding(one, ": ".join(filter(None, (why, one.left_because))), titles) for one in left]
    return Told(
        verdict=diagnosis.sentence,
        sentences=tuple(f"{capitalised(on_the_page(note))}." for note in diagnosis.notes),
        cards=tuple(cards),
        others=tuple(others),
        others_title=f"{len(others)} more, {why}",
        not_offered=diagnosis.not_offered,
    )


def _of_circles(diagnosis: CircleDiagnosis, titles: Mapping[str, str]) -> Told:
    found = {str(one.reference) for one in diagnosis.found}
    cards = [_cause(number, one, diagnosis, titles) for number, one in enumerate(diagnosis.ranked, start=1)]
    if diagnosis.unknown is not None:
        unknown = diagnosis.unknown
        said = (("", unknown.words()), ("Certainty", sure_words(unknown.p_value)))
        cards.append(Card("", "Something without a name", said=said, adds="", can_show=False))
    why = "looked at, and not needed" if found else "not beyond chance"
    others = [_suspect(one, why, titles) for one in diagnosis.candidates if str(one.reference) not in found]
    return Told(
        verdict=diagnosis.sentence,
        sentences=tuple(circle_diagnosis_sentences(diagnosis)[1:]),
        cards=tuple(cards),
        others=tuple(others),
        others_title=f"{len(others)} more, {why}",
        not_offered=diagnosis.not_offered,
    )


def _rank_of_tied(one: Finding, diagnosis: Diagnosis, is_the_firsts: bool) -> str:
    """Say what one looks like that these data cannot tell from something that was found."""
    if is_the_firsts:
        return f"looks the same in these data{one.others_words}"
    like = [found for found in diagnosis.found[1:] if one in diagnosis.tied_with(found)]
    return f"looks the same in these data as {listed([str(found.reference) for found in like])}{one.others_words}"


def _rank(number: int, diagnosis: Diagnosis) -> str:
    if diagnosis.tied_with(diagnosis.found[number]):
        return "found, but not told apart from others"
    return "found first" if number == 0 else "found beside the others"


def _finding(one: Finding, rank: str, titles: Mapping[str, str]) -> Card:
    held = one.held_out
    worth = f"worth {um_words(one.worth_um)} rms"
    if held is not None and held.before_um is not None and held.after_um is not None:
        worth += f", held out {held.before_um:.1f} → {um_words(held.after_um)}"
    return Card(
        reference=str(one.reference),
        title=one.effect.title,
        rank=rank,
        worth=worth,
        said=(("Value", "; ".join(one.value_words)), ("Certainty", sure_words(one.p_value))),
        more=(("Where", one.where.words()), *_advice(one, titles)),
        apart=_apart(one) if one.tied or rank.startswith("found, but") else "",
        is_main=one.tied or rank.startswith("found"),
        is_rig=one.is_rig,
    )


def _cause(number: int, one: Cause, diagnosis: CircleDiagnosis, titles: Mapping[str, str]) -> Card:
    share = "" if one.percent is None else f", {one.percent:.0f} % of what is more than noise".replace("-", "−")
    tied = diagnosis.tied_with(one)
    said = [("Value", "; ".join(reading.words() for reading in one.readings))]
    said.append(("Certainty", sure_words(one.p_value)))
    if one.caution:
        said.append(("Careful", one.caution))
    if tied:
        said.append(("These runs cannot tell it from", _names(tied, titles)))
    return Card(
        reference=str(one.reference),
        title=one.effect.title,
        rank=f"number {number} by its part{share}",
        worth=one.worth_words,
        said=tuple(said),
        more=_advice(one, titles),
        apart=_apart(one),
        is_main=True,
        is_rig=one.is_rig,
    )


def _suspect(one: Cause, why: str, titles: Mapping[str, str]) -> Card:
    rank = "looks the same in these runs" if one.tied else why
    worth = f"worth {um_words(one.worth_um)} rms" if one.worth_um > 0.0 else ""
    return Card(
        reference=str(one.reference),
        title=one.effect.title,
        rank=rank,
        worth=worth,
        said=(("Certainty", chance_words(one.p_value)),),
        more=_advice(one, titles),
        apart=_apart(one) if one.tied else "",
        is_main=one.tied,
        is_rig=one.is_rig,
        can_show=False,
    )


def _unknown(unknown: Unknown) -> Card:
    title, said = "Something without a name", (("", unknown.words()),)
    adds = "" if not unknown.can_be_added else f"Add as a {unknown.form}" if unknown.own is None else "Make it finer"
    return Card(unknown.reference, title, said=said, adds=adds, is_main=True)


def _advice(one: Named, titles: Mapping[str, str]) -> tuple[Line, ...]:
    """Give cause, remedy and what looks like it; a user's own effect need not say the first two."""
    lines = (
        ("Cause", one.effect.cause),
        ("To do", one.effect.remedy),
        ("Looks like it", _names(one.aliases[:_MOST_ALIKE], titles)),
    )
    return tuple((what, text) for what, text in lines if text)


def _names(aliases: Sequence[Alias], titles: Mapping[str, str]) -> str:
    return ", ".join(f"{_title(one, titles)} ({round(100.0 * one.correlation)} %)" for one in aliases)


def _title(alias: Alias, titles: Mapping[str, str]) -> str:
    effect = str(alias.reference.effect)
    return titles[effect] if effect in titles else catalogue()[effect].title


def _apart(one: Named) -> str:
    return "" if one.separate_by is None else one.separate_by.words


def _card_from(document: Mapping[str, Any]) -> Card:
    plain = {one.name: document[one.name] for one in fields(Card)}
    return Card(**plain | {name: _lines(plain[name]) for name in ("said", "more")})


def _lines(pairs: Sequence[Sequence[str]]) -> tuple[Line, ...]:
    return tuple((str(what), str(text)) for what, text in pairs)
