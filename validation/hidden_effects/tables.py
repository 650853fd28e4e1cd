"""The tables of the study, from its file of results.

python -m validation.hidden_effects.tables [validation/hidden_effects_sets.jsonl] [-o validation/hidden_effects.md]
"""

from __future__ import annotations

import argparse
import json
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats
from validation.hidden_effects.judge import (
    RIGHT,
    Line,
    alarmed,
    depends_on,
    fall,
    found_both,
    further,
    inner_errors,
    is_alone_but_for_alike,
    is_among_three,
    is_mostly_itself,
    named,
    unknown_outcome,
)
from validation.hidden_effects.sets import sets_of
from validation.hidden_effects.study import RESULTS

# A plan or chain is said to stand out where chance would do it once in a hundred tables.
_STANDS_OUT = 0.01
# Kinds of which sets were looked at while causes were mended, and all sets then run again; the null sets that were
# looked at before they were.
_LOOKED_AT = {
    *("periodic", "periodic-harmonics", "warm-up", "warm-up-two", "rig-scale-thermal", "rig-depth", "rig-distortion"),
    "acceleration-sign",
}
_NULLS_LOOKED_AT = 75


def read_lines(path: Path) -> list[Line]:
    """Read results; the last of a key counts, and a line that was cut short does not."""
    lines: dict[str, Line] = {}
    for text in path.read_text(encoding="utf-8").splitlines():
        with suppress(json.JSONDecodeError):
            line = json.loads(text)
            lines[line["key"]] = line
    return [*lines.values()]


def rate(k: int, n: int) -> str:
    """Give a share with its exact binomial interval (Clopper–Pearson, 95 %)."""
    if not n:
        return "–"
    interval = stats.binomtest(k, n).proportion_ci(0.95, "exact")
    return f"{k}/{n} = {100 * k / n:.1f} % ({100 * interval.low:.1f}–{100 * interval.high:.1f})"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Give a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines) + "\n"


def standing_out(lines: Sequence[Line], is_bad: Callable[[Line], bool], what: str) -> str:
    """Name plans and chains whose share of failures differs from the others' (Fisher, Bonferroni)."""
    ran = [line for line in lines if not line["failed"]]
    bad = np.array([is_bad(line) for line in ran], dtype=bool)
    found = []
    for key in ("plan", "chain", "noise"):
        values = np.array([line[key] for line in ran])
        groups = np.unique(values)
        for group in groups:
            own = values == group
            counts = [
                [int((bad & own).sum()), int((~bad & own).sum())],
                [int((bad & ~own).sum()), int((~bad & ~own).sum())],
            ]
            p = float(stats.fisher_exact(counts)[1]) * len(groups)
            if p < _STANDS_OUT:
                mine, others = (f"{counts[place][0]} of {sum(counts[place])}" for place in (0, 1))
                found.append(f"{key} {group}: {mine}, others {others} (p = {p:.1g})")
    return f"Stand out in {what}: {'; '.join(found) or 'no plan, no chain, no noise'}.\n"


def nulls(lines: Sequence[Line]) -> str:
    """Give alarms by kind of noise, and whether the p-values are uniform."""
    by_noise = _by(lines, "cell")
    rows = [
        [
            noise,
            rate(sum(map(alarmed, own)), len(own)),
            f"{stats.kstest([one['p'] for one in own], 'uniform').pvalue:.2g}",
            *_quantiles(own),
        ]
        for noise, own in by_noise.items()
    ]
    p = [one["p"] for one in lines]
    test = stats.kstest(p, "uniform")
    text = table(["noise", "alarms", "p uniform (KS)", "p ≤ 0.01", "p ≤ 0.05", "p ≤ 0.5"], rows)
    text += f"\nAll {len(p)}: Kolmogorov–Smirnov D = {test.statistic:.3f}, p = {test.pvalue:.2g}.\n"
    return text + "\n" + standing_out(lines, alarmed, "false alarms")


def _quantiles(lines: Sequence[Line]) -> list[str]:
    p = np.array([one["p"] for one in lines])
    return [f"{100 * np.mean(p <= level):.1f} %" for level in (0.01, 0.05, 0.5)]


_NAMED = (
    "named (first, or tied with it)",
    "first alone",
    "first, alone but for what is alike",
    "among three",
    "wrong",
)


def single(lines: Sequence[Line]) -> str:
    """Give how effects of the catalogue were named, by strength and by kind."""
    by_size = sorted(_by(lines, "strength_um").items())
    head = ["visible µm", "sets", *_NAMED, "unknown", "silent", "failed", "further names"]
    text = table(head, ([f"{size:g}", str(len(own)), *_how_named(own, rate)] for size, own in by_size))
    visible = [line for line in lines if line["strength_um"] >= 1.0]
    strong = [line for line in lines if line["strength_um"] >= 4.0]
    text += "\n" + standing_out(visible, lambda one: named(one) not in RIGHT, "names")
    text += "\n" + standing_out(
        strong, lambda one: not is_alone_but_for_alike(one), "first, alone but for what is alike, at 4 µm and more"
    )
    rows = []
    for kind, of_kind in _by(lines, "cell").items():
        for size, own in sorted(_by(of_kind, "strength_um").items()):
            wrong = Counter(_effect(one["found"][0]["name"]) for one in own if named(one) == "wrong")
            instead = ", ".join(f"{name} ({k})" for name, k in wrong.most_common(3))
            rows.append([kind, f"{size:g}", *_how_named(own, lambda k, n: f"{k}/{n}"), instead])
    return text + "\n" + table(["effect", "visible µm", *head[2:], "named instead"], rows)


def _how_named(lines: Sequence[Line], write: Callable[[int, int], str]) -> list[str]:
    count, n = Counter(map(named, lines)), len(lines)
    alike = sum(map(is_alone_but_for_alike, lines))
    counts = [sum(count[one] for one in RIGHT), count["alone"], alike, sum(map(is_among_three, lines))]
    counts += [count[one] for one in ("wrong", "unknown", "silent", "failed")]
    return [write(k, n) for k in [*counts, sum(bool(further(one)) for one in lines if not one["failed"])]]


def _effect(name: str) -> str:
    return name.split("@")[0].split(":")[0]


def pairs(lines: Sequence[Line]) -> str:
    """Give how often both of two effects were found."""
    n = len(lines)
    spurious = sum(bool(further(one)) for one in lines)
    rows = [["both", rate(sum(map(found_both, lines)), n)], ["with a name that was not hidden", rate(spurious, n)]]
    missed = Counter(
        name for one in lines if not found_both(one) for name in [one["truth"][0]["kind"], one["truth"][1]["kind"]]
    )
    text = table(["of two", "sets"], rows)
    often = ", ".join(f"{kind} ({count})" for kind, count in missed.most_common(8))
    return (
        text
        + f"\nIn pairs not both found, most often: {often or 'none'}.\n\n"
        + standing_out(lines, lambda one: not found_both(one), "pairs")
    )


def off_formula(lines: Sequence[Line]) -> str:
    """Give how effects that are 30 % off their formula were named, and what became of the rest.

    Seen as uneven: more than half of what nothing absorbs is the unevenness.
    """
    rows = []
    itself, uneven = ([one for one in lines if is_mostly_itself(one) == wanted] for wanted in (True, False))
    groups = {"all": [*lines], "all that are seen as themselves": itself, "all that are seen as uneven": uneven}
    for kind, own in [*groups.items(), *_by(lines, "cell").items()]:
        count, n = Counter(map(named, own)), len(own)
        right = sum(count[one] for one in RIGHT)
        rest = [one for one in own if one["unknown"] is not None and one["found"]]
        on = sum(one["truth"][0]["off_variable"] in one["unknown"]["depends_on"] for one in rest)
        rows.append(
            [
                kind,
                rate(right, n),
                rate(count["wrong"], n),
                rate(len(rest), n),
                rate(on, n),
                rate(sum(bool(further(one)) for one in own), n),
            ]
        )
    return table(["effect", "named", "wrong", "remainder unknown", "on the right axis", "further names"], rows)


def unlisted(lines: Sequence[Line]) -> str:
    """Give what came of effects that the catalogue lacks."""
    rows = []
    for size, own in sorted(_by(lines, "strength_um").items()):
        for kind, some in [("all", own), *_by(own, "cell").items()]:
            count, n = Counter(map(unknown_outcome, some)), len(some)
            instead = Counter(
                ",".join(sorted(depends_on(one)[0])) for one in some if unknown_outcome(one) == "inexact"
            )
            names = Counter(one["found"][0]["name"] for one in some if unknown_outcome(one) == "named")
            told = ", ".join(f"{name} ({k})" for name, k in (instead + names).most_common(3)) if kind != "all" else ""
            rows.append(
                [
                    f"{size:g}",
                    kind,
                    rate(count["exact"], n),
                    str(count["inexact"]),
                    rate(count["named"], n),
                    str(count["silent"]),
                    told,
                ]
            )
    return table(
        ["visible µm", "effect", "unknown, exactly right", "other variables", "named", "silent", "said instead"], rows
    )


def held_out(lines: Sequence[Line]) -> str:
    """Give how far the held-out error falls, against an oracle's."""
    rows = []
    for size, own in sorted(_by(lines, "strength_um").items()):
        known = [values for one in own if named(one) in RIGHT and (values := fall(one)) is not None]
        if not known:
            continue
        before, after, oracle = np.array(known).T
        share = 1.0 - (after - oracle) / np.maximum(before - oracle, 1e-9)
        clear = before > oracle * 1.0005
        pooled = 1.0 - (after - oracle).sum() / max((before - oracle).sum(), 1e-9)
        near = after <= 1.05 * oracle
        enough = (share >= 0.8)[clear]
        rows.append(
            [
                *(
                    f"{size:g}",
                    str(len(known)),
                    f"{np.median(before):.2f}",
                    f"{np.median(after):.2f}",
                    f"{np.median(oracle):.2f}",
                ),
                *(f"{100 * pooled:.0f} %", rate(int(enough.sum()), len(enough)), rate(int(near.sum()), len(near))),
            ]
        )
    head = [
        "visible µm",
        "sets named",
        "before µm",
        "after µm",
        "oracle µm",
        "excess gone, pooled",
        "sets where ≥ 80 % is gone",
        "within 5 % of the oracle",
    ]
    return table(head, rows) + (
        "\nMedians of held-out RMSE, after all that was found was added; excess is over the oracle's own error on "
        "the same data,\nof sets where that is more than 0.05 %. What repeats scatter is known to a per cent or so, "
        "which is more than the excess\nof 1 µm beside 10 µm of noise: so the oracle stands for the floor.\n"
    )


def inner(lines: Sequence[Line]) -> str:
    """Give how near inner parameters are, and whether their standard errors are honest."""
    found: dict[tuple[str, str], list[tuple[float, float, float | None, bool]]] = defaultdict(list)
    for one in lines:
        if one["strength_um"] >= 4.0:
            for name, *values in inner_errors(one):
                found[one["cell"], name].append((values[0], values[1], values[2], values[3]))
    near = [one[3] for own in found.values() for one in own]
    rows = [["all", "", rate(sum(near), len(near)), "", ""]]
    for (kind, name), own in found.items():
        z = np.array([error / std for error, std, _, _ in own])
        to_bound = [abs(error) / bound for error, _, bound, _ in own if bound]
        rows.append(
            [
                *(kind, name, rate(sum(near for *_, near in own), len(own)), f"{np.sqrt(np.mean(z**2)):.2f}"),
                f"{np.median(to_bound) / 0.6745:.2f}" if to_bound else "–",
            ]
        )
    return table(["effect", "parameter", "near enough", "RMS error / stated", "error / bound (robust)"], rows)


def not_looked_at(by_part: dict[str, list[Line]]) -> str:
    """Give the rates of what was never looked at while causes were mended."""
    rows = []
    nulls_left = [one for one in by_part.get("nulls", []) if one["number"] >= _NULLS_LOOKED_AT]
    if nulls_left:
        p = stats.kstest([one["p"] for one in nulls_left], "uniform").pvalue
        alarms = rate(sum(map(alarmed, nulls_left)), len(nulls_left))
        rows.append(["nothing hidden", alarms, f"alarms; p uniform (KS): {p:.2g}"])
    for size, own in sorted(_by(by_part.get("single", []), "strength_um").items()):
        left = [one for one in own if one["cell"] not in _LOOKED_AT and one["failed"] != "not-carried"]
        right, alone = (sum(map(is_so, left)) for is_so in (lambda one: named(one) in RIGHT, is_alone_but_for_alike))
        rows.append([f"catalogue, {size:g} µm", rate(right, len(left)), "named (first, or tied with it)"])
        rows.append(["", rate(alone, len(left)), "first, alone but for what is alike"])
    for size, own in sorted(_by(by_part.get("unlisted", []), "strength_um").items()):
        left = [one for one in own if one["cell"] not in _LOOKED_AT]
        exact = sum(unknown_outcome(one) == "exact" for one in left)
        rows.append([f"not in the catalogue, {size:g} µm", rate(exact, len(left)), "unknown, exactly right"])
    return (
        f"Without all sets of {', '.join(sorted(_LOOKED_AT))},\n"
        "of which some were looked at while causes were mended before all were run again, and without null sets up "
        f"to number {_NULLS_LOOKED_AT - 1} of each noise:\n\n"
    ) + table(["hidden", "sets", "which"], rows)


def seconds(lines: Sequence[Line]) -> str:
    """Give the time that fit and diagnosis took."""
    rows = []
    for part, own in _by([line for line in lines if not line["failed"]], "part").items():
        cells = []
        for key in ("fit", "diagnose"):
            cpu, wall = ([one[clock][key] for one in own] for clock in ("cpu_seconds", "seconds"))
            cells.append(f"{np.median(cpu):.2f} ({np.max(cpu):.2f}); {np.median(wall):.2f}")
        rows.append([part, str(len(own)), *cells])
    return table(["part", "sets", "fit: processor s, median (most); clock", "diagnosis"], rows)


def _by(lines: Iterable[Line], key: str) -> dict[Any, list[Line]]:
    result: dict[Any, list[Line]] = defaultdict(list)
    for line in lines:
        result[line[key]].append(line)
    return dict(result)


SECTIONS: dict[str, tuple[str, Callable[[Sequence[Line]], str]]] = {
    "nulls": ("Nothing hidden", nulls),
    "single": ("One effect of the catalogue", single),
    "pairs": ("Two at once", pairs),
    "off-formula": ("30 % off the formula", off_formula),
    "unlisted": ("Not in the catalogue", unlisted),
    "large": ("One effect of three and ten times the noise", single),
    "changed": ("What changed between two sessions", single),
}


def tables(lines: Sequence[Line]) -> str:
    """Give all tables."""
    by_part = _by(lines, "part")
    text = "# Hidden effects: what was found of them\n"
    whole = {part: sum(1 for _ in sets_of(part)) for part in SECTIONS}
    rows = sorted({line["n_rows"] for line in lines})
    done = ", ".join(f"{part} {len(by_part.get(part, []))} of {n}" for part, n in whole.items())
    text += f"\nSets of the study that are in these tables: {done}; of {', '.join(map(str, rows))} rows or so.\n"
    text += "What fails in them, and why as far as that is known: [hidden_effects/](hidden_effects/README.md).\n"
    for part, (title, section) in SECTIONS.items():
        own = by_part.get(part, [])
        failed = [line for line in own if line["failed"]]
        ran = [line for line in own if not line["failed"]]
        if not own:
            continue
        text += f"\n## {title}\n\n"
        carried = [line for line in failed if line["failed"] != "not-carried"]
        if failed:
            text += f"{len(failed) - len(carried)} sets that no plan shows; {len(carried)} that ended in an error"
            text += "".join(f"\n- {line['key']}: {line['failed'][:160]}" for line in carried[:10]) + "\n\n"
        # What ended in an error was not named.
        text += section([*ran, *carried] if section is single else ran)
        if section is single:
            text += f"\n### Held-out error\n\n{held_out(ran)}\n### Inner parameters at 4 µm and more\n\n{inner(ran)}"
    text += f"\n## Sets that nobody had looked at\n\n{not_looked_at(by_part)}"
    return text + f"\n## Time\n\n{seconds(lines)}"


def main() -> None:
    """Write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="?", default=RESULTS)
    parser.add_argument("-o", "--output", type=Path, help="default: on the screen")
    given = parser.parse_args()
    text = tables(read_lines(given.results))
    if given.output is None:
        print(text)
    else:
        given.output.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
