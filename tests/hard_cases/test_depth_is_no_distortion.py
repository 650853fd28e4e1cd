"""Depth of the cameras beside offsets of passes: their lenses are judged in the same noise."""

from validation.hidden_effects.cases import development_seed
from validation.hidden_effects.generate import Hidden, generate
from validation.hidden_effects.record import OPTIONS

from geoerr.diagnose.whole_search import searched_whole
from geoerr.effects import catalogue
from geoerr.fit import fit_terms


def test_rows_of_a_picture_are_no_speeds() -> None:
    """The noise was estimated anew beside distortion alone, whose `v_left` was taken for a speed: it came first."""
    case = generate(development_seed(30_009), None, "nine-lines", "offsets-3", [Hidden("rig-depth")], 30.0, 10_000)
    fitted = fit_terms(case.machine, [case.observations], options=OPTIONS)
    _, searched = searched_whole(fitted, catalogue(), threads=1)
    assert [str(one.judged.what.reference) for one in searched.found] == ["rig-depth"]
