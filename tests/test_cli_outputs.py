"""Outputs of all commands: existing files that Bowstring did not write are not overwritten."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from bowstring.files.atomic_io import file_stem
from bowstring.robot.reader import load_robot
from bowstring.robot.writer import to_yaml
from shell import Shell

MOTION = ("simulate", "amouri2019", "--tension", "1,0,0", "--rise", "0.02", "--hold", "0")
SOLVE = ("solve", "amouri2019", "--tension", "1,0,0")
OVER = ("--over", "E=30 GPa:40 GPa:2")
BENCH = ("bench", "simulate", "amouri2019", "--masses", "0:1:2", "--repeats", "1")


def foreign(path: Path) -> bytes:
    """A file of the type of its extension, written by another program."""
    if path.suffix in (".png", ".svg", ".pdf"):
        figure = Figure()
        figure.text(0.1, 0.5, "Bowstring, drawn by hand")
        figure.savefig(path)
    elif path.suffix == ".gif":
        from PIL import Image

        Image.new("P", (4, 4)).save(path, comment=b"holiday")
    elif path.suffix == ".nc":
        path.write_bytes(b"CDF\x02 years of weather")
    elif path.suffix == ".step":
        path.write_text("ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION(('Open CASCADE Model'),'2;1');\n")
    elif path.suffix == ".stl":
        path.write_bytes(b"STL Exported by Open CASCADE Technology".ljust(80) + bytes(4))
    elif path.suffix in (".glb", ".gltf"):
        path.write_bytes(b'glTF {"asset": {"generator": "Open CASCADE Technology"}}')
    elif path.suffix == ".yaml":
        path.write_text(to_yaml(load_robot("amouri2019"), "for Bowstring"), "utf-8")
    elif path.suffix == ".json":
        path.write_text('{"schema_version": 1, "robot_hash": "", "notes": "mine"}')
    else:
        path.write_text("tip_x_mm,tension_1_N\n1,2\n")
    return path.read_bytes()


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (("solve", "mine.yaml", "--tension", "1,0,0", "--save-history"), "mine.yaml"),
        ((*SOLVE, "--save-history"), "notes.json"),
        (("export", "amouri2019", "--drawing"), "mine.svg"),
        (("export", "amouri2019", "--drawing"), "mine.pdf"),
        (("export", "amouri2019", "--drawing"), "mine.png"),
        (("export", "amouri2019", "--picture"), "mine.png"),
        (("export", "amouri2019", "--out"), "mine.step"),
        (("export", "amouri2019", "--out"), "mine.stl"),
        (("export", "amouri2019", "--out"), "mine.glb"),
        (("export", "amouri2019", "--out"), "mine.gltf"),
        ((*MOTION, "--out"), "mine.nc"),
        ((*MOTION, "--out"), "mine.gif"),
        ((*BENCH, "--out"), "mine.csv"),
    ],
)
def test_a_foreign_file_is_kept(
    shell: Shell, here: Path, arguments: tuple[str, ...], name: str
) -> None:
    before = foreign(here / name)
    assert "overwritten" in (said := shell.error(*arguments, name)) or "of yours" in said
    assert (here / name).read_bytes() == before
    assert [p.name for p in here.iterdir()] == [name]


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ((*SOLVE, "--save-history"), "path"),
        (("export", "amouri2019", "--drawing"), "disk.svg"),
        (("export", "amouri2019", "--drawing"), "disk.pdf"),
        (("export", "amouri2019", "--drawing"), "disk.png"),
        ((*MOTION, "--out"), "run.nc"),
        ((*MOTION, "--out"), "run.gif"),
        ((*MOTION, "--vtk"), "series"),
        ((*BENCH, "--out"), "table.csv"),
    ],
)
@pytest.mark.slow
def test_files_of_bowstring_are_replaced(
    shell: Shell, here: Path, arguments: tuple[str, ...], name: str
) -> None:
    for _ in range(2):
        code, _, err = shell(*arguments, name)
        assert (code, err) == (0, "")
    left = {p.name for p in here.iterdir()} - {"table.truth.json", "table.csv.truth.json"}
    assert left == {name}


@pytest.mark.slow
def test_solids_that_bowstring_wrote_are_replaced(shell: Shell, here: Path) -> None:
    pytest.importorskip("build123d", exc_type=ImportError)
    for name in ("a.step", "a.stl", "a.glb", "a.gltf"):
        for _ in range(2):
            code, _, err = shell("export", "amouri2019", "--out", name)
            assert (code, err) == (0, "")


@pytest.mark.parametrize(
    ("arguments", "result"),
    [
        (("modes", "amouri2019"), "modes.json"),
        (("study", "amouri2019"), "study.json"),
        (("fit", "amouri2019", "--measurements", "table.csv", "--parameter", "gain"), "fit.json"),
    ],
)
def test_a_foreign_folder_is_kept(
    shell: Shell, here: Path, arguments: tuple[str, ...], result: str
) -> None:
    if arguments[0] == "fit":
        assert shell(*BENCH, "--out", "table.csv")[0] == 0
    mine = here / "mine"
    mine.mkdir()
    (mine / result).write_text(json.dumps({"files": [result]}))
    (mine / "notes.txt").write_text("mine")
    said = shell.error(*arguments, "--out", "mine")
    assert "notes.txt, which Bowstring did not write" in said
    (mine / "notes.txt").unlink()
    (mine / result).write_text("[]")
    assert "existing files are not overwritten" in shell.error(*arguments, "--out", "mine")
    assert (mine / result).read_text() == "[]"


def test_a_file_that_was_changed_is_kept(shell: Shell, here: Path) -> None:
    assert shell("modes", "amouri2019", "--count", "1", "--out", "shapes")[0] == 0
    assert shell("modes", "amouri2019", "--count", "1", "--out", "shapes")[0] == 0
    picture = next((here / "shapes").glob("*.svg"))
    picture.write_text(picture.read_text("utf-8") + "<!-- annotated -->", "utf-8")
    said = shell.error("modes", "amouri2019", "--out", "shapes")
    assert f"{picture.name} was changed since Bowstring wrote it" in said
    assert picture.read_text("utf-8").endswith("<!-- annotated -->")


def test_a_series_of_another_program_is_kept(shell: Shell, here: Path) -> None:
    series = here / "series"
    series.mkdir()
    (series / "run.pvd").write_text('<VTKFile><DataSet file="flow.vtu"/></VTKFile>')
    (series / "flow.vtu").write_text("mine")
    assert "run.pvd was not written by Bowstring" in shell.error(*MOTION, "--vtk", "series")
    assert sorted(p.name for p in series.iterdir()) == ["flow.vtu", "run.pvd"]


def test_a_file_created_during_the_work_is_kept(
    here: Path, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    from bowstring.cad import drawing

    draw = drawing.draw_disks

    def meanwhile(*arguments: object) -> Figure:
        (here / "disk.svg").write_text("mine")
        return draw(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(drawing, "draw_disks", meanwhile)
    said = shell.error("export", "amouri2019", "--drawing", "disk.svg")
    assert "not written by Bowstring" in said
    assert (here / "disk.svg").read_text() == "mine"


# -- names of default outputs ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "stem"),
    [
        ("amouri2019", "amouri2019"),
        ("../../up", "up"),
        ("/etc/passwd", "etc_passwd"),
        ("C:\\robots\\a:b", "C_robots_a_b"),
        ("two words", "two_words"),
        ("-rf", "rf"),
        ("..", "robot"),
        ("\N{GREEK SMALL LETTER ALPHA}-1", "\N{GREEK SMALL LETTER ALPHA}-1"),
        (100 * "\N{CJK UNIFIED IDEOGRAPH-4E2D}", 33 * "\N{CJK UNIFIED IDEOGRAPH-4E2D}"),
    ],
)
def test_a_stem_of_a_name_is_one_file_name(name: str, stem: str) -> None:
    assert file_stem(name) == stem


@pytest.mark.parametrize(
    ("arguments", "file"),
    [
        (("map", *OVER), "up-map.png"),
        (("map", *OVER, "--over", "disks.count=5:9:3", "--over", "nu=0:0.3:2"), "up-map.png"),
        (("map", *OVER, "--store", "kept"), "up-map.nc"),
        (("reach", "--errors", "--poses", "64"), "up-reach.png"),
        (("branches", "--tension", "1,0,0"), "up-branches.png"),
        (("control", "--poses", "8"), "up-control.png"),
        (("reach", "--poses", "8"), "up-reach.png"),
        (("uncertainty", "--distributions", "d.yaml"), "up-uncertainty.png"),
    ],
)
def test_a_name_leads_to_no_other_folder(
    shell: Shell, here: Path, arguments: tuple[str, ...], file: str
) -> None:
    # a foreign file of the name that the result would have is refused before any work
    (here / file).write_text("mine")
    (here / "d.yaml").write_text("segments.*.backbone.E: {normal: {mean: 35 GPa, sd: 5 %}}")
    command, *flags = arguments
    said = shell.error(command, "amouri2019", "--set", "name=../up", *flags)
    assert said.startswith("--out: ") and "written by Bowstring" in said and file in said
