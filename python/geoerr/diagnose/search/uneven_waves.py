"""Probes for what is left of a wave that was found: more of it here than there, or another one on the way back.

Smooth probes see nothing of a wave of a few millimetres, whatever it is multiplied by; once its period is known there
are few functions to look at.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoerr.diagnose.candidates import Candidate, Formulas, Shapes, is_wave_in_some_form
from geoerr.diagnose.functions import Functions
from geoerr.diagnose.probe_variables import Variable
from geoerr.diagnose.probes import Probe
from geoerr.diagnose.search.rivals import Found
from geoerr.diagnose.where import displacement_um
from geoerr.machine import AXES

# Degrees in the variable that a wave's size follows.
_DEGREES = {"position": (1, 3), "condition": (1, 2), "direction": (1,)}


class UnevenWaves:
    """Waves that were found, times functions of every variable; made once for each wave."""

    def __init__(self, functions: Functions, variables: Sequence[Variable]) -> None:
        self.functions = functions
        self.variables = [one for one in variables if one.kind in _DEGREES]
        self._known: dict[int, tuple[Found, list[Probe]]] = {}

    def probes(self, found: Sequence[Found]) -> list[Probe]:
        """Give the probes of all waves among what was found."""
        for one in found:
            if id(one) not in self._known:
                self._known[id(one)] = one, self._of(one)
        return [probe for one in found for probe in self._known[id(one)][1]]

    def _of(self, found: Found) -> list[Probe]:
        settled, what = found.settled, found.judged.what
        term = settled.term
        if term is None or not isinstance(what, Candidate) or not is_wave_in_some_form(self.functions, what):
            return []
        formulas = Formulas(self.functions, term)
        waves = self.functions.values(formulas.codes(settled.shapes.trials[0]))
        moved = (displacement_um(settled.space, settled.displacement) ** 2).sum(axis=0)
        component = AXES[int(np.argmax(moved))]
        return [
            Probe(
                component,
                tuple(sorted({*term.variables, one.name})),
                tuple(
                    _shapes(self.functions, formulas, waves, one.by_rank[:degree]) for degree in _DEGREES[one.kind]
                ),
                len(self.variables),
                "waves",
            )
            for one in self.variables
        ]


def _shapes(functions: Functions, formulas: Formulas, waves: np.ndarray, sizes: np.ndarray) -> Shapes:
    """Give a wave's columns times each of some sizes (k, n), a coefficient for each product."""
    own = formulas.columns
    n = 1 + max(coefficient for _, coefficient in own)
    columns = tuple((part, k + number * n) for number in range(len(sizes)) for part, k in own)
    codes = [functions.given(wave * size) for size in sizes for wave in waves]
    return Shapes(None, formulas.channels, columns, len(sizes) * n, ({},), ((),), np.array([codes]))
