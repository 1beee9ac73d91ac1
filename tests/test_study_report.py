"""The study on disk and in the terminal."""

from __future__ import annotations

import csv
import html
import json
import os
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from matplotlib.figure import Figure

from bowstring.data.measurements import read_measurements
from bowstring.errors import FigureWarning, InputError
from bowstring.files import atomic_io
from bowstring.formatting import in_mm, signed
from bowstring.robot.reader import load_robot
from bowstring.study import figures, report
from bowstring.study.comparison import MEANINGS
from bowstring.study.correction_polynomial import TipPolynomial
from bowstring.study.counterparts import counterparts
from bowstring.study.data_validation import judge_data
from bowstring.study.figure_list import FIGURES
from bowstring.study.run import run_study, settings_of
from bowstring.study.settings import Ramp
from bowstring.study.study import SCHEMA_VERSION, Study
from bowstring.study.summary import summarise
from bowstring.validity.loading import Loading
from bowstring.validity.spread import validity_spread
from bowstring.viz.colours import COLOURS
from bowstring.viz.style import figure_style, svg
from stages import Stages, printed


@pytest.fixture
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip the figures: moving folders needs no drawing."""
    monkeypatch.setattr(figures, "draw", lambda study: iter(()))
    monkeypatch.setattr(report, "_html", lambda study, content, drawn: "<p>a report</p>")


class Page(HTMLParser):
    """Checks that elements nest, and collects the references of a page."""

    VOID = frozenset({"meta", "br", "link", "img", "input", "hr"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.tags: list[str] = []
        self.references: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)
        self.tags.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            if name in ("src", "href", "xlink:href", "srcset", "data", "action"):
                self.references.append(value or "")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open[-1] == tag, f"</{tag}> closes {self.open[-3:]}"
        self.open.pop()

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def read(path: Path) -> Page:
    page = Page()
    page.feed(path.read_text(encoding="utf-8"))
    page.close()
    return page


def table(folder: Path, name: str) -> list[dict[str, str]]:
    """Rows of a table of a report."""
    with (folder / "tables" / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def contents(folder: Path) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()
    }


# -- the page ----------------------------------------------------------------------------------


def test_the_page_is_complete_and_self_contained(written: Path) -> None:
    page = read(written / "report.html")
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    assert all(r.startswith("#") and r[1:] in page.ids for r in page.references)
    text = (written / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"@import|url\((?!#)|<script [^>]*src|<link|\bimport\(|fetch\(", text)
    assert text.count("<script") == 2  # the 3-D view and its data
    # the only addresses are names of XML namespaces
    assert all(a.startswith("http://www.w3.org/") for a in re.findall(r"https?://[^\"' <]+", text))


def test_each_figure_of_the_source_study_has_its_counterpart_or_a_reason(
    written: Path, paper: Study
) -> None:
    rows = counterparts(paper)
    numbers = {int(n) for c in rows for n in re.findall(r"^Fig. (\d+)", c.source)}
    assert numbers == set(range(1, 13)) and rows[-1].source == "Table 1"
    assert all(c.anchor or c.missing for c in rows)
    page = (written / "report.html").read_text(encoding="utf-8")
    for row in rows:
        if row.anchor:
            title = row.title.replace("'", "&#39;")
            link = f'<a href="#{row.anchor}">{title}</a>'
            assert title and link in page and f'id="{row.anchor}"' in page
        else:
            assert f"not available: {row.missing}".replace("'", "&#39;") in page
    # without a solid and measurements, and a photograph
    missing = [c.source for c in rows if not c.anchor]
    assert missing == ["Fig. 1", "Fig. 8", "Fig. 9", "Fig. 12"]
    # named as in the source study
    assert all(
        c.source.startswith(f"Fig. {int(c.anchor[3:5])}")
        for c in rows
        if c.anchor and c.anchor.startswith("fig")
    )


def test_the_page_has_all_results(written: Path, paper: Study) -> None:
    page = read(written / "report.html")
    text = " ".join(" ".join(page.text).split())
    assert page.tags.count("h1") == 1
    assert page.tags.count("caption") == page.tags.count("table")
    assert page.tags.count("figcaption") == len(FIGURES)
    for sentence in paper.verdict.text:
        assert text.count(sentence) == 1
    assert "published mean" in text
    assert "simulated" in text and "not registered" in text
    assert "Effects interact and can cancel" in text
    assert paper.robot.hash in text
    source = (written / "report.html").read_text(encoding="utf-8")
    assert "prefers-color-scheme: dark" in source and "width=device-width" in source
    assert source.count('role="img"') == len(FIGURES) + 1  # and the 3-D view


def test_the_page_says_each_thing_once_and_names_what_it_shows(written: Path) -> None:
    source = (written / "report.html").read_text(encoding="utf-8")
    for element in ("h2", "h3", "summary"):
        titles = re.findall(rf"<{element}[^>]*>(.*?)</{element}>", source)
        assert titles and len(titles) == len(set(titles))
    tables = re.findall(r'role="region" aria-label="([^"]+)"', source)
    assert len(tables) == source.count('class="scroll"') == len(set(tables))
    for figure in re.findall(r"<figure.*?</figure>", source, flags=re.DOTALL):
        assert re.search(r'role="img" aria-label="[^"]{20,}"', figure)
        assert re.search(r"<figcaption><strong>\w", figure)
    # sizes in pixels of a page would not fit all screens
    style = source[source.index("* { box-sizing") : source.index("</style>")]
    assert not re.search(r"width: ?\d{2,}px|<(?:table|td|th|canvas|svg)[^>]* width=", style)
    # without scripts the still stands in the place of the 3-D view
    assert '<div class="still">' in source and '<div id="scene" hidden>' in source


def test_the_page_is_short_until_it_is_unfolded(written: Path) -> None:
    source = (written / "report.html").read_text(encoding="utf-8")
    body = re.sub(r"<(style|script)\b.*?</\1>", "", source, flags=re.DOTALL)
    closed = re.sub(r"(</summary>).*?</details>", r"\1", body, flags=re.DOTALL)
    words = [len(re.sub(r"<[^>]*>", " ", part).split()) for part in (closed, body)]
    assert words[0] < 2000 < words[1]


def test_text_has_contrast_on_light_and_dark_pages(written: Path) -> None:
    def luminance(colour: str) -> float:
        parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [v / 12.92 if v <= 0.03928 else ((v + 0.055) / 1.055) ** 2.4 for v in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    source = (written / "report.html").read_text(encoding="utf-8")
    used = set(re.findall(r'<text [^>]*style="[^"]*fill: var\(--(\w+)', source))
    used |= set(re.findall(r"[ {]color: var\(--(\w+)", source))
    assert {"ink", "muted", "blue", "red"} <= used
    for name in used:
        for colour, paper in zip(COLOURS[name], COLOURS["paper"], strict=True):
            dark, light = sorted([luminance(colour), luminance(paper)])
            assert (light + 0.05) / (dark + 0.05) >= 4.5, name


@pytest.mark.slow
def test_the_robot_as_a_solid_opens_the_page(paper: Study) -> None:
    pytest.importorskip("build123d", exc_type=ImportError)
    whole = replace(paper, solid=True)
    assert [f.stem for f in whole.figures[:2]] == ["fig01_solid", "fig01_robot"]
    assert whole.figures[1:] == paper.figures
    with figure_style():
        stem, draw = next(iter(figures.draw(whole)))
        figure = draw()
        drawing = svg(stem, figure)
        assert re.findall(r"(?:fill|stroke): #[0-9a-f]{3,6}", drawing) == []
        texts = [" ".join(t.get_text().split()) for t in figure.texts]
        assert any("simulated: tendon 1 at" in text for text in texts)


def test_a_figure_that_fails_does_not_take_the_study_with_it(
    paper: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(study: Study) -> Figure:
        raise ValueError("there is no such font")

    stems = [f.stem for f in paper.figures]
    monkeypatch.setattr(
        figures, "_DRAWINGS", {**dict.fromkeys(stems, lambda _: Figure()), stems[1]: fail}
    )
    with pytest.warns(FigureWarning, match=f"figure {stems[1]} is left out"):
        out = report.write(paper, tmp_path / "out")
    listed = json.loads((out / "study.json").read_text("utf-8"))["figures"]
    left = [stem for stem in stems if stem != stems[1]]
    assert [f["stem"] for f in listed] == left
    source = (out / "report.html").read_text("utf-8")
    assert all((f'id="{stem}"' in source) == (stem in left) for stem in stems)


def test_every_colour_follows_the_theme(written: Path) -> None:
    source = (written / "report.html").read_text(encoding="utf-8")
    figures_alone = re.sub(r"<script.*?</script>", "", source, flags=re.DOTALL)
    drawings = re.findall(r"<svg.*?</svg>", figures_alone, flags=re.DOTALL)
    assert len(drawings) == len(FIGURES)
    assert "mathdefault" not in figures_alone  # labels of ticks are plain text
    for drawing in drawings:
        assert re.findall(r"(?:fill|stroke): #[0-9a-f]{3,6}", drawing) == []
        assert "var(--ink" in drawing


@pytest.mark.slow
def test_names_from_a_robot_file_are_escaped(paper: Study, tmp_path: Path) -> None:
    robot = load_robot("amouri2019").with_(
        {"name": "a<b>&c", "description": "<script>alert(1)</script>"}
    )
    folder = report.write(Stages(robot, points=3).over(paper), tmp_path / "out")
    page = read(folder / "report.html")
    assert page.open == [] and page.tags.count("script") == 2
    assert "Is constant curvature good enough for a<b>&c?" in "".join(page.text)


# -- files -------------------------------------------------------------------------------------


def test_the_folder_contains_the_listed_files(written: Path) -> None:
    content = json.loads((written / "study.json").read_text(encoding="utf-8"))
    assert set(contents(written)) == set(content["files"])
    assert len(content["figures"]) == len(FIGURES) == 19
    assert not (written / "figures").exists()


def test_figures_are_files_on_request(
    paper: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawings = dict.fromkeys((f.stem for f in paper.figures), lambda _: Figure())
    monkeypatch.setattr(figures, "_DRAWINGS", drawings)
    monkeypatch.setattr(report, "_html", lambda study, content, drawn: "<p>a report</p>")
    out = report.write(paper, tmp_path / "out", formats=("pdf", "png"))
    content = json.loads((out / "study.json").read_text("utf-8"))
    for figure in content["figures"]:
        path = out / "figures" / figure["stem"]
        assert path.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
        assert path.with_suffix(".pdf").read_bytes().startswith(b"%PDF")
    assert set(contents(out)) == set(content["files"])


def test_study_json_matches_the_study(written: Path, paper: Study) -> None:
    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    text = (written / "study.json").read_text(encoding="utf-8")
    content = json.loads(text, parse_constant=refuse)
    content.pop("files")
    content.pop("sha256")
    assert content["provenance"].pop("robot_file") == "amouri2019"
    assert content == paper.to_dict()
    assert content["provenance"]["schema_version"] == SCHEMA_VERSION


def test_tables_have_units_and_numbers(written: Path, paper: Study) -> None:
    plain = {"name", "against", "n", "status", "disk", "effect", "case", "problem"}
    plain |= {"control", "assumed", "kind", "degree"}
    unit = re.compile(r"_(mm|N|s|MPa|deg|percent|n)$")  # n: a count
    names = set()
    for path in (written / "tables").glob("*.csv"):
        with path.open(newline="", encoding="utf-8") as file:
            header, *rows = list(csv.reader(file))
        names.add(path.stem)
        assert all(c in plain or unit.search(c) for c in header), path.stem
        assert rows and all(len(r) == len(header) for r in rows)
        assert not any(cell.lower() in ("nan", "inf", "-inf") for r in rows for cell in r)
    assert {
        "geometric_sweep",
        "statics",
        "dynamics",
        "comparisons",
        "errors",
        "backbones",
        "shapes",
        "budget",
        "actuation",
    } <= names

    last = table(written, "statics")[-1]
    assert float(last["tension_N"]) == 80.0
    assert float(last["tip_x_mm"]) == pytest.approx(paper.statics.tip_position[-1, 0] * 1e3)
    length = paper.statics.tendon_lengths[-1, 0] * 1e3
    assert float(last["tendon_1_length_mm"]) == pytest.approx(length)
    assert float(last["von_mises_max_MPa"]) == pytest.approx(
        paper.statics.surface.von_mises[-1] / 1e6
    )
    rows = table(written, "errors")
    errors = {(r["name"], r["against"], r["tension_N"]): r for r in rows}
    assert len(errors) == len(paper.comparisons) * 17
    ours = paper.comparison("cc_from_force", "dynamics").error[-1] * 1e3
    row = errors["cc_from_force", "dynamics", "80"]
    assert float(row["error_mm"]) == pytest.approx(ours)


def test_dynamics_is_shown(written: Path, paper: Study) -> None:
    assert paper.dynamics is not None
    text = " ".join(" ".join(read(written / "report.html").text).split())
    for sentence in paper.dynamics_text:
        assert sentence in text
    assert "overshoots by 2.89 mm" in text
    rows = table(written, "dynamics")
    assert len(rows) == len(paper.dynamics.time)
    assert float(rows[-1]["time_s"]) == pytest.approx(paper.dynamics.time[-1])
    assert float(rows[-1]["tension_N"]) == 80.0
    assert float(rows[-1]["tip_x_mm"]) == pytest.approx(
        paper.dynamics.tip_position[-1, 0] * 1e3, rel=1e-8
    )


@pytest.mark.slow
def test_a_study_without_dynamics_says_why(paper: Study, tmp_path: Path) -> None:
    light = {"segments.0.disks.mass": "0 g", "segments.0.backbone.density": "0 kg/m^3"}
    stages = Stages(load_robot("amouri2019").with_(light))
    motion, why_not = stages.ramp
    found = replace(stages.over(paper), dynamics=motion, without_dynamics=why_not)
    folder = report.write(found, tmp_path / "out")
    page = " ".join(" ".join(read(folder / "report.html").text).split())
    assert "Dynamics is left out: amouri2019 has no mass" in page
    assert not (folder / "tables" / "dynamics.csv").exists()
    source = (folder / "report.html").read_text("utf-8")
    assert 'id="fig05_over_time"' not in source and 'id="fig05_tip_against_force"' in source
    shown = printed(found, 80, verbose=True)
    assert "Dynamics is left out" in shown and "vs dynamics" not in shown


@pytest.mark.slow
def test_the_same_study_writes_the_same_bytes(written: Path, paper: Study, tmp_path: Path) -> None:
    again = report.write(paper, tmp_path / "again", robot_file="amouri2019")
    assert contents(again) == contents(written)


# -- the folder is replaced as a whole or not at all -------------------------------------------


@pytest.mark.usefixtures("without_figures")
def test_a_former_study_is_replaced_whole(paper: Study, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "study.json").write_text(json.dumps({"files": ["study.json", "old.csv"]}))
    (out / "old.csv").write_text("of a former version")
    assert report.write(paper, out) == out
    assert not (out / "old.csv").exists()
    assert (out / "report.html").exists()
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.usefixtures("without_figures")
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_a_failure_leaves_the_old_folder(
    paper: Study,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: type[BaseException],
) -> None:
    (tmp_path / "out").mkdir()  # empty, which may be replaced
    out = report.write(paper, tmp_path / "out")
    before = contents(out)

    monkeypatch.setattr(report, "_html", Mock(side_effect=error))
    with pytest.raises(error):
        report.write(paper, out)
    assert contents(out) == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.usefixtures("without_figures")
def test_a_failed_move_puts_the_old_folder_back(
    paper: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = report.write(paper, tmp_path / "out")
    before = contents(out)
    monkeypatch.setattr(atomic_io, "_exchange", lambda *_: False)  # as on some drives
    rename = os.rename

    def fail(source: Path, target: Path) -> None:
        if source.name == "new":
            raise OSError("the disk is gone")
        rename(source, target)

    monkeypatch.setattr(os, "rename", fail)
    with pytest.raises(InputError, match="the disk is gone"):
        report.write(paper, out)
    assert contents(out) == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_the_default_folder_is_below_bowstring_study() -> None:
    robot = load_robot("amouri2019").with_({"name": "../../etc"})
    assert report.default_folder(robot) == Path("bowstring-study") / "etc"


# -- the error budget, wherever it is shown ----------------------------------------------------


def rows_of(source: str, title: str) -> dict[str, list[str]]:
    """Cells of a table of the page by the name of the row."""
    table = re.search(rf'aria-label="{title}">.*?</table>', source, flags=re.DOTALL)
    assert table is not None
    out = {}
    for row in re.findall(r'<tr><th scope="row">(.*?)</tr>', table.group(), flags=re.DOTALL):
        name, *cells = re.sub(r"\s*<[^>]*>\s*", "|", row).strip("|").split("|")
        out[name] = [cell for cell in cells if cell]
    return out


def test_terminal_page_and_table_have_the_same_contributions(written: Path, paper: Study) -> None:
    text = printed(paper, 100, verbose=True)
    in_terminal = {
        line[:26].strip(): line[26:].split()
        for line in text[text.index("(mean error)") : text.index("Actuation: mean")].splitlines()
        if line.strip()
    }
    source = (written / "report.html").read_text(encoding="utf-8")
    pages = [
        rows_of(source, f"Each effect alone in {where}")
        for where in ("this sweep", "the full model")
    ]
    in_table = {(r["effect"], r["case"]): r for r in table(written, "budget")}
    for row in paper.budget.rows:
        ours = in_terminal[re.sub(r" \(.*\)|, not a continuous tendon", "", row.label)]
        in_page = []
        for page in pages:
            cells = page[row.label]
            in_page += [cells[2], cells[5]]
            for first in (0, 3):  # with, without, contribution
                numbers = [
                    float(c.replace("\N{MINUS SIGN}", "-")) for c in cells[first : first + 3]
                ]
                assert numbers[0] - numbers[1] == pytest.approx(numbers[2], abs=0.0101)
        assert ours == in_page
        how = "removed from" if row.acts_in_sweep else "added to"
        in_csv = [
            signed(float(in_table[row.effect, case][f"{name}_contribution_mm"]))
            for case in (f"{how} this sweep", "removed from full model")
            for name in MEANINGS
        ]
        assert ours == in_csv


def browse(page: Path, source: str, *options: str) -> str:
    """Open a page in the system's browser; return its document after its scripts have run."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("needs a browser")
    page.write_text(source, encoding="utf-8")
    given = ["--headless", "--no-sandbox", "--disable-gpu", "--window-size=1280,900", *options]
    given += [f"--user-data-dir={page.parent / 'profile'}", "--virtual-time-budget=5000"]
    done = subprocess.run(
        [browser, *given, page.as_uri()], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr[-500:]
    return done.stdout


def with_script(source: str, script: str) -> str:
    return source.replace("</body>", f"<script>onload = () => {{ {script} }}</script></body>")


UNFOLD = 'document.querySelectorAll("details").forEach((e) => { e.open = true });'


@pytest.mark.slow
def test_no_table_is_cut_in_a_window_of_1280_pixels(paper: Study, tmp_path: Path) -> None:
    data = Path(__file__).parents[1] / "examples" / "bench.csv"
    judged = judge_data(paper.robot, read_measurements(data, paper.robot), 0.01)
    found = replace(paper, data=judged, comparisons=(*paper.comparisons, *judged.comparisons))
    source = report._html(
        found, found.to_dict(), dict.fromkeys((f.stem for f in found.figures), "")
    )
    script = (
        UNFOLD
        + """document.title = [...document.querySelectorAll(".scroll")]
        .map(e => e.scrollWidth - e.clientWidth).join(" ")"""
    )
    shown = browse(tmp_path / "page.html", with_script(source, script), "--dump-dom")
    title = re.search(r"<title>([\d ]+)</title>", shown)
    assert title is not None
    assert title.group(1).split() == ["0"] * source.count('class="scroll"')


@pytest.mark.slow
def test_the_page_fits_screens_and_its_text_can_be_read(written: Path, tmp_path: Path) -> None:
    """Widths and heights in frames of four widths, and the contrast of all text."""
    measure = """
        const root = document.documentElement, lowest = (e) => e.getBoundingClientRect().bottom;
        const style = (e) => getComputedStyle(e), parts = (c) => c.match(/[\\d.]+/g).map(Number);
        const light = (c) => parts(c).slice(0, 3).map((v) => v / 255)
            .map((v) => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
            .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
        const wide = () => root.scrollWidth - root.clientWidth;
        const found = { width: innerWidth, height: root.scrollHeight, wide: wide() };
        found.lowest = Math.max(lowest(document.querySelector(".card")),
            lowest(document.querySelector("#scene output")));
        UNFOLD
        found.unfolded = wide();
        found.values = Math.min(...[...document.querySelectorAll("dd")].map((e) => e.clientWidth));
        const paper = light(style(document.body).backgroundColor);
        found.faint = [...document.querySelectorAll("main *")].filter((e) =>
            [...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim())).filter((e) => {
                const it = light(e instanceof SVGElement ? style(e).fill : style(e).color);
                return (Math.max(it, paper) + 0.05) / (Math.min(it, paper) + 0.05) < 4.5;
            }).map((e) => e.textContent);
        parent.postMessage(found, "*");""".replace("UNFOLD", UNFOLD)
    source = (written / "report.html").read_text(encoding="utf-8")
    (tmp_path / "report.html").write_text(with_script(source, measure), encoding="utf-8")
    frames = "".join(
        f'<iframe src="report.html" style="width: {width}px; height: 720px; border: 0"></iframe>'
        for width in (360, 390, 1280, 1920)
    )
    write = 'document.querySelector("p").append(JSON.stringify(e.data), "\\n")'
    listen = f"<script>onmessage = (e) => {write}</script><p></p>"
    shown = browse(tmp_path / "frames.html", listen + frames, "--dump-dom")
    lines = re.search(r"<p>(.*?)</p>", shown, flags=re.DOTALL)
    assert lines is not None
    found = [json.loads(html.unescape(line)) for line in lines[1].splitlines()]
    assert {each["width"] for each in found} == {360, 390, 1280, 1920}
    for each in found:
        assert (each["wide"], each["unfolded"]) == (0, 0), each
        assert each["values"] > 150 and each["faint"] == [], each
        if each["width"] >= 1280:  # nine screens, the verdict and the robot on the first
            assert each["height"] < 9 * 720 and each["lowest"] < 720, each


@pytest.mark.slow
def test_the_printed_page_has_all_sections_on_few_sheets(written: Path, tmp_path: Path) -> None:
    source = (written / "report.html").read_text(encoding="utf-8")
    browse(tmp_path / "page.html", source, f"--print-to-pdf={tmp_path / 'page.pdf'}")
    pages = len(re.findall(rb"/Type\s*/Page\b", (tmp_path / "page.pdf").read_bytes()))
    assert 8 < pages <= 12  # closed sections would leave four


@pytest.mark.slow
def test_the_page_shows_the_robot_in_3d(written: Path, tmp_path: Path) -> None:
    source = (written / "report.html").read_text(encoding="utf-8")
    # the errors of the page, and the slider at 55 N
    before = "<script>onerror = (e) => { document.body.dataset.error = e }</script></head>"
    script = """const s = document.getElementById("scene-load"); s.value = 11;
        s.dispatchEvent(new Event("input")); const c = document.querySelector("#scene canvas");
        const p = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
        document.body.dataset.drawn = p.filter((v, i) => i % 4 === 3 && v > 0).length"""
    page = with_script(source.replace("</head>", before), script)
    shown = browse(tmp_path / "page.html", page, "--dump-dom")
    assert "data-error" not in shown
    drawn = re.search(r'data-drawn="(\d+)"', shown)
    assert drawn is not None and int(drawn[1]) > 5000
    output = re.search(r"<output[^>]*>([^<]*)</output>", shown)
    assert output is not None
    assert output[1] == (
        "55 N. Tip error of CC from tendon lengths: 0.311 mm; CC from force: 6.17 mm."
    )
    assert '<div id="scene">' in shown and '<div class="still" hidden="">' in shown
    assert (written / "report.html").stat().st_size < 3e6


# -- the terminal ------------------------------------------------------------------------------


@pytest.mark.parametrize("width", [80, 140])
def test_the_terminal_shows_table_verdict_and_path(
    paper: Study, tmp_path: Path, width: int
) -> None:
    text = printed(paper, width, tmp_path, verbose=True)
    assert str(tmp_path / "report.html") in text
    assert "lengths, chords" in text and "force, mean arm" in text
    assert "Verdict at 1 % of length" in text
    assert "vs statics" in text and "vs dynamics" in text
    assert "overshoots" in text
    assert all(len(line) <= width for line in text.splitlines() if str(tmp_path) not in line)


@pytest.mark.parametrize("width", [80, 100])
def test_the_terminal_begins_with_the_verdict_in_27_lines(paper: Study, width: int) -> None:
    shown = printed(paper, width, Path("report"))
    lines = shown.splitlines()
    assert len(lines) <= 27 and all(len(line) <= width for line in lines)
    text = " ".join(shown.split())
    limit = next(m.valid_to for m in paper.verdict.meanings if m.name == "cc_from_force")
    assert limit is not None and f"up to {limit:.3g} N" in text
    assert "because it ignores that tendons run straight between the disks; corr" in text
    assert text.index("From force") < text.index("angle 18 u/(v")
    assert "the worst of 3 tendons" in text
    assert "Friction 0.1 (assumed)" in text and "--verbose" in text
    assert "from lengths the limit is at least 80 N in 86 % of the samples" in text


def test_a_limit_of_0_in_most_samples_has_no_factor(paper: Study) -> None:
    """A transverse gravity bends the straight robot, which constant curvature does not know."""
    numbers = {"gravity.x": {"normal": {"mean": 0.0, "sd": 3.0}}}
    spread = validity_spread(paper.robot, numbers)
    how = dict(summarise(replace(paper, spreads=(spread,))).findings)["How sure"]
    share = f"{100.0 * spread.share_exceeded:.0f} %"
    assert how.endswith(f"from force the limit is 0 N in {share} of the samples")


def test_a_tendon_that_leaves_the_tolerance_earlier_from_lengths_is_named() -> None:
    """In gravity along x both fail from force already at 0 N; tendon 2 errs more."""
    changes = {
        "gravity": "9.8 0 0 m/s^2",
        "segments.0.length": "90 mm",
        "segments.0.backbone.diameter": "1.5 mm",
        "segments.0.backbone.E": "20 GPa",
        "segments.0.disks": {"count": 6, "mass": "1 g", "radius": "9 mm", "thickness": "2 mm"},
        "segments.0.disks.clamped_length": "2 mm",
        "segments.0.tendons": {"count": 2, "pitch_radius": "7 mm"},
    }
    robot = load_robot("amouri2019", changes)
    found = settings_of(robot, 0.01, "cosserat", Loading(max_tension=20.0), Ramp())
    assert found.tried == 2 and found.shares == (0.0, 1.0)
    (sentence,) = found.earlier
    assert "from lengths, the error leaves the tolerance earlier with tendon 1, at" in sentence
    assert sentence.endswith("N of its range to 20 N; --tendon 1 judges it")


def test_a_correction_that_reaches_farther_than_the_polynomial_is_named(paper: Study) -> None:
    unused = np.zeros((1, 3))
    fit = TipPolynomial(*[unused] * 4, np.ones((1, 3), int), unused, 1e-3, 1.0, top=40.0)
    meanings = tuple(replace(m, polynomial=fit) for m in paper.verdict.meanings)
    found = summarise(replace(paper, verdict=replace(paper.verdict, meanings=meanings)))
    headings = [heading for heading, _ in found.findings]
    assert headings[:2] == ["Polynomial from lengths", "Corrected from lengths"]


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_loads_without_equilibrium_are_said_first() -> None:
    """A mean over one load, that without tension, is no mean; one over three says so."""
    soft = {
        "gravity": "0 0 9.80665 m/s^2",
        "segments.0.length": "200 mm",
        "segments.0.backbone.diameter": "1 mm",
        "segments.0.backbone.E": "60 GPa",
        "segments.0.disks.count": 5,
        "segments.0.disks.mass": "2 g",
        "segments.0.disks.clamped_length": "3 mm",
        "segments.0.tendons.count": 4,
        "segments.0.tendons.pitch_radius": "6 mm",
    }
    robot = load_robot("amouri2019", soft)
    found = run_study(robot, loading=Loading(max_tension=50.0, points=5))
    known = {name: found.comparison(name).n for name in MEANINGS}
    assert known == {"cc_from_lengths": 1, "cc_from_force": 3}
    text, (heading, sentence) = summarise(found), summarise(found).findings[0]
    assert [row[2] for row in text.rows] == [
        "\N{EN DASH}",
        in_mm(found.comparison("cc_from_force").mean),
    ]
    assert heading == "Left out" and sentence.startswith("2 of 5 loads have no stable equilibrium")
    assert "first at 37.5 N" in sentence and "smaller largest tension (--max-tension)" in sentence
    assert sentence + "." in found.to_dict()["warnings"]
    rest = dict(text.findings)
    assert [row[3] for row in text.rows] == ["\N{EN DASH}"] * 2  # over other loads
    assert "\N{HORIZONTAL ELLIPSIS}" not in printed(found, 80)  # no cell is cut
    friction = next(sentence for heading, sentence in rest.items() if "Friction" in heading)
    assert "mm (loading, 3 of 5 loads)" in friction
    assert found.verdict.text[-1].startswith("Some commands have no equilibrium")


def test_fonts_in_a_pdf_are_truetype(tmp_path: Path) -> None:
    """IEEE's check of a paper rejects Type 3 fonts."""
    figure = Figure()
    figure.text(0.1, 0.5, "AVA fi \N{MINUS SIGN}2 \N{GREEK SMALL LETTER THETA}")
    with figure_style():
        report.save_figure(figure, tmp_path / "text")
    raw = (tmp_path / "text.pdf").read_bytes()
    assert b"/FontFile2" in raw and b"/Type3" not in raw
