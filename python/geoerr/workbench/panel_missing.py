"""The right panel: what is missing, candidate by candidate, and an effect of one's own."""

from __future__ import annotations

from typing import Any

from dash import dcc, html

from geoerr.diagnose.circles import CircleDiagnosis
from geoerr.diagnose.words import sure_words
from geoerr.effects.values import value_words
from geoerr.fit.figures import ErrorFigures
from geoerr.fit.from_nothing import SIGNIFICANCE
from geoerr.terms import Parameter
from geoerr.workbench.actions import MISSING, OWN
from geoerr.workbench.explained import TRIAL
from geoerr.workbench.own_effect import CHANNELS
from geoerr.workbench.parts import STAYS, button, problem, section, sentence, um
from geoerr.workbench.pictures import WITHOUT_BUTTONS, in_panel
from geoerr.workbench.session import Session
from geoerr.workbench.told import Card, Told
from geoerr.workbench.wanting import wanting

# Axis, and each bar.
_BARS_PX = (44, 26)
_MANY_ROWS = 20_000
# Share of its standard error below which a value says nothing.
_NOTHING = 1e-6
_KEPT = (
    "Kept from the saved session, in words. The numbers behind them are too many for its file: the first “Show” "
    "searches for them again, and finds the same. So does “Look again”, for the report too."
)
_HELPS, _HELPS_NOT = "It helps.", "It does not help: data that the fit did not see say so."
_CHANCE = "It may be chance: where there is nothing, as much is often gained."
_SAME = "It makes no difference: what it says the model has already, or these data do not show it."
# A person's own formula states no units.
_UNITS = ", in the units of the formula: mm, s, radians"
_AS_IT_IS = ("Value", "Certainty", "Looks like it", "These runs cannot tell it from")


def missing_panel(session: Session) -> list[Any]:
    """Make the panel."""
    ready = not wanting(session)
    search = button(
        "Look for what is missing" if session.told is None else "Look again",
        "diagnose",
        is_main=session.told is None and ready and (session.has_circles_only or not session.model.is_nominal),
        rests=True,
        off=not ready,
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
            html.Label(
                ["Name", dcc.Input("my effect" if typed is None else typed.name, id="own-name", type="text", **STAYS)]
            ),
            html.Label(
                ["Moves", dcc.Dropdown(CHANNELS, "along" if typed is None else typed.channel, id="own-channel",
                                       clearable=False, searchable=False, **STAYS)]
            ),
            html.Label(
                ["Axis", dcc.RadioItems(["x", "y", "z"], "x" if typed is None else typed.axis, id="own-axis",
                                        inline=True, className="choice", **STAYS)]
            ),
            html.Label(
                ["Formula", dcc.Input("" if typed is None else typed.expression, id="own-formula", type="text",
                                      placeholder="c*(q - 200)^2", debounce=True, className="code", **STAYS)]
            ),
            html.Label(
                ["Numbers to search for, between limits",
                 dcc.Input("" if typed is None else typed.searched, id="own-searched", type="text",
                           placeholder="P: 1..20", className="code", **STAYS)]
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
    # A fall that does not show in the figures is none.
    changes = um(held[0]) != um(held[1])
    falls = changes and held[0] is not None and held[1] is not None and held[1] < held[0]
    helps = falls and trial.p_value < SIGNIFICANCE
    verdict = _HELPS if helps else _CHANCE if falls else _HELPS_NOT if changes else _SAME
    values = [tried_value(parameter) for term in trial.terms for parameter in (*term.coefficients, *term.inner)]
    return [
        problem(session, OWN),
        html.Div(
            [
                html.H3(", ".join(term.title for term in trial.terms)),
                html.P(
                    [", ".join(term.id for term in trial.terms), ": ", html.Code(trial.typed.expression)],
                    className="why",
                ),
                html.P(html.B(verdict)),
                html.P(f"Held out {um(held[0])} → {um(held[1])}; residual {um(inside[0])} → {um(inside[1])}."),
                html.P([html.B("Value: "), "; ".join(values), html.Span(_UNITS, className="why")]),
                *(html.P([html.B("Other periods: "), sentence(one)]) for one in trial.other_periods),
                html.P([html.B("Certainty: "), sure_words(trial.p_value)]) if falls else None,
                html.Div(
                    [
                        button("Add it", "add-trial", is_main=helps, rests=True),
                        button("Show", "point", TRIAL, title="Show what it explains in the pictures"),
                    ],
                    className="buttons",
                ),
            ],
            className="card",
            **{"data-candidate": TRIAL},
        ),
    ]


def tried_value(parameter: Parameter) -> str:
    """Say the value of a formula's number, or that there is none to be said."""
    if abs(parameter.value) < _NOTHING * parameter.std:
        # What the data leave free is followed as little as can be.
        return f"{parameter.label} cannot be told from what the model has already"
    return value_words(parameter)


def _headline(figures: ErrorFigures | None) -> float | None:
    return None if figures is None else figures.headline_um


def _answer(session: Session) -> list[Any]:
    told = session.told
    if told is None:
        if wanting(session):
            return [html.P("Needs a machine and measured points, or circular tests.", className="why")]
        n_rows = 0 if session.seen is None else len(session.seen.comparison.points.sightings)
        takes = "some minutes with so many rows; it can be stopped" if n_rows > _MANY_ROWS else "5 to 30 seconds"
        said = f"A search over all known effects, and over curves without a name. It takes {takes}."
        if session.has_circles_only:
            said = "Causes of circular tests, ranked by what each is worth. It takes a few seconds."
        return [html.P(said, className="why")]
    diagnosis = session.diagnosis
    return [
        html.P(sentence(told.verdict), className="verdict"),
        *(html.P(sentence(text), className="why") for text in told.sentences),
        html.P(_KEPT, className="why") if diagnosis is None else None,
        _causes_graph(diagnosis) if isinstance(diagnosis, CircleDiagnosis) else None,
        *(_card(one, session) for one in told.cards),
        _others(told, session),
        _not_offered(told),
    ]


def _causes_graph(diagnosis: CircleDiagnosis) -> Any:
    """Draw each cause's part, and what no cause explains."""
    figure = in_panel(diagnosis.plot_causes(), "causes", margin={"l": 10, "r": 30, "t": 4, "b": 34})
    figure.update_yaxes(automargin=True, tickfont={"size": 11})
    figure.update_xaxes(title_text="part of what is more than noise, %", title_font_size=11)
    height_px = _BARS_PX[0] + _BARS_PX[1] * (len(diagnosis.found) + 1)
    return dcc.Graph(figure=figure, config=WITHOUT_BUTTONS, style={"height": f"{height_px}px"})


def _others(told: Told, session: Session) -> Any:
    if not told.others:
        return None
    cards = [_card(one, session) for one in told.others]
    return html.Details([html.Summary(told.others_title), *cards])


def _card(one: Card, session: Session) -> Any:
    is_in = session.step is not None and one.reference in {reference for reference, _ in session.step.effects}
    more = [_line(*line) for line in one.more]
    return html.Article(
        [
            html.H3(one.title),
            html.P([html.Code(one.reference), f" · {one.rank}"], className="why") if one.rank else None,
            html.P(one.worth, className="worth") if one.worth else None,
            *(_line(*line) for line in one.said),
            html.P([html.B("To tell it apart: "), one.apart], className="separate") if one.apart else None,
            html.Details([html.Summary(_unfolding(one)), *more]) if more else None,
            _buttons(one, session, is_in=is_in),
        ],
        className="card",
        tabIndex="0",
        **{"data-candidate": one.reference},
    )


def _unfolding(one: Card) -> str:
    return "Where, why, what looks like it" if one.more[0][0] == "Where" else "Why, what looks like it"


def _line(what: str, text: str) -> Any:
    # Values are numbers with their signs: no capital, no full stop.
    said = text if what in _AS_IT_IS else sentence(text)
    return html.P([html.B(f"{what}: "), said] if what else said)


def _buttons(one: Card, session: Session, *, is_in: bool) -> Any:
    why = (
        "It is the measuring device's, and never compensated"
        if one.is_rig
        else f"Add {one.reference} to the model and fit again"
    )
    buttons = []
    if one.adds:
        text = "In the model" if is_in else one.adds
        is_main = one.is_main and not is_in
        buttons.append(button(text, "add", one.reference, is_main=is_main, off=is_in, rests=True, title=why))
    if one.can_show:
        title = "Show what it would explain in the pictures"
        # What is found already is shown while other work is under way, too.
        rests = session.diagnosis is None
        buttons.append(button("Show", "point", one.reference, title=title, rests=rests))
    return html.Div(buttons, className="buttons") if buttons else None


def _not_offered(told: Told) -> Any:
    if not told.not_offered:
        return None
    items = [html.Li([html.Code(name), f": {why}"]) for name, why in told.not_offered]
    return html.Details([html.Summary(f"{len(items)} effects were not looked for"), html.Ul(items)])
