"""A jump that a drift had learnt keeps its moment: settled in the drift, it was put where the drift forgave it."""

from validation.hidden_effects.sets import single_set

from geoerr.diagnose.asked import diagnose
from geoerr.fit import FitOptions, fit_terms
from geoerr.fit.variables import times_s, variable_columns


def test_lost_steps_under_a_drift_are_named_at_their_moment() -> None:
    one = single_set("lost-steps", 1, 4.0)
    case = one.case(4000, is_study=False)
    fitted = fit_terms(case.machine, [case.observations], options=FitOptions(threads=1))
    (found,) = diagnose(fitted, threads=1).found
    (hidden,) = case.truth
    assert str(found.reference) == f"lost-steps:{hidden.axis}"
    (moment,) = [parameter for parameter in found.parameters if parameter.name == "t0"]
    session, since_s = int(hidden.parameters["session"]), hidden.parameters["t0"]
    sightings = fitted.sightings
    clock_s, times = variable_columns(sightings, ["clock"])[0], times_s(sightings)
    own = sightings.session == session
    after = own & (times - times[own].min() >= since_s)
    # Between two pictures any moment will do.
    assert clock_s[own & ~after].max() - 1.0 <= moment.value <= clock_s[after].min() + 1.0
