"""The page: whole in itself, escaped, the same bytes every time."""

from __future__ import annotations

import hashlib
import json
import platform
import re
import subprocess
import sys
from html.parser import HTMLParser
from importlib import metadata

import numpy as np
import plotly.graph_objects as go
import pytest
from plotly.offline import get_plotlyjs

from geoerr.report.figures import style
from geoerr.report.page import Figure, Paragraph, Section, Table, as_sentence, render_report, write_report
from geoerr.report.provenance import Provenance, provenance_of_command

HOSTILE = "</script><script>alert('1')</script> & \"quoted\" $plotly <b>"
PROVENANCE = Provenance("1.2.3", "geoerr demo 'a b' && x", (("in.csv", "ab" * 32),))


def a_figure() -> go.Figure:
    return go.Figure(go.Scatter(x=np.arange(3.0), y=np.array([1.0, np.nan, 2.0]), name=HOSTILE))


def a_page() -> str:
    sections = [
        Section(
            HOSTILE,
            (
                Paragraph(HOSTILE),
                Table(HOSTILE, (HOSTILE, "n"), ((HOSTILE, "−1.5"), ("b", "not determined"))),
                Figure(a_figure(), HOSTILE),
            ),
        ),
        Section("Second", (Figure(a_figure(), "again"),)),
    ]
    return render_report(HOSTILE, [HOSTILE], sections, PROVENANCE)


class Elements(HTMLParser):
    """Collects start tags and the text of each element kind."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: dict[str, list[str]] = {}
        self.stack: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "br", "link", "img"):
            self.stack.append(tag)

    def handle_endtag(self, tag):
        assert self.stack.pop() == tag

    def handle_data(self, data):
        if self.stack:
            self.text.setdefault(self.stack[-1], []).append(data)


@pytest.fixture(scope="module")
def elements() -> Elements:
    parser = Elements()
    parser.feed(a_page())
    parser.close()
    return parser


def test_elements_are_closed_and_texts_arrive_as_they_are(elements):
    assert not elements.stack
    assert elements.text["h1"] == [HOSTILE]
    assert HOSTILE in elements.text["p"]
    assert HOSTILE in elements.text["td"]
    assert HOSTILE in elements.text["caption"]
    assert elements.text["pre"] == [PROVENANCE.command]
    labels = [attributes["aria-label"] for tag, attributes in elements.tags if "aria-label" in attributes]
    assert HOSTILE in labels


def test_there_are_two_scripts_and_plotly_is_in_there_once(elements):
    scripts = elements.text["script"]
    assert len([tag for tag, _ in elements.tags if tag == "script"]) == 2
    assert scripts[0] == get_plotlyjs()
    figures = re.search(r"var figures = (\[.*?\]);\n", scripts[1], re.DOTALL)
    parsed = json.loads(figures.group(1))
    assert [figure["data"][0]["name"] for figure in parsed] == [HOSTILE, HOSTILE]


def test_nothing_is_loaded_from_anywhere(elements):
    for tag, attributes in elements.tags:
        assert tag not in ("link", "img", "iframe", "object")
        assert "src" not in attributes
        assert not (attributes.get("href") or "#").startswith(("http", "//"))
    policy = next(a["content"] for tag, a in elements.tags if tag == "meta" and "http-equiv" in a)
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy
    style = elements.text["style"][0]
    assert "url(" not in style
    assert "@import" not in style


def test_columns_of_numbers_are_set_flush_right(elements):
    cells = [a.get("class") for tag, a in elements.tags if tag == "td"]
    assert cells[:4] == [None, "number", None, "number"]


def test_names_stay_whole_and_sentences_keep_the_width_to_be_read(elements):
    rows = (("corner −−−", "words " * 20, "between the two of them"), ("centre", "", "1"))
    page = render_report("t", ["s"], [Section("a", (Table("b", ("place", "values", "how"), rows),))], PROVENANCE)
    cells = re.findall(r"<td( class=.*?)?>", page)
    assert cells[:3] == [' class="name"', ' class="sentences"', ""]
    style = elements.text["style"][0]
    assert "td.number, td.name { white-space: nowrap; }" in style
    assert "td.sentences { min-width: 16em; }" in style
    # Outside tables, which scroll alone, what has no blanks, as a digest, breaks where a line ends.
    assert re.search(r"main { [^}]*overflow-wrap: break-word; }", style)


def test_ids_are_in_order_and_unique(elements):
    ids = [attributes["id"] for _, attributes in elements.tags if "id" in attributes]
    assert len(set(ids)) == len(ids)
    assert [name for name in ids if name.startswith("figure-")] == ["figure-1", "figure-2"]
    links = [attributes["href"] for tag, attributes in elements.tags if tag == "a"]
    assert {link[1:] for link in links} <= set(ids)


def test_a_page_without_figures_does_not_carry_plotly():
    page = render_report("t", ["s"], [Section("a", (Paragraph("b"),))], PROVENANCE)
    assert len(page) < 20_000


def test_the_same_input_gives_the_same_bytes_in_another_process(tmp_path):
    write_report(tmp_path / "page.html", "t", ["s"], [Section("a", (Figure(a_figure(), "c"),))], PROVENANCE)
    here = hashlib.sha256((tmp_path / "page.html").read_bytes()).hexdigest()
    program = (
        "import sys, hashlib; sys.path.insert(0, sys.argv[1]); import test_page as t\n"
        "page = t.render_report('t', ['s'], [t.Section('a', (t.Figure(t.a_figure(), 'c'),))], t.PROVENANCE)\n"
        "print(hashlib.sha256(page.encode()).hexdigest())"
    )
    folder = str(__file__).rsplit("/", 1)[0]
    there = subprocess.run([sys.executable, "-c", program, folder], capture_output=True, text=True, check=True)
    assert there.stdout.strip() == here


def test_provenance_has_digests_of_files_only(tmp_path, monkeypatch):
    (tmp_path / "a.json").write_bytes(b"abc")
    monkeypatch.setattr(sys, "argv", ["/usr/bin/geoerr", "verify", "ballbar", "a b.json"])
    provenance = provenance_of_command([tmp_path / "a.json", None, "-", tmp_path / "missing"])
    assert provenance.command == "geoerr verify ballbar 'a b.json'"
    assert provenance.inputs == ((str(tmp_path / "a.json"), hashlib.sha256(b"abc").hexdigest()),)
    assert set(provenance.to_document()) == {"version", "command", "inputs"}


def test_a_page_names_what_its_numbers_were_made_with() -> None:
    page = a_page()
    said = [f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"]
    said += [f"numpy {np.__version__}", f"scipy {metadata.version('scipy')}"]
    assert f"<p>geoerr {PROVENANCE.version}, {', '.join(said)}, opencv-python-headless " in page


def test_no_figure_offers_to_upload_itself() -> None:
    assert "showSendToCloud: false" in a_page()


def test_a_page_says_what_a_browser_without_webgl_does_not_draw(elements) -> None:
    script = elements.text["script"][-1]
    # Which figures are 3-D pictures is told by their traces.
    assert "/3d$/.test(trace.type)" in script
    assert "this browser draws none: it has no WebGL" in script


def test_letters_of_figures_can_be_read_on_paper(elements) -> None:
    script, look = elements.text["script"][-1], elements.text["style"][-1]
    sheet_px, narrowest_px = (int(re.search(rf"{name}\D*(\d+)", script)[1]) for name in ("sheet =", "narrowest ="))
    # Drawn again as narrow as they are ever drawn on a screen, and scaled from there.
    assert f"min-width: {narrowest_px}px" in look
    letters_px = style.template().layout.font.size
    assert 0.75 * letters_px * sheet_px / narrowest_px >= 7.0
    assert "Plotly.relayout" in script.partition('addEventListener("beforeprint"')[0]


def test_numbers_in_tables_have_the_sign_of_figures() -> None:
    table = Table(
        "t", ("from – to", "p", "line"), (("-4 – -2.5", "1e-300", "x-2"), ("-0.5 – 4", "not computable", "y"))
    )
    page = render_report("t", [], [Section("s", (table,))], Provenance("1", "c", ()))
    for cell in ("−4 – −2.5", "−0.5 – 4", "1e-300", "not computable"):
        assert f'<td class="number">{cell}</td>' in page
    assert ">x-2</td>" in page


def test_a_note_is_a_sentence_and_a_column_keeps_its_name() -> None:
    assert as_sentence("3 rows stand alone").text == "3 rows stand alone."
    assert as_sentence("the tables are short").text == "The tables are short."
    assert as_sentence("temp_bed is empty in 7 rows").text == "temp_bed is empty in 7 rows."


def test_three_dimensional_pictures_are_photographed_for_paper(elements) -> None:
    """A browser prints nothing of what the graphics card drew and showed; Plotly's scenes give it again, at once."""
    script, look = elements.text["script"][-1], elements.text["style"][-1]
    printing = script.partition('addEventListener("beforeprint"')[2].partition('addEventListener("afterprint"')
    assert "photograph(plot)" in printing[0]
    assert ".photograph" in printing[2]
    assert 'scene.toImage("png")' in script
    assert ".photograph { position: absolute" in look
    # What the page asks of Plotly by a name that its makers may change.
    assert re.search(r"\.toImage=function\(\w+\)\{[^}]{0,120}\.glplot\.redraw\(\)", get_plotlyjs())
