from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

from geoerr.effects import catalogue

DOCS = Path(__file__).parents[2] / "docs"


def test_the_page_is_made_from_today_s_data() -> None:
    spec = importlib.util.spec_from_file_location("make_catalogue", DOCS / "make_catalogue.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    page = (DOCS / "catalogue.md").read_text(encoding="utf-8")
    assert page == module.make_page(catalogue()), "run: python docs/make_catalogue.py"
    for effect in catalogue():
        assert f"### {effect.id}\n" in page


def test_data_files_are_where_the_wheel_takes_them_from() -> None:
    import geoerr.effects

    folder = Path(geoerr.effects.__file__).parent
    assert {path.stem for path in folder.glob("*.toml")} == {effect.family for effect in catalogue()}
