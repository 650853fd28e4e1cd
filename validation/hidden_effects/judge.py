"""What a diagnosis got right of one set: every rule of the study's tables, on a line of results."""

from __future__ import annotations

from typing import Any, Literal

# The rule: candidates whose projected correlation exceeds this are one tied set.
TIED = 0.95
# A period is known much better than anything else; other inner parameters to a tenth.
_WITHIN = {"P": 1e-3}
_USUAL = 0.1
# Places and moments have no size of their own: a tenth of the range that they lie in.
_PLACES = {"q_fixed": None, "x_c": "x", "y_c": "y"}

Named = Literal["alone", "tied", "second", "wrong", "unknown", "silent", "failed"]

Line = dict[str, Any]

# The right name is first, or in the first's tied set.
RIGHT: tuple[Named, ...] = ("alone", "tied", "second")


def alarmed(line: Line) -> bool:
    """Tell whether anything was found."""
    return bool(line["verdict"] != "nothing-missing")


def told_as_tied(line: Line) -> set[str]:
    """Give the names that the report says are not told from the first."""
    first = line["found"][0]["name"] if line["found"] else None
    return {one["name"] for one in line["candidates"] if one["tied"]} - {first}


def alike_to_first(line: Line) -> set[str]:
    """Give the names that the issue's rule counts as one set with the first, by the correlations in the report.

    One that contains the first, as wear along a screw contains play, is alike whatever the data are.
    """
    if not line["found"]:
        return set()
    return {name for name, correlation in line["found"][0]["like"] if correlation > TIED}


def tied_with_first(line: Line) -> set[str]:
    """Give the tied set of the first, without it: by the report, and by the rule."""
    return told_as_tied(line) | alike_to_first(line)


def named(line: Line) -> Named:
    """Say how the first hidden effect was named.

    `alone`: first, and the report ties nothing with it; `tied`: first, with ties; `second`: another is first, and the
    right one is in its tied set; `wrong`: another is first, and the right one is not; `unknown`: no name; `silent`:
    nothing.
    """
    if line["failed"]:
        return "failed"
    if not line["found"]:
        return "unknown" if line["unknown"] else "silent"
    truth = line["truth"][0]["name"]
    if line["found"][0]["name"] == truth:
        return "tied" if told_as_tied(line) else "alone"
    return "second" if truth in tied_with_first(line) else "wrong"


def is_alone_but_for_alike(line: Line) -> bool:
    """Tell whether the set of what is alike (by the rule) stands first, the right name in it and nothing else tied.

    No data of the same plan could tell its members apart, and which of them comes first is chance's.
    """
    how, alike = named(line), alike_to_first(line)
    is_first = how in ("alone", "tied") or (how == "second" and line["truth"][0]["name"] in alike)
    return is_first and told_as_tied(line) <= alike


def is_among_three(line: Line) -> bool:
    """Tell whether the right name is among the first three."""
    truth = line["truth"][0]["name"]
    return not line["failed"] and bool(line["found"]) and truth in [one["name"] for one in line["candidates"][:3]]


def further(line: Line) -> list[str]:
    """Give what was found that was not hidden, beyond the first name."""
    truth = {one["name"] for one in line["truth"]}
    return [one["name"] for one in line["found"][1:] if one["name"] not in truth]


def is_mostly_itself(line: Line) -> bool:
    """Tell whether what can be seen of an uneven effect is more of itself than of its unevenness.

    Offsets and drift may absorb what an effect does everywhere, and leave what it does here and not there.
    """
    truth = line["truth"][0]
    return bool(truth["visible_off_um"] <= 0.5 * truth["visible_um"])


def found_both(line: Line) -> bool:
    """Tell whether each of two hidden effects was found, itself or in the tied set of one that was."""
    if line["failed"] or len(line["found"]) < len(line["truth"]):
        return False
    ties = [
        {one["name"], *(name for name, correlation in one["like"] if correlation > TIED)} for one in line["found"]
    ]
    ties[0] |= tied_with_first(line)
    first, second = (one["name"] for one in line["truth"])
    return any(
        first in own and second in other for a, own in enumerate(ties) for b, other in enumerate(ties) if a != b
    )


def depends_on(line: Line) -> tuple[set[str], set[str]]:
    """Give the variables that were found and those that were hidden, as the table's columns have them."""
    unknown = line["unknown"]
    found = set() if unknown is None else {_column(name) for name in unknown["depends_on"]}
    return found, {_column(name) for name in line["truth"][0]["variables"]}


def _column(name: str) -> str:
    return f"dir_{name[2:]}" if name.startswith("d_") else name


def unknown_outcome(line: Line) -> str:
    """Say what came of an effect that the catalogue lacks: `exact`, `inexact`, `named`, `silent` or `failed`."""
    if line["failed"]:
        return "failed"
    if line["found"]:
        return "named"
    if line["unknown"] is None:
        return "silent"
    found, hidden = depends_on(line)
    return "exact" if found == hidden else "inexact"


def fall(line: Line) -> tuple[float, float, float] | None:
    """Give the held-out error before, with all that was found, and that of an oracle that knows what was hidden."""
    values = (line.get("before_um"), line["found"][-1]["after_um"] if line["found"] else None, line.get("oracle_um"))
    before, after, oracle = values
    return None if before is None or after is None or oracle is None else (before, after, oracle)


def inner_errors(line: Line) -> list[tuple[str, float, float, float | None, bool]]:
    """Compare inner parameters of the first effect, where it was named first.

    Returns
    -------
    list of (name, error, stated standard error, bound, whether it is near enough)
        Near enough is within a tenth (a period 0.1 %), or twice the Cramér–Rao bound.
    """
    if named(line) not in ("alone", "tied"):
        return []
    truth, first = line["truth"][0], line["found"][0]
    compared = []
    for name in truth["inner"]:
        value, std = first["parameters"].get(name, (None, None))
        if value is None or not std:
            continue
        true, bound = truth["parameters"][name], truth["bounds"].get(name)
        error = value - true
        near = max(_WITHIN.get(name, _USUAL) * _size(name, line), 2.0 * (bound or 0.0))
        compared.append((name, error, std, bound, abs(error) <= near))
    return compared


def _size(name: str, line: Line) -> float:
    truth = line["truth"][0]
    if name not in _PLACES:
        return abs(float(truth["parameters"][name]))
    axis = _PLACES[name] or truth["name"].split(":")[1][0]
    low, high = truth["ranges"][axis]
    return float(high - low)


def outcome(line: Line) -> str:
    """Say in a word what came of a set of any part."""
    if line["failed"]:
        return "failed"
    if line["part"] == "nulls":
        return "alarm" if alarmed(line) else "quiet"
    if line["part"] == "pairs":
        return "both" if found_both(line) else "not both"
    return unknown_outcome(line) if line["part"] == "unlisted" else named(line)


def is_right(line: Line) -> bool:
    """Tell whether that is what a set of its part is to come to: the right name first, or in the first's tied set."""
    return outcome(line) in ("quiet", "both", "exact", *RIGHT)
