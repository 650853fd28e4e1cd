"""Standard errors of inner parameters that were looked for together."""

import numpy as np
from hidden_machine import machine

from geoerr.diagnose.candidates import is_free
from geoerr.diagnose.scan import Seen
from geoerr.diagnose.search.inner import Derived, standard_errors
from geoerr.effects import catalogue


def test_a_valley_that_explains_as_much_makes_a_value_uncertain() -> None:
    """Variances of two ends, by their likelihood, and the square of how far they are apart."""
    term = catalogue()["bed-bow"].term("work-z", "temp_bed-temp_frame", machine())
    free = [place for place, one in enumerate(term.inner) if is_free(one)]
    n = 1 + len(free)
    here, there = ((6.0, *centre) for centre in ((130.0, 250.0), (90.0, 220.0)))

    def end(inner: tuple[float, ...], gain: float) -> Derived:
        return Derived(
            inner, np.array([1.0]), gain, np.zeros((4, 3, n)), Seen(0.5 * np.eye(12)[:, :n], np.zeros((1, n)))
        )

    alike, unlike = (standard_errors(free, end(here, 500.0), [end(there, gain)]) for gain in (500.0, 400.0))
    np.testing.assert_allclose(alike**2, [4.0, 0.0, 4.0 + 40.0**2 / 2, 4.0 + 30.0**2 / 2])
    np.testing.assert_allclose(unlike**2, [4.0, 0.0, 4.0, 4.0])
