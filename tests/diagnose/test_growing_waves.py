"""A wave that is more at one end of an axis than at the other: what its name leaves is no curve of a displacement."""

import numpy as np
from validation.fine_errors import LENGTH_MM, MACHINE, Numbers, measured, screw

from geoerr.cli.diagnose_text import diagnosis_lines
from geoerr.diagnose import diagnose
from geoerr.fit import fit_model


def growing(q: Numbers) -> Numbers:
    """Give a wave that grows from nothing to 12 µm."""
    return np.asarray(3.0 * screw(q) * q / LENGTH_MM)


def test_what_is_left_of_a_wave_on_a_joint_is_told_as_no_curve() -> None:
    """It ended the diagnosis in an error about `empirical:EXX@x`."""
    observations = measured(np.random.default_rng(1), [growing] * 3, 2.0, None)
    diagnosis = diagnose(fit_model(MACHINE, observations).fitted, threads=1)
    assert {one.reference.effect for one in diagnosis.found} == {"periodic", "periodic-second"}
    unknown = diagnosis.unknown
    assert unknown is not None
    assert unknown.depends_on == (unknown.component,)
    assert unknown.curve is None
    assert unknown.own is None
    assert not unknown.can_be_added
    assert "empirical" not in "\n".join(diagnosis_lines(diagnosis, "geoerr add", ""))
