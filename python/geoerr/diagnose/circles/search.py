"""The search for what ails a machine: names, structure without a name, values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoerr.diagnose.circles.causes import Suspect
from geoerr.diagnose.circles.columns import Radii
from geoerr.diagnose.circles.found import Found, Searched
from geoerr.diagnose.circles.gross import misfit_um, stand_alone
from geoerr.diagnose.circles.held_out import without_idle
from geoerr.diagnose.circles.names import Names
from geoerr.diagnose.circles.noise import orthonormal
from geoerr.diagnose.circles.rough import as_unknown, without_rough
from geoerr.diagnose.circles.runs import Runs
from geoerr.diagnose.circles.state import State
from geoerr.diagnose.circles.structure import Structure
from geoerr.diagnose.circles.undecided import after_entry, beside_reversals, dies_away, turns_at_reversals
from geoerr.diagnose.circles.values import CAUTION_OF_VALUES, joint, rivals_of, traces_of
from geoerr.diagnose.steps import Steps
from geoerr.fit.jumps import is_jump_in_time
from geoerr.fit.sightings import Numbers
from geoerr.summaries import counted

# Times that the search is repeated without rows that turn out to be gross.
_ROUNDS = 2


def search(runs: Runs, suspects: Sequence[Suspect], steps: Steps) -> Searched:
    """Search, and again without the rows that turn out to be gross."""
    n = len(runs)
    runs = runs.without(stand_alone(runs, runs.signal_um, np.zeros(n)))
    n_gross = n - len(runs)
    whole = runs.averaged()
    searched = _searched(whole, suspects, steps)
    if _n_told(searched) > 1 or any(dies_away(one.way.term) for one in searched.found):
        # Of rows whose side is not known one cause may have become several, or play a wind-up: what needs less
        # without them holds.
        decided = whole.without(after_entry(whole) | beside_reversals(whole))
        without = _searched(decided, suspects, steps, ", without rows beside reversals")
        turns = any(turns_at_reversals(one.way.term) for one in (*searched.found, *without.found))
        searched = without if turns and without.found and _needs(without) < _needs(searched) else searched
    for _ in range(_ROUNDS):
        level = searched.noise.sigma_um * searched.noise.level + misfit_um(searched)
        gross = stand_alone(searched.runs, searched.rest_without_jumps_um, level)
        if not gross.any():
            break
        n_gross += int(gross.sum())
        whole = whole.without(np.isin(whole.rows, searched.runs.rows[gross]))
        searched = _searched(
            searched.runs.without(gross), suspects, steps, f", without {counted(n_gross, 'gross row')}"
        )
    return replace(searched, n_gross=n_gross, whole=whole, whole_traces=_traces_in(whole, searched))


def _n_told(searched: Searched) -> int:
    """Count what is said to be there: causes, and structure without a name."""
    return len(searched.found) + (searched.unknown is not None)


def _needs(searched: Searched) -> tuple[int, int]:
    """Give how much an explanation needs: what it says is there, and the numbers that causes are written with."""
    terms = [one.way.term for one in searched.found]
    return _n_told(searched), sum(len(term.coefficients) + len(term.inner) for term in terms)


def _searched(runs: Runs, suspects: Sequence[Suspect], steps: Steps, beside: str = "") -> Searched:
    steps.next(f"what chance finds{beside}")
    state = State(runs, suspects)
    basis, left = state.context([])
    chance = state.bench.chance(basis, state.n)
    probe_chance = state.probe_bench.chance(basis, state.n)
    steps.next(f"{counted(len(suspects), 'cause')}{beside}")
    judged = sorted(state.bench.judge(basis, left, state.n), key=lambda one: -one.evidence)
    first = tuple((one, min(2.0 * chance.p_value(one.surprise), 1.0)) for one in judged)
    probed = state.probe_bench.judge(basis, left, state.n)
    p_values = [p_value for _, p_value in first] + [2.0 * probe_chance.p_value(one.surprise) for one in probed]
    seen = {one.what for one in judged}
    names = Names(state, chance)
    structure = Structure(state, probe_chance)
    named, idle = without_idle(state, names.search())
    named, rough = without_rough(state, named)
    if rough:
        state.weigh(named)
    steps.next(f"structure without a name{beside}")
    found, withdrawn, unknown = structure.probed(named)
    withdrawn = [*idle, *rough, *withdrawn]
    found, more = without_idle(state, names.needed(names.refined(found)))
    withdrawn += more
    if rough and unknown is None:
        unknown = as_unknown(state, found, rough)
    steps.next(f"what else would say the same, and values{beside}")
    rivals = tuple(rivals_of(state, found, place) for place in range(len(found)))
    scatter = state.noise_beside(found, structure.columns, CAUTION_OF_VALUES)
    estimate, covariance = joint(state, found)
    traces = traces_of(state, found, estimate)
    return Searched(
        runs=runs,
        suspects=state.suspects,
        noise=scatter,
        noise_of_values=state.noise,
        found=tuple(found),
        rivals=rivals,
        first=first,
        unknown=unknown,
        withdrawn=tuple(withdrawn),
        invisible=tuple(one for number, one in enumerate(state.suspects) if number not in seen),
        p_value=min([1.0, *p_values]),
        n_gross=0,
        estimate=estimate,
        covariance=covariance,
        traces=traces,
        whole=runs,
        whole_traces=traces,
        rest_um=runs.signal_um - state.plain(runs.signal_um) - traces.sum(axis=1),
        rest_without_jumps_um=_rest_without_jumps_um(state, found, structure.columns),
    )


def _traces_in(runs: Runs, searched: Searched) -> Numbers:
    """Give what each cause does to the radius of all rows, off the set-up, (n, n_found)."""
    radii, set_up, first = Radii(runs), orthonormal(runs.set_up_columns), 0
    traces = np.zeros((len(runs), len(searched.found)))
    for place, one in enumerate(searched.found):
        columns = one.columns_in(radii)
        own = columns @ searched.estimate[first : first + columns.shape[1]]
        traces[:, place] = own - set_up @ (set_up.T @ own)
        first += columns.shape[1] + len(one.inner)
    return traces


def _rest_without_jumps_um(state: State, found: Sequence[Found], structure: Numbers) -> Numbers:
    """Give what set-up, structure and causes but jumps leave, (n,): of a mistake two jumps make nothing."""
    smooth = [one.columns for one in found if not is_jump_in_time(one.way.term)]
    basis = orthonormal(np.concatenate([state.set_up, structure, *smooth], axis=1))
    return np.asarray(state.runs.signal_um - basis @ (basis.T @ state.runs.signal_um))
