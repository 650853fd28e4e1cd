"""The right panel: what is missing, candidate by candidate, and an effect of one's own."""

from __future__ import annotations

from typing import Any

from dash import dcc, html

from geoerr.diagnose import Diagnosis, Finding, Unknown
from geoerr.diagnose.circles import CircleDiagnosis
from geoerr.diagnose.findings import Named
from geoerr.diagnose.words import sure_words, um_words
from geoerr.effects import Effect, catalogue
from geoerr.fit.figures import ErrorFigures
from geoerr.workbench.actions import MISSING, OWN
from geoerr.workbench.explained import TRIAL
from geoerr.workbench.own_effect import CHANNELS
from geoerr.workbench.parts import button, problem, section, sentence, um
from geoerr.workbench.session import Session

_MOST_ALIKE = 4


def missing_panel(session: Session) -> list[Any]:
    """Make the panel."""
    ready = session.step is not None and session.measured is not None and bool(session.measured.tables)
    search = button(
        "Look for what is missing" if session.diagnosis is None else "Look again",
        "diagnose",
        is_main=session.diagnosis is None and ready and not session.model.is_nominal,
        off=session.is_busy or not ready,
    )
    return [
        section("What is missing", [search, problem(session, MISSING), *_answer(session)], name="missing"),
    ]


def own_panel(session: Session) -> Any:
    """Make the form for an own effect; what was tried stands above it, in `own-result`."""
    typed = None if session.trial is None else session.trial.typed
    return section(
        "An effect of your own",
        [
            html.Div(id="own-result"),
            html.Label(["Name", dcc.Input("my effect" if typed is None else typed.name, id="own-name", type="text")]),
            html.Label(
                ["Moves", dcc.Dropdown(CHANNELS, "along" if typed is None else typed.channel, id="own-channel",
                                       clearable=False, searchable=False)]
            ),
            html.Label(
                ["Axis", dcc.RadioItems(["x", "y", "z"], "x" if typed is None else typed.axis, id="own-axis",
                                        inline=True, className="choice")]
            ),
            html.Label(
                ["Formula", dcc.Input("" if typed is None else typed.expression, id="own-formula", type="text",
                                      placeholder="c*(q - 200)^2", debounce=True, className="code")]
            ),
            html.Label(
                ["Searched", dcc.Input("" if typed is None else typed.searched, id="own-searched", type="text",
                                               placeholder="P: 1..20", className="code")]
            ),
            html.Details(
                [
                    html.Summary("What a formula may hold"),
                    html.P(
                        "q is the axis's position in mm, x y z all positions, d the direction of approach (±1), "
                        "v the speed in mm/s, s the travel since it turned round, t the time in s, and every column "
                        "of the data by its name. Other names are numbers that are found: they may multiply. One "
                        "that stands inside a function is searched between two limits: P: 1..20. Results are mm, and "
                        "radians for angles."
                    ),
                ]
            ),
            html.Button("Try it", id="own-try", n_clicks=0, type="button"),
        ],
        name="own",
        explanation="Written as a formula; you see at once whether it helps.",
    )  # fmt: skip


def own_result(session: Session) -> list[Any]:
    """Say whether the formula that was tried helps."""
    trial = session.trial
    if trial is None:
        return [problem(session, OWN)]
    before, after = trial.change.before, trial.change.after
    held = [_headline(fitted.held_out.figures) for fitted in (before, after)]
    inside = [_headline(fitted.figures) for fitted in (before, after)]
    helps = held[0] is not None and held[1] is not None and held[1] < held[0]
    values = [
        f"{parameter.name} = {parameter.value:.4g} ± {parameter.std:.2g}"
        for term in after.terms
        if term.id == trial.typed.reference
        for parameter in (*term.coefficients, *term.inner)
    ]
    return [
        problem(session, OWN),
        html.Div(
            [
                html.P(html.B("It helps." if helps else "It does not help: data that the fit did not see say so.")),
                html.P(f"Held out {um(held[0])} → {um(held[1])}; residual {um(inside[0])} → {um(inside[1])}."),
                html.P(", ".join(values), className="code"),
                html.Div(
                    [
                        button("Add it", "add-trial", is_main=helps, off=session.is_busy),
                        button("Show", "point", TRIAL, title="Show what it explains in the pictures"),
                    ],
                    className="buttons",
                ),
            ],
            className="card",
            **{"data-candidate": TRIAL},
        ),
    ]


def _headline(figures: ErrorFigures | None) -> float | None:
    return None if figures is None else figures.headline_um


def _answer(session: Session) -> list[Any]:
    diagnosis = session.diagnosis
    if diagnosis is None:
        said = "A search over all known effects, and over curves without a name. It takes 5 to 30 seconds."
        return [html.P(said, className="why")]
    if isinstance(diagnosis, CircleDiagnosis):
        cards = [_circle_card(number, one, session) for number, one in enumerate(diagnosis.ranked, start=1)]
        text = "Causes found on the circles." if cards else "Nothing is missing that these circles could show."
        return [html.P(text, className="verdict"), *cards]
    return [
        html.P(sentence(diagnosis.sentence), className="verdict"),
        *_cards(diagnosis, session),
        *_not_offered(diagnosis),
    ]


def _cards(diagnosis: Diagnosis, session: Session) -> list[Any]:
    found = {str(one.reference) for one in diagnosis.found}
    parts = [_card(one, _rank(number, one, diagnosis), session) for number, one in enumerate(diagnosis.found)]
    tied = [one for one in diagnosis.tied[1:] if str(one.reference) not in found]
    parts += [_card(one, "looks the same in these data", session) for one in tied]
    if diagnosis.unknown is not None:
        parts.append(_unknown_card(diagnosis.unknown, session))
    known = found | {str(one.reference) for one in tied}
    others = [one for one in diagnosis.candidates if str(one.reference) not in known]
    if others:
        why = "looked at, and not needed" if diagnosis.found else "not beyond chance"
        parts.append(
            html.Details(
                [html.Summary(f"{len(others)} more, {why}"), *(_card(one, why, session) for one in others)],
                open=not diagnosis.found,
            )
        )
    return parts


def _rank(number: int, one: Finding, diagnosis: Diagnosis) -> str:
    if len(diagnosis.tied) > 1 and one is diagnosis.found[0]:
        return "found, but not told apart from others"
    return "found first" if number == 0 else "found beside the others"


def _card(one: Finding, rank: str, session: Session) -> Any:
    name = str(one.reference)
    held = one.held_out
    is_in = session.step is not None and name in {reference for reference, _ in session.step.effects}
    worth = f"worth {um_words(one.worth_um)} rms"
    if held is not None and held.before_um is not None and held.after_um is not None:
        worth += f", held out {held.before_um:.1f} → {um_words(held.after_um)}"
    alike = [
        f"{_title(str(alias.reference.effect), session)} ({round(100.0 * alias.correlation)} %)"
        for alias in one.aliases[:_MOST_ALIKE]
    ]
    details = [
        html.P([html.B("Where: "), sentence(one.where.words())]),
        html.P([html.B("Cause: "), sentence(one.effect.cause)]) if one.effect.cause else None,
        html.P([html.B("To do: "), sentence(one.effect.remedy)]) if one.effect.remedy else None,
        html.P([html.B("Looks like it: "), ", ".join(alike)]) if alike else None,
    ]
    return _framed(
        one,
        rank,
        [
            html.P(worth, className="worth"),
            html.P([html.B("Value: "), "; ".join(one.value_words)]),
            html.P([html.B("Certainty: "), sure_words(one.p_value)]),
            _separation(one) if one.tied or rank.startswith("found, but") else None,
            html.Details([html.Summary("Where, why, what looks like it"), *details]),
        ],
        _buttons(name, session, is_in=is_in, is_rig=one.is_rig, is_main=one.tied or rank.startswith("found")),
    )


def _separation(one: Named) -> Any:
    separation = one.separate_by
    if separation is None:
        return None
    minutes = "" if separation.minutes is None else f" (about {separation.minutes:g} minutes)"
    plan = "" if separation.plan is None else f": {separation.plan}"
    return html.P([html.B("To tell it apart: "), f"{separation.text}{minutes}{plan}"], className="separate")


def _circle_card(number: int, one: Any, session: Session) -> Any:
    texts = [html.P(sentence(one.words())), html.P([html.B("To do: "), sentence(one.effect.remedy)])]
    rank = f"number {number} by its part"
    return _framed(one, rank, [*texts, _separation(one)], _buttons(str(one.reference), session, is_rig=one.is_rig))


def _unknown_card(unknown: Unknown, session: Session) -> Any:
    return html.Article(
        [
            html.H3("Something without a name"),
            html.P(sentence(unknown.words())),
            _buttons(unknown.reference, session, add="Add as a curve"),
        ],
        className="card",
        tabIndex="0",
        **{"data-candidate": unknown.reference},
    )


def _framed(one: Named, rank: str, texts: list[Any], buttons: Any) -> Any:
    name = str(one.reference)
    return html.Article(
        [html.H3(one.effect.title), html.P([html.Code(name), f" · {rank}"], className="why"), *texts, buttons],
        className="card",
        tabIndex="0",
        **{"data-candidate": name},
    )


def _buttons(
    name: str, session: Session, *, is_in: bool = False, is_rig: bool = False, is_main: bool = True, add: str = "Add"
) -> Any:
    why = "It is the cameras', and never compensated" if is_rig else f"Add {name} to the model and fit again"
    return html.Div(
        [
            button("In the model" if is_in else add, "add", name, is_main=is_main and not is_in,
                   off=session.is_busy or is_in, title=why),
            button("Show", "point", name, title="Show what it would explain in the pictures"),
        ],
        className="buttons",
    )  # fmt: skip


def _not_offered(diagnosis: Diagnosis) -> list[Any]:
    if not diagnosis.not_offered:
        return []
    items = [html.Li([html.Code(name), f": {why}"]) for name, why in diagnosis.not_offered]
    return [html.Details([html.Summary(f"{len(items)} effects were not looked for"), html.Ul(items)])]


def _title(effect_id: str, session: Session) -> str:
    known: dict[str, Effect] = {one.id: one for one in session.own_effects}
    if effect_id in known:
        return known[effect_id].title
    return catalogue()[effect_id].title
