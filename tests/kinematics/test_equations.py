"""The printed equations, read back as formulas, against the core; and the page that shows them."""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chains import CHAINS, Floats, columns_of

from geoerr import _core
from geoerr.equations import Notation, Seen, equation_terms, error_equations
from geoerr.errors import GeometryError
from geoerr.machine import Machine

DOCS = Path(__file__).parents[2] / "docs" / "theory"
# Li's name of each of the first 21 channels.
LI_NAMES = {
    name: f"{'δ' if name[1] in 'XYZ' else 'ε'}_{dict(zip('XYZABC', 'xyzxyz', strict=True))[name[1]]}{name[2].lower()}"
    if name.startswith("E")
    else name
    for name in _core.CHANNELS[:21]
}


def plain_text(latex: str) -> str:
    """Turn LaTeX back into the other notation's text."""
    latex = latex.replace("&=", "=").replace(" \\\\", "").replace("\\,(", "(").replace("\\,", " ")
    latex = latex.replace("\\delta", "δ").replace("\\varepsilon", "ε").replace("-", "−")
    return re.sub(r"_\{(\w+)\}", r"_\1", latex)


def value_of(text: str, names: dict[str, float]) -> Floats:
    """Evaluate three printed lines as a reader would."""
    values = []
    for line, component in zip(text.splitlines(), "xyz", strict=True):
        left, right = line.split(" = ")
        assert left == f"E_{component}"
        formula = re.sub(r"(?<=\w)\(", "*(", right.replace("−", "-"))
        formula = re.sub(r"(?<=\w) (?=\w)", "*", formula)
        values.append(eval(formula, {"__builtins__": {}}, names))  # the text is the test's subject
    return np.array(values)


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("carrier", ["relative", "tool", "work"])
@pytest.mark.parametrize("notation", ["unicode", "latex"])
def test_what_is_printed_equals_the_columns(chain: str, carrier: Seen, notation: Notation) -> None:
    random = np.random.default_rng(3)
    q, place, errors = random.normal(size=3), random.normal(size=3), random.normal(size=21)
    names: dict[str, Any] = dict(zip(LI_NAMES.values(), errors, strict=True)) | dict(zip("xyz", q, strict=True))
    names |= {f"{letter}_{c}": value for letter in "lw" for c, value in zip("xyz", place, strict=True)}
    printed = error_equations(chain, carrier, notation)
    found = value_of(plain_text(printed) if notation == "latex" else printed, names)
    expected = errors @ columns_of(chain, carrier, q[None, :], place[None, :])[0, :21]
    # Thirty products of numbers near 1.
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-13)


def test_li_equation_8() -> None:
    random = np.random.default_rng(4)
    names = {name: float(value) for name, value in zip(LI_NAMES.values(), random.normal(size=21), strict=True)}
    names |= {name: float(random.normal()) for name in ("x", "y", "z", "l_x", "l_y", "l_z")}
    by_hand = (
        "E_x = δ_xx + δ_xy + δ_xz − y(ε_zx + ε_zz) + z ε_yz + l_z(ε_yx + ε_yy + ε_yz) − l_y(ε_zx + ε_zy + ε_zz)"
        " − S_xy y − S_xz z\n"
        "E_y = δ_yx + δ_yy + δ_yz + x ε_zz − z ε_xz + l_x(ε_zx + ε_zy + ε_zz) − l_z(ε_xx + ε_xy + ε_xz) − S_yz z\n"
        "E_z = δ_zx + δ_zy + δ_zz − x ε_yz + y(ε_xx + ε_xz) − l_x(ε_yx + ε_yy + ε_yz) + l_y(ε_xx + ε_xy + ε_xz)"
    )
    np.testing.assert_allclose(value_of(error_equations("wZbXYt"), names), value_of(by_hand, names), atol=1e-14)


def test_a_machine_will_do_and_a_wrong_code_will_not() -> None:
    machine = Machine.from_chain("wYbZXt", travel_mm=(400.0, 300.0, 250.0))
    assert error_equations(machine) == error_equations("wYbZXt")
    assert error_equations("wbXYZt", "work") == "E_x = 0\nE_y = 0\nE_z = 0"
    with pytest.raises(GeometryError, match="'wXYt' is not a structural code"):
        equation_terms("wXYt")
    with pytest.raises(GeometryError, match="'base' is not relative, tool or work"):
        error_equations("wZbXYt", "base")  # type: ignore[arg-type]  # the point of the test
    with pytest.raises(GeometryError, match="'html' is not unicode or latex"):
        error_equations("wZbXYt", notation="html")  # type: ignore[arg-type]  # the point of the test


def test_the_page_is_what_its_script_makes() -> None:
    made = runpy.run_path(str(DOCS / "make_equations.py"))
    text = (DOCS / "equations.md").read_text(encoding="utf-8")
    assert text == made["page"](), "stale: run python docs/theory/make_equations.py"
    assert made["chains"]() == CHAINS
    for chain in CHAINS:
        assert f"## {chain}\n" in text
