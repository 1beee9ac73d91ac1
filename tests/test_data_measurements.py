"""Tables of measurements: the tidy format, foreign tables, and errors in a table."""

from __future__ import annotations

import json
import math
import re
import sys
import time
import zipfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import openpyxl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bowstring as bs
from bowstring.constant_curvature import Arc, Routing
from bowstring.data import datasets
from bowstring.data.channels import spikes
from bowstring.data.mapping import Mapping, load_mapping, mapping_names
from bowstring.data.measurements import (
    STANDARD_GRAVITY,
    Measurements,
    load,
    read_measurements,
    write_measurements,
)
from bowstring.errors import InputError
from objects import refused, workbook
from shell import Shell

ROOT = Path(__file__).parents[1]
Folder = Callable[[str], Path]

HEADER = "mass_1_kg,mass_2_kg,mass_3_kg,tip_x_mm,tip_y_mm,tip_z_mm"
ROWS = "0,0,0,0,0,641\n0.5,0,0,30.5,0.1,640\n1,0,0,60.5,-0.1,637\n"
GOOD = f"{HEADER}\n{ROWS}"


@pytest.fixture
def file(tmp_path: Path) -> Callable[..., Path]:
    def write(content: str | bytes, name: str = "bench.csv", encoding: str = "utf-8") -> Path:
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
        return path

    return write


@pytest.fixture
def sheet(tmp_path: Path) -> Callable[..., Path]:
    return partial(workbook, tmp_path / "bench.xlsx")


Write = Callable[..., Path]


# -- the tidy format -----------------------------------------------------------------------------


def test_masses_become_tensions(file: Write) -> None:
    found = read_measurements(file(GOOD), bs.load_robot("amouri2019"))
    assert found.source == "measured" and found.name == "bench" and len(found) == 3
    assert found.tensions[1].tolist() == [0.5 * STANDARD_GRAVITY, 0, 0]
    assert np.isnan(found.displacements).all()
    np.testing.assert_allclose(found.tip[1], [0.0305, 0.0001, 0.64], rtol=1e-15)
    assert found.points.shape == (3, 1, 3) and found.line.tolist() == [2, 3, 4]
    assert found.issues == () and found.left_out == 0 and found.scale == 1.0
    assert found.sigma is None and found.time is None and found.repeat.tolist() == [1, 1, 1]
    assert read_measurements(file(GOOD), g=10.0).tensions[2, 0] == 10.0
    for g in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match="it must be above 0 and up to 10000"):
            read_measurements(file(GOOD), g=g)
    with pytest.raises(ValueError, match="read-only"):
        found.tensions[0, 0] = 1


def test_all_columns_of_a_table(file: Write) -> None:
    table = file(
        "# source: computed\n# name: all of it\n# stations: 0.5 1\n# tool: 0 0 8 mm\n"
        "# just a remark\n\n"
        "time_ms,tension_1_mN,displacement_2_cm,point_1_x_m,point_1_y_m,point_1_z_m,"
        "tip_x_m,tip_y_m,tip_z_m,sigma_um,repeat,group,bend_deg,direction_rad\n"
        "500,2500,-1,,,,0.1,0.2,0.3,20,2,up,90,1\n"
        "# in between\n\n"
        " 1e3 ,0,2,1,2,3,0.4,0.5,0.6,20,3,down,45,2\n"
    )
    found = read_measurements(table)
    assert (found.source, found.name) == ("computed", "all of it")
    np.testing.assert_allclose(found.time, [0.5, 1])
    np.testing.assert_array_equal(np.isnan(found.tensions), [[False, True]] * 2)
    np.testing.assert_allclose(found.tensions[:, 0], [2.5, 0])
    np.testing.assert_allclose(found.displacements[:, 1], [-0.01, 0.02])
    assert np.isnan(found.points[0, 0]).all() and found.points[1, 0].tolist() == [1, 2, 3]
    assert found.tip.tolist() == [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]
    np.testing.assert_allclose(found.sigma, [2e-5, 2e-5])
    assert found.repeat.tolist() == [2, 3] and found.group.tolist() == ["up", "down"]
    np.testing.assert_allclose(found.bend, np.radians([90, 45]))
    assert found.direction is not None and found.direction.tolist() == [1, 2]
    assert found.stations is not None and found.stations.tolist() == [0.5, 1]
    assert found.tool.tolist() == [0, 0, 0.008] and found.line.tolist() == [8, 11]


def test_any_unit(file: Write) -> None:
    found = read_measurements(file("tension_1_kgf,tip_x_inch,tip_y_inch,tip_z_inch\n2,1,0,10\n"))
    np.testing.assert_allclose(found.tensions, [[2 * STANDARD_GRAVITY]])
    np.testing.assert_allclose(found.tip, [[0.0254, 0, 0.254]])


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        (GOOD, "utf-8-sig"),
        (GOOD.replace("\n", "\r\n"), "utf-8"),
        (GOOD.replace(",", "\t"), "utf-16"),
        (GOOD.replace(",", ";").replace(".", ","), "utf-8"),
        (GOOD.replace(",", "\t").replace(".", ","), "utf-8"),
        ("# source: measured,,,,,\n\n" + GOOD + ",,,,,\n", "utf-8"),
        (GOOD.replace("\n", ",,\n"), "utf-8"),
        ("# stations: 0.5\n" + GOOD, "utf-8"),
    ],
)
def test_other_notations_of_a_table(text: str, encoding: str, file: Write) -> None:
    found = read_measurements(file(text, encoding=encoding))
    np.testing.assert_allclose(found.tip[1], [0.0305, 0.0001, 0.64], rtol=1e-15)
    assert len(found) == 3 and found.left_out == 0


def test_a_decimal_comma_is_reported(file: Write) -> None:
    found = read_measurements(file(GOOD.replace(",", ";").replace(".", ",")))
    assert found.issues == ((3, "numbers have a decimal comma, and are read so"),)
    mixed = GOOD.replace(",", ";").replace("60.5", "60,5")
    with pytest.raises(InputError, match="decimal comma in line 4 and a decimal point in line 3"):
        read_measurements(file(mixed))
    with pytest.raises(InputError, match="line 2: commas in numbers may stand before decimals or"):
        read_measurements(file("displacement_1_mm\tbend_deg\n1,000\t2\n12,345\t3\n"))
    sure = read_measurements(file("displacement_1_mm\tbend_deg\n1,000\t2\n0,345\t3\n"))
    assert sure.displacements.tolist() == [[0.001], [0.345e-3]] and sure.direction is None
    found = read_measurements(file(GOOD.replace(".", ",")))  # commas also separate the cells
    assert len(found) == 1 and found.left_out == 2
    assert "with decimal commas, separate the cells by semicolons" in found.issues[0][1]


def test_a_workbook(sheet: Write) -> None:
    rows = [["# sigma: 0.02 mm"], [], HEADER.split(","), [0, 0, 0, 0, 0, 641]]
    rows += [[0.5, 0, 0, 30.5, 0.1, 640], [], [1, 0, "x", 1, 1, 1]]
    found = read_measurements(sheet(rows, source=[["synthetic"]], notes=[["hello"]]))
    assert found.source == "synthetic" and found.line.tolist() == [4, 5]
    np.testing.assert_allclose(found.tip[1], [0.0305, 0.0001, 0.64], rtol=1e-15)
    assert found.sigma is not None and found.sigma.tolist() == [2e-5, 2e-5]
    assert [line for line, _ in found.issues] == [3, 7] and found.left_out == 1
    assert 'only the first sheet, "Sheet", is read, not "notes"' in found.issues[0][1]
    assert 'mass_3_kg is "x"' in found.issues[1][1]


def test_a_workbook_whose_table_is_on_another_sheet(sheet: Write) -> None:
    says = 'no column has.*; only the first sheet, "Sheet", is read, not "data"'
    with pytest.raises(InputError, match=says):
        read_measurements(sheet([["notes"], ["made in May"]], data=[["mass_1_kg", "tip_x_mm"]]))


@pytest.mark.parametrize("label", ["measured", "synthetic", "computed"])
def test_the_data_label_is_kept(label: str, file: Write) -> None:
    assert read_measurements(file(f"# source: {label}\n{GOOD}")).source == label
    lines = [line + ("," + ("source" if i == 0 else label)) for i, line in
             enumerate(GOOD.splitlines())]  # fmt: skip
    found = read_measurements(file("\n".join(lines)))
    assert found.source == label and found.select([0]).source == label
    # the file takes precedence over the mapping
    mapping = "source: measured\ntip: {columns: [tip_x_mm, tip_y_mm, tip_z_mm], unit: mm}\n"
    assert _mapped(file, mapping, f"# source: {label}\n{GOOD}").source == label


def test_labels_of_foreign_tables(file: Write) -> None:
    for column, comment, source in [
        ("synthetic", "", "synthetic"),
        ("battery", "", "measured"),
        ("", "# source: computed\n", "computed"),
        ("", "# source: the old arm\n", "measured"),
    ]:
        table = f"{comment}a,b,x,y,z,source\n1,2,3,4,5,{column}\n"
        assert _mapped(file, MAPPING, table).source == source


def test_measurements_made_in_python() -> None:
    rows = {
        "tensions": [[1, 0], [2, 0]],
        "displacements": [[0, 0]] * 2,
        "points": [[[0, 0, 1]]] * 2,
    }
    more = {"line": [1, 2], "group": ["a", "b"], "repeat": [1, 1]}
    found = Measurements(source="synthetic", name="made", **rows, **more)  # type: ignore[arg-type]
    assert found.tip.dtype == float and found.group.dtype.kind == "U" and len(found) == 2
    with pytest.raises(InputError, match=r"line has shape \(2,\)|tensions has shape \(2, 2\)"):
        Measurements(source="synthetic", name="made", **rows, **{**more, "line": [1]})  # type: ignore[arg-type]
    with pytest.raises(InputError, match='source is "guess", it must be measured, synthetic or'):
        Measurements(source="guess", name="made", **rows, **more)  # type: ignore[arg-type]


def test_written_and_read_again(file: Write, tmp_path: Path) -> None:
    found = read_measurements(ROOT / "examples" / "bench.csv")
    assert found.source == "synthetic"
    again = read_measurements(write_measurements(found, tmp_path / "again.csv"))
    for name in ("tensions", "points", "sigma"):
        np.testing.assert_allclose(getattr(again, name), getattr(found, name), rtol=1e-14)
    assert again.source == "synthetic" and again.name == "bench" and not again.issues
    assert again.group.tolist() == found.group.tolist()
    assert [p.name for p in tmp_path.iterdir()] == ["again.csv"]
    with pytest.raises(InputError, match=r"cannot write .*: No such file"):
        write_measurements(found, tmp_path / "nowhere" / "a.csv")


def test_select_and_split() -> None:
    found = read_measurements(ROOT / "examples" / "bench.csv")
    ways = found.split()
    assert list(ways) == ["loading", "unloading"]
    assert [len(way) for way in ways.values()] == [17, 16]
    some = found.select(found.tensions[:, 0] > 70)
    assert some.line.tolist() == [21, 22, 23] and some.points.shape == (3, 1, 3)
    assert some.sigma is not None and len(some.sigma) == 3


# -- a table that is wrong -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "the table is empty"),
        (" \n\n", "the table is empty"),
        ("# source: measured\n", "the table is empty, there are only comments"),
        (ROWS, "line 1: there are numbers where the names of the columns are expected"),
        (GOOD.replace(",", " "), "line 1: the header has blanks between its names"),
        (HEADER, "there is no row of numbers below the header, which is in line 1"),
        (GOOD.replace("mass_2_kg", "mass_4_kg"), "tendon 2 has no column, but there is mass_4_kg"),
        (GOOD.replace("tip_z_mm", "tip_w_mm"), "no column tip_z; did you mean tip_z_mm by"),
        (GOOD.replace("tip_", "top_"), 'did you mean tip_x_mm by "top_x_mm"?'),
        (GOOD.replace("mass_", "weight_"), 'did you mean mass_1_kg by "weight_1_kg"?'),
        (GOOD.replace("mass_", "m"), "no column has the command of a tendon"),
        (GOOD.replace("tip_x_mm", "tip_x"), "tip_x has no unit; write for example tip_x_mm"),
        (GOOD.replace("tip_x_mm", "tip_x_N"), "got tip_x_N, "),
        (GOOD.replace("tip_x_mm", "tip_x_parsnip"), "is not a known unit"),
        (GOOD.replace("tip_x_mm", "tip_x_m"), "mixed units: tip_x_m is in m and tip_y_mm in mm"),
        (GOOD.replace("mass_2_kg", "mass_2_g"), "mixed units: mass_1_kg is in kg and mass_2_g"),
        (
            GOOD.replace("mass_2_kg", "displacement_1_mm"),
            "mass_1_kg and displacement_1_mm both command tendon 1; give each tendon one of",
        ),
        (GOOD.replace("mass_2", "mass_01"), "mass_1_kg and mass_01_kg both command tendon 1"),
        (GOOD.replace("mass_2", "mass_1"), 'the column "mass_1_kg" is there twice'),
        (GOOD.replace("mass_1", "mass_0"), "tendons are numbered from 1"),
        ("# stations: 0.2 0.5 1\n" + GOOD, "has 3 numbers; there are 1 points"),
        ("# stations: much\n" + GOOD, "write a share of the length for each point"),
        ("# sigma: 3 N\n" + GOOD, "the comment '# sigma:' got"),
        ("# source: guessed\n" + GOOD, 'the source is "guessed"; it must be measured, synthetic'),
        (
            GOOD.replace("_mm\n", "_mm,source\n")
            .replace("641\n", "641,measured\n")
            .replace("640\n", "640,synthetic\n")
            .replace("637\n", "637,\n"),
            'line 3: the source is "synthetic", before it was "measured"',
        ),
        (f"{HEADER}\n0,0,0,1,1,nan\n0,0,-1,1,1,1\n", "line 2: left out: tip_z_mm is "),
        (f'{HEADER}\n0,0,0,1,1,"1\n', "the table cannot be read"),
        (
            "tension_1_N,tip_x_mm,tip_y_mm,tip_z_mm\n"
            + "".join(f"{-2.5 + 0.1 * i},10,0,641\n" for i in range(10)),
            "as zero in the mapping",
        ),
        (f"{HEADER}\n0,0,0,1,1,{131073 * '1'}\n", "line 2: the table cannot be read"),
        (131073 * "x" + "\n", "line 1: the table cannot be read"),
    ],
)
def test_errors_in_a_table(text: str, says: str, file: Write) -> None:
    path = file(text)
    with pytest.raises(InputError) as error:
        read_measurements(path)
    sentence, _, mapping = str(error.value).partition("\n\n")
    assert says in sentence and str(path) in sentence and "\n" not in sentence
    assert ("--mapping" in sentence) == bool(mapping)


def test_too_few_and_too_many_tendons(file: Write) -> None:
    path = file(GOOD)
    with pytest.raises(InputError, match="has 3 tendons, rao2021 has 6; give every tendon"):
        read_measurements(path, bs.load_robot("rao2021"))
    names = ",".join(f"displacement_{k}_mm" for k in (1, 2, 3, 4))
    path = file(f"{names},bend_deg,direction_deg\n1,1,1,1,1,1\n")
    with pytest.raises(InputError, match="has 4 tendons, amouri2019 has 3; leave out those"):
        read_measurements(path, bs.load_robot("amouri2019"))


def test_bad_rows_are_listed_and_nothing_else_is_lost(file: Write) -> None:
    rows = [
        "0,0,0,0,0,641",
        "x,0,0,0,0,641",
        "0,0,,0,0,641",
        "0,0,0,0,NaN,641",
        "0,0,0,0,inf,641",
        "-1,0,0,0,0,641",
        "0,0,0,0,641",
        "0,0,0,0,0,641,9",
        "0,0,0,5 mm,0,641",
        "1_0,0,0,0,0,641",
        "1e300,0,0,0,0,641",
        "",
        "1,0,0,60,0,637",
    ]
    found = read_measurements(file("\n".join([HEADER, *rows])))
    assert found.line.tolist() == [2, 14] and found.left_out == 10
    assert [line for line, _ in found.issues] == list(range(3, 13))
    texts = [text for _, text in found.issues]
    assert all(text.startswith("left out: ") for text in texts)
    for text, says in zip(
        texts,
        [
            'mass_1_kg is "x", which is not a finite number',
            "mass_3_kg is empty",
            'tip_y_mm is "NaN"',
            'tip_y_mm is "inf"',
            "mass_1_kg is -1; a tendon cannot push",
            "it has 5 cells, the header has 6",
            "it has 7 cells, the header has 6",
            'tip_x_mm is "5 mm"',
            'mass_1_kg is "1_0"',
            "mass_1_kg is 1e300, which is too large",
        ],
        strict=True,
    ):
        assert says in text


def test_rows_without_a_tip_are_kept_in_the_path(file: Write, shell: Shell) -> None:
    rows = ["0,0,0,0,0,641", "1,0,0,,,", "2,0,0,nan, NaN,", "3,0,0,,0,641", "1,0,0,60,0,637"]
    table = file("\n".join([HEADER, *rows]))
    found = read_measurements(table, bs.load_robot("amouri2019"))
    assert found.line.tolist() == [2, 3, 4, 6] and found.left_out == 1
    assert found.seen.tolist() == [True, False, False, True] and found.without_tip == 2
    kept = "no tip was measured: the row leads the path, and counts in no number"
    assert found.issues == ((3, kept), (4, kept), (5, "left out: tip_x_mm is empty"))
    got = shell.json("bench", "check", str(table), "--robot", "amouri2019")
    assert got["rows"] == 4 and got["rows_without_tip"] == 2 and got["rows_left_out"] == 1
    assert got["tip"] == {"smallest": [0, 0, 0.637], "largest": [0.06, 0, 0.641]}
    _, out, _ = shell("bench", "check", str(table))
    assert "4 rows, 2 without a tip, 1 left out" in out and "x 0.000 to 60.000" in out
    with pytest.raises(InputError, match="no row has a measured tip"):
        read_measurements(file("\n".join([HEADER, *rows[1:3]])))


LINES = GOOD.splitlines()


@pytest.mark.parametrize(
    ("text", "lines", "issue"),
    [
        (
            GOOD + '0.5,0,0,"30,5",0.1,640\n',
            [2, 3, 4],
            (
                5,
                'left out: tip_x_mm is "30,5", which is not a finite number; with decimal commas, '
                "separate the cells by semicolons",
            ),
        ),
        (
            GOOD + "0.5,0,0,30.5,0.1,640\n",
            [2, 3, 4, 5],
            (5, "the same, cell by cell, as line 3; it is kept"),
        ),
        (
            "\n".join(f"{row},{'1' if k else 'sgima_mm'}" for k, row in enumerate(LINES)),
            [2, 3, 4],
            (1, 'the column "sgima_mm" is not read; did you mean sigma_mm?'),
        ),
        (
            "\n".join(f"{'7' if k else ''},{row}" for k, row in enumerate(LINES)),
            [2, 3, 4],
            (1, "column 1 has no name and is not read"),
        ),
        (
            f'{HEADER},group\n0,0,0,0,0,641,"a\nb"\n\nx,0,0,0,0,641,c\n1,0,0,60,0,637,d\n',
            [2, 6],
            (5, 'left out: mass_1_kg is "x", which is not a finite number'),
        ),
    ],
    ids=["quoted commas", "a repeated row", "an unread column", "a nameless column", "line breaks"],
)
def test_doubts_are_reported(
    text: str, lines: list[int], issue: tuple[int, str], file: Write
) -> None:
    found = read_measurements(file(text))
    assert found.line.tolist() == lines and found.issues == (issue,)


def test_unreachable_tips_are_reported(robot: bs.Robot, file: Write) -> None:
    with (ROOT / "examples" / "bench.csv").open(encoding="utf-8") as table:
        text = "".join(line for line in table if not line.startswith("#"))
    assert read_measurements(file(text), robot).issues == ()
    in_metres = text
    for axis in "xyz":
        in_metres = in_metres.replace(f"tip_{axis}_mm", f"tip_{axis}_m")
    says = r"amouri2019 is 641 mm long; check the unit of the tip's columns"
    refused(says, lambda: read_measurements(file(in_metres), robot))
    assert len(read_measurements(file(in_metres))) == 33  # of an unnamed robot
    lines = text.splitlines()
    for k in (12, 20, 28):  # too many for spikes
        cells = lines[k].split(",")
        cells[lines[0].split(",").index("tip_x_mm")] = str(5000 + k)
        lines[k] = ",".join(cells)
    found = read_measurements(file("\n".join(lines)), robot)
    assert len(found) == 33 and found.left_out == 0 and found.seen.all()
    assert [line for line, _ in found.issues] == [13, 21, 29]
    assert all("from the middle of all" in text and "kept" in text for _, text in found.issues)


def test_a_sorted_table_is_reported(file: Write) -> None:
    header = "tension_1_N,tip_x_mm,tip_y_mm,tip_z_mm,repeat,time_s\n"
    rows = [f"{f},{f},0,640,{run},{10 * run + f}\n" for run in (1, 2) for f in (0, 1, 2)]
    assert read_measurements(file(header + "".join(rows))).issues == ()
    found = read_measurements(file(header + "".join(sorted(rows))))
    assert len(found) == 6 and found.left_out == 0
    assert found.issues == (
        (4, "repeat comes again (the first of 4 times): rows must stand in the order in which they "
            "were measured"),
        (4, "time goes back in time_s (the first of 2 times): rows must stand in the order in "
            "which they were measured"),
    )  # fmt: skip


def test_very_many_bad_rows_are_summed_up(file: Write) -> None:
    bad = "x,0,0,0,0,641\n" * 30_000
    found = read_measurements(file(GOOD + bad))
    assert found.left_out == 30_000 and len(found) == 3 and len(found.issues) == 1001
    assert found.issues[-1] == (30_004, "29000 more rows are left out up to here, not listed")


@pytest.mark.parametrize(
    ("content", "name", "says"),
    [
        ("mass_1_kg\nµ\n".encode("latin-1"), "a.csv", "line 2: the text is not in UTF-8"),
        (b"\x00\x01" * 50, "a.csv", "this is no text"),
        (b"\xd0\xcf\x11\xe0" + b"\0" * 600, "a.xls", "old Excel format"),
        (b"PK\x03\x04 not really", "a.xlsx", "the workbook cannot be unpacked"),
    ],
)  # fmt: skip
def test_files_that_are_not_tables(content: bytes, name: str, says: str, file: Write) -> None:
    path = file(content, name)
    refused(says, lambda: read_measurements(path))
    refused("this is a folder; name the file", lambda: read_measurements(path.parent))
    refused("cannot be read: No such file", lambda: read_measurements(path.parent / "none.csv"))


# -- large files and bombs -------------------------------------------------------------------------


@pytest.mark.slow
def test_a_million_rows(file: Write) -> None:
    rows = [f"{i % 977 / 10},{i % 89},{i % 359}\n" for i in range(1_000_000)]
    rows[777_777] = "1,?,3\n"
    path = file("displacement_1_mm,bend_deg,direction_deg\n" + "".join(rows))
    started = time.process_time()
    found = read_measurements(path)
    assert time.process_time() - started < 20  # 3 to 5 s
    assert len(found) == 999_999 and found.left_out == 1
    assert (777_779, 'left out: bend_deg is "?", which is not a finite number') in found.issues
    assert found.displacements[-1, 0] == pytest.approx(999_999 % 977 / 10 * 1e-3)


@pytest.mark.parametrize(
    ("limit", "value", "says"),
    [
        ("tables.MOST_ROWS", 2, "more than 2 rows, which is the most that is read; split"),
        ("measurements._MOST_COORDINATES", 8, "3 rows or more of 1 points are too many; up to 8"),
    ],
)
def test_more_than_memory_holds(
    limit: str, value: int, says: str, file: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"bowstring.data.{limit}", value)
    refused(says, lambda: read_measurements(file(GOOD)))


def _archive(path: Path, parts: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    return path


def _parts(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_a_workbook_without_the_extra(
    sheet: Callable[..., Path], monkeypatch: pytest.MonkeyPatch, shell: Shell, here: Path
) -> None:
    book = sheet([["tension_1_N", "tip_x_mm", "tip_y_mm", "tip_z_mm"], [1, 2, 3, 4]])
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    for command in (["study", "--measurements"], ["bench", "check"]):
        assert shell.error(*command, str(book)).removeprefix("--measurements: ") == (
            "Excel tables need openpyxl, which cannot be loaded; install it: "
            "pip install 'bowstring[excel]'"
        )
    assert list(here.iterdir()) == [book]


SHEET, BOOK = "xl/worksheets/sheet1.xml", {"xl/workbook.xml": b"<x/>"}
ENTITIES = b'<!DOCTYPE x [<!ENTITY a "aaaaaaaa">]><x>&a;</x>'
WIDE = (b'<?xml version="1.0" encoding="UTF-16"?>' + ENTITIES).decode().encode("utf-16")


def _noisy_cells(copies: int) -> bytes:
    """Cells with noise between them, which keeps the compression ratio low."""
    noise = np.random.default_rng(0).integers(97, 122, 300_000, dtype=np.uint8).tobytes()
    return copies * b"".join(b"<c/>" * 50 + noise[i : i + 10] for i in range(0, len(noise), 10))


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        (lambda: BOOK | {SHEET: b"<row></row>" * 5_000_000}, "would unpack to 55 MB in 2 parts, "),
        (lambda: BOOK | {SHEET: b"<row>" + _noisy_cells(1)}, "a row of more than 5 MB"),
        (lambda: BOOK | {"xl/sharedStrings.xml": _noisy_cells(10)}, "would unpack to 6. MB"),
        (lambda: {"xl/workbook.xml": ENTITIES}, "document type definition"),
        (lambda: {"xl/workbook.xml": WIDE}, "document type definition"),
        (lambda: {"hello.txt": b"hello"}, "no Excel workbook"),
    ],
)
def test_a_zip_bomb_is_not_opened(
    parts: Callable[[], dict[str, bytes]],
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bomb = _archive(tmp_path / "bomb.xlsx", parts())
    if "row of" not in says:
        monkeypatch.setattr(openpyxl, "load_workbook", pytest.fail)
    started = time.process_time()
    refused(says, lambda: read_measurements(bomb))
    assert time.process_time() - started < 5


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (b"<v>123456</v>", b"<v>" + b"a" * 9000 + b"</v>", "the sheet cannot be read: "),
        (
            b"</sheetData>",
            b'<row r="99999999"><c r="A99999999"><v>1</v></c></row></sheetData>',
            "the sheet has more than 1048576 rows",
        ),
    ],
)
def test_damaged_sheets(old: bytes, new: bytes, says: str, sheet: Write, tmp_path: Path) -> None:
    """Long messages of the library are shortened."""
    parts = _parts(sheet([HEADER.split(","), [0, 0, 0, 0, 0, 123456]]))
    parts[SHEET] = parts[SHEET].replace(old, new)
    with pytest.raises(InputError, match=says) as caught:
        read_measurements(_archive(tmp_path / "damaged.xlsx", parts))
    assert len(str(caught.value)) < 500


def test_a_sheet_that_claims_to_be_huge(sheet: Write, tmp_path: Path) -> None:
    """A cell far to the right makes each row as wide, if its address is trusted."""
    path = sheet([HEADER.split(","), *([i, 0, 0, 1, 1, 1] for i in range(50))])
    parts = _parts(path)
    content = parts[SHEET]
    content = content.replace(b'<dimension ref="A1:F51"', b'<dimension ref="A1:XFD1048576"')
    far = b'<row r="1048576"><c r="XFD1048576"><v>1</v></c></row></sheetData>'
    parts[SHEET] = content.replace(b"</sheetData>", far)
    assert parts[SHEET].count(b"1048576") == 3
    started = time.process_time()
    found = read_measurements(_archive(tmp_path / "huge.xlsx", parts))
    assert time.process_time() - started < 30
    assert len(found) == 50


@settings(max_examples=60, deadline=None)
@given(st.text(alphabet='0123456789.,;\t\n"#_-+eExyzmkgtipuls N', max_size=300))
def test_any_text_gives_data_or_a_sentence(text: str) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "t.csv")
        path.write_text(text)
        for content in (text, HEADER + "\n" + text):
            path.write_text(content)
            try:
                found = read_measurements(path)
            except InputError as error:
                sentence, _, mapping = str(error).partition("\n\n")
                assert "\n" not in sentence and ("--mapping" in sentence) == bool(mapping)
            else:
                assert np.isfinite(found.tip).all() and np.isfinite(found.tensions).all()


# -- foreign tables --------------------------------------------------------------------------------


def test_the_foreign_example_has_the_same_data(robot: bs.Robot) -> None:
    tidy = read_measurements(ROOT / "examples" / "bench.csv")
    foreign = read_measurements(
        ROOT / "examples" / "foreign.csv", robot, ROOT / "examples" / "foreign.yaml"
    )
    same = tidy.select(np.arange(len(tidy)) != 5)  # which is marked as invalid
    np.testing.assert_allclose(foreign.tensions, same.tensions, rtol=1e-14)
    np.testing.assert_allclose(foreign.tip, same.tip, atol=0.6e-6)  # three digits of mm in each
    assert foreign.source == "synthetic" and foreign.left_out == 1
    assert (8, "left out: valid is 0, not 1") in foreign.issues


MAPPING = """
source: measured
tendons: {quantity: displacement, unit: mm, positive: lengthened, columns: [b, a]}
tip: {columns: [x, y, z], unit: cm}
"""
TABLE = "a,b,x,y,z\n1,2,3,4,5\n6,7,8,9,10\n"


def _mapped(file: Write, mapping: str, table: str = TABLE) -> Measurements:
    return read_measurements(file(table), mapping=file(mapping, "mapping.yaml"))


def test_order_and_sign(file: Write) -> None:
    found = _mapped(file, MAPPING)
    np.testing.assert_allclose(found.displacements, [[-0.002, -0.001], [-0.007, -0.006]])
    np.testing.assert_allclose(found.tip[0], [0.03, 0.04, 0.05])


@pytest.mark.parametrize(
    ("frame", "tip"),
    [
        ("{axes: [y, z, x]}", [4, 5, 3]),
        ("{axes: [x, z, -y]}", [3, 5, -4]),
        ("{rotation: [[0, -1, 0], [1, 0, 0], [0, 0, 1]]}", [-4, 3, 5]),
        ("{axes: [y, x, z], handed: left}", [4, 3, 5]),
    ],
)
def test_frames(frame: str, tip: list[float], file: Write) -> None:
    np.testing.assert_allclose(
        _mapped(file, f"{MAPPING}frame: {frame}\n").tip[0], np.array(tip) / 100, rtol=1e-14
    )


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("", "frame: {axes: [y, x, z]}", "frame: axes: this frame is left-handed, it mirrors"),
        ("", "frame: {axes: [x, y, -z]}", "left-handed"),
        ("", "frame: {rotation: [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}", "left-handed"),
        ("", "frame: {axes: [x, y, z], handed: left}", "which leaves them left-handed"),
        ("", "frame: {axes: [x, x, z]}", "not three directions at right angles"),
        ("", "frame: {axes: [x, y, up]}", 'axes: got "up"; must be x, y or z'),
        ("", "frame: {rotation: [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}", "not three directions"),
        ("", "frame: {}", "give either axes, such as"),
        ("", "fraim: {axes: [x, y, z]}", "fraim: unknown field; did you mean frame?"),
        ("", "angles: {bend: b, direction: a, unit: mm}", "angles.unit: got"),
        ("", "points: {columns: [[x, y, z]], unit: mm}", "tip and points: write one of them"),
        ("", "keep: {column: q, value: 1}", 'no column "q", which the mapping names at keep'),
        ("", "group: a", 'the column "a" is used for tendons.columns[1] already'),
        ("", "stations: [0.5, 1]", "stations has 2 numbers; there are 1 points"),
        ("", "sigma: 3 N", "sigma: got"),
        ("", "tool: 8 mm", "tool: got 1 numbers; must have 3"),
        ("source: measured", "", "source: missing"),
        ("source: measured", "source: guessed", 'source: got "guessed"; must be'),
        ("[b, a]", "[b, b]", "tendons: columns: one is there twice"),
        ("[b, a]", "[]", "tendons.columns: got"),
        ("[b, a]", "[b, A]", 'no column "A", which the mapping names at tendons.columns[1]; did'),
        ("unit: mm, positive", "unit: kg, positive", 'tendons: unit: got "kg"'),
        ("quantity: displacement", "quantity: mass", "tendons: unit: got"),
        (
            "quantity: displacement, unit: mm",
            "quantity: mass, unit: kg",
            "lengthened is for displacements",
        ),
        ("quantity: displacement", "quantity: push", "tendons.quantity: got"),
        ("[x, y, z]", "[x, y]", "tip.columns"),
        ("tip: {", "tipp: {", "tipp: unknown field; did you mean tip?"),
        ("{columns: [x, y, z], unit: cm}", "x", "tip: got"),
        (MAPPING, "", "is empty; a mapping file has at least 'tip'"),
        (MAPPING, "just text", "must be fields such as 'tip: ...'"),
        (MAPPING, "source: measured", "nothing is measured; write tip, points, shape or angles"),
    ],
)
def test_errors_in_a_mapping(old: str, new: str, says: str, file: Write) -> None:
    text = MAPPING.replace(old, new) if old else f"{MAPPING}{new}\n"
    with pytest.raises(InputError) as error:
        _mapped(file, text)
    assert says in str(error.value).partition("\n")[0]


def test_non_finite_points_pass_through_a_frame(file: Write) -> None:
    found = _mapped(file, f"{MAPPING}frame: {{axes: [y, z, x]}}\n", TABLE + "1,2,inf,4,5\n")
    assert len(found) == 2 and found.left_out == 1


def test_repeats_are_whole_numbers(file: Write) -> None:
    rows = ["displacement_1_mm,bend_deg,repeat", "1,2,3", "1,2,1.5", "1,2,1e20", "1,2,"]
    found = read_measurements(file("\n".join(rows)))
    assert found.repeat.tolist() == [3] and found.left_out == 3


def test_no_mapping(tmp_path: Path) -> None:
    names = ["crl-ftdcr-mocap", "soromox-tentacle", "tamm-spring", "ucl-planar-shape"]
    assert mapping_names() == names
    refused(r"neither a file nor .* did you mean tamm-spring\?", lambda: load_mapping("tamm-sprig"))
    refused("is a folder", lambda: load_mapping(tmp_path))


def test_cells_that_every_row_would_pay_for_are_refused(file: Write) -> None:
    """An array takes the longest label, and the most points, for each row."""
    mapping = "source: measured\nshape: {column: s, unit: mm}\ngroup: g\n"
    place = file(mapping, "map.yaml")
    shape, long = "[[0, 0], [1, 1]]", str([[0, 0]] * 1_001)
    table = f'g,s\na,"{shape}"\n{"b" * 201},"{shape}"\nc,"{long}"\n'
    found = read_measurements(file(table, "t.csv"), mapping=place)
    assert found.line.tolist() == [2]
    assert [text for _, text in found.issues] == [
        "left out: its name of a group has 201 characters, up to 200 are read",
        "left out: s has 1001 points, up to 1000 are read",
    ]


def test_shapes_in_cells(file: Write) -> None:
    mapping = "source: measured\nshape: {column: s, unit: mm}\nstations: [0, 0.5, 1]\n"
    rows = ['"[[0,0],[1,2],[3,4]]"', '"[[0,0,1],[1,2,1],[3,4,1]]"', '"[[0,0],[1,2]]"', "oops",
            '"[[0,0],[1,2],[3,NaN]]"']  # fmt: skip
    found = _mapped(file, mapping, "\n".join(["s", *rows]))
    assert found.points.shape == (2, 3, 3) and found.tensions.shape == (2, 0)
    assert found.tip.tolist() == [[0.003, 0.004, 0], [0.003, 0.004, 0.001]]
    assert [line for line, _ in found.issues] == [4, 5, 6]
    assert "s has 2 points, other rows 3" in found.issues[0][1]


def test_the_page_has_a_mapping_that_is_valid() -> None:
    page = (ROOT / "docs" / "guide" / "foreign-tables.md").read_text("utf-8")
    blocks = [part.partition("```")[0] for part in page.split("```yaml\n")[1:]]
    assert blocks
    from bowstring.robot.safe_yaml import read_yaml

    for block in blocks:
        Mapping.model_validate(read_yaml(block, "page", "mapping", "tip"))


# -- public data -----------------------------------------------------------------------------------


def test_tamm_spring(public_data: Folder) -> None:
    """Constant curvature against 27 measured bends, as published and as derived."""
    public_data("tamm-spring")
    found = load("tamm-spring")
    assert found.source == "measured" and len(found) == 27 and not found.issues
    assert found.points.shape == (27, 0, 3) and list(found.split()) == [
        "single",
        "equal",
        "unequal",
    ]
    assert found.bend is not None
    routing = Routing(np.radians([30, 150, 270]), 0.0025)
    fitted = Arc.from_lengths(0.040 - found.displacements, routing)
    measured = np.degrees(found.bend)

    def rmse(predicted: np.ndarray) -> float:
        return math.sqrt(np.mean((np.degrees(predicted) - measured) ** 2))

    # The authors write sqrt(sum of squared differences / 6) / r. The constant curvature of three
    # tendons at 120 degrees has a third more in the square, sqrt(2 ... / 9) / r (Webster & Jones
    # 2010: kappa s = 2 sqrt(q) / 3 d), so theirs is sqrt(3) / 2 of it.
    p = found.displacements
    squares = (p - p[:, [1, 2, 0]]) ** 2
    published = np.sqrt(squares.sum(axis=1) / 6) / 0.0025
    np.testing.assert_allclose(published, math.sqrt(3) / 2 * fitted.theta, rtol=1e-9)
    assert rmse(published) == pytest.approx(18.41, abs=0.01)
    assert rmse(fitted.theta) == pytest.approx(30.13, abs=0.01)
    # one fitted gain absorbs the factor: the same error in both cases
    for theta, gain in ((published, 0.772), (fitted.theta, 0.669)):
        best = float(theta @ np.radians(measured) / (theta @ theta))
        assert best == pytest.approx(gain, abs=1e-3)
        assert rmse(best * theta) <= 5.153
    assert rmse(0.772 * published) == pytest.approx(5.15, abs=0.01)


@pytest.mark.parametrize(
    ("part", "rows"), [("train", 1620), ("val", 443), ("keypoints", 2063), ("tendon_pull", 134)]
)
def test_crl_ftdcr_mocap(part: str, rows: int, public_data: Folder) -> None:
    folder = public_data("crl-ftdcr-mocap")
    found = load("crl-ftdcr-mocap", part)
    robot = bs.load_robot("crl-ftdcr-v4")
    assert len(found) == rows and found.left_out == 0 and found.source == "measured"
    # by column, as in SOURCE.md, not by the numbers of the servos
    raw = np.loadtxt(folder / f"ftdcr_v4_{part}.csv", delimiter=",", skiprows=1,
                     usecols=range(2, 14))  # fmt: skip
    np.testing.assert_allclose(found.displacements, raw[:, :9] * 1e-3, rtol=1e-14)
    np.testing.assert_allclose(found.tip, raw[:, 9:] * 1e-3, rtol=1e-14)
    assert found.tool.tolist() == [0, 0, 0.008] and found.time is not None
    assert found.tendon_count == len(robot.tendons.angle_rad)


def test_ucl_planar_shape(public_data: Folder) -> None:
    folder = public_data("ucl-planar-shape")
    found = load("ucl-planar-shape")
    assert found.points.shape == (433, 20, 3) and found.scale is None
    assert found.source == "measured" and found.tensions.shape == (433, 0)
    first = json.loads((folder / "sample_data.csv").read_text().splitlines()[1].split('"')[1])
    np.testing.assert_array_equal(found.points[0][:, [0, 2]] * [1, -1], first)
    assert (found.points[..., 1] == 0).all() and (found.tip[:, 2] > 0).all()


def test_each_measured_set_has_a_mapping() -> None:
    with_tables = [name for name in datasets.available() if datasets.describe(name).parts]
    assert with_tables == mapping_names()


# -- the command -----------------------------------------------------------------------------------


def test_check_summarises_a_table(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    found = shell.json("bench", "check", "examples/bench.csv", "--robot", "amouri2019")
    assert found["source"] == "synthetic" and found["rows"] == 33 and found["rows_left_out"] == 0
    assert found["robot"] == "amouri2019" and found["groups"] == {"loading": 17, "unloading": 16}
    assert found["tendons"][0]["largest_N"] == pytest.approx(8 * STANDARD_GRAVITY)
    assert found["tendon_check"]["found"] == "as_stated" and found["issues"] == []
    assert found["provenance"]["settings"]["g_m_per_s2"] == STANDARD_GRAVITY
    moon = shell.json("bench", "check", "examples/bench.csv", "--gravity-on-masses", "162 cm/s^2")
    assert moon["tendons"][0]["largest_N"] == pytest.approx(8 * 1.62)
    assert moon["tendon_check"] is None and "robot" not in moon
    code, out, err = shell("bench", "check", "examples/bench.csv", "--robot", "amouri2019")
    assert code == 0 and not err and "bench: synthetic, 33 rows" in out


def test_check_lists_bad_rows(shell: Shell, file: Write) -> None:
    path = file(GOOD + "x,0,0,0,0,641\n" * 30)
    found = shell.json("bench", "check", str(path))
    assert found["rows"] == 3 and found["rows_left_out"] == 30 and len(found["issues"]) == 30
    assert found["issues"][0] == {
        "line": 5,
        "text": 'left out: mass_1_kg is "x", which is not a finite number',
    }
    code, out, err = shell("bench", "check", str(path))
    assert code == 0 and not err and "... and 10 more; --json has them all." in out


# -- many rows left out ---------------------------------------------------------------------------


def noisy(rows: int, below: int) -> str:
    """Table of which the first rows have a slack tendon that reads below zero."""
    head = "tension_1_N,tension_2_N,tension_3_N,tip_x_mm,tip_y_mm,tip_z_mm"
    cells = [
        f"{5 + k},{-0.03 if k < below else 0.03},0.01,{10 + k},0,{640 - 0.1 * k}"
        for k in range(rows)
    ]
    return "\n".join([head, *cells]) + "\n"


def test_more_than_a_twentieth_of_the_rows_left_out_is_the_first_line(
    file: Write, shell: Shell
) -> None:
    assert not read_measurements(file(noisy(40, 2))).doubt
    path = file(noisy(40, 3))
    doubt = read_measurements(path).doubt
    assert doubt.startswith(
        "3 of 40 rows are left out, all for a tension below zero (down to -0.03"
    )
    assert "The likely zero is 0.01 of tension_3_N: give" in doubt
    robot = ("--robot", "amouri2019")
    for flags in ((), robot):
        assert doubt in shell.json("bench", "check", str(path), *flags)["warnings"]
        code, out, _ = shell("bench", "check", str(path), *flags)
        assert code == 0 and out.startswith("Check the table. 3 of 40 rows are left out")
    fit = ("fit", "amouri2019", "--measurements", str(path), "--parameter", "base")
    code, out, _ = shell(*fit, "--model", "arc")
    assert code == 0 and out.startswith("Check the table. 3 of 40 rows are left out")
    assert doubt in shell.json(*fit, "--model", "arc")["warnings"]


def load_cells(zeros: Sequence[float], noise: float) -> str:
    """Table of three load cells, of which at least one has no load in each of 60 rows."""
    rng = np.random.default_rng(7)
    tensions = rng.uniform(0, 3, (60, 3))
    tensions[np.arange(60), rng.integers(0, 3, 60)] = 0
    tensions[0] = 0
    readings = tensions + zeros + noise * rng.normal(size=tensions.shape)
    rows = [",".join(f"{x:.4f}" for x in row) + f",{k},0,641" for k, row in enumerate(readings)]
    return "\n".join([HEADER.replace("mass", "tension").replace("kg", "N"), *rows]) + "\n"


def test_noise_about_zero_tension_is_zero_and_no_row_is_left_out(file: Write) -> None:
    found = read_measurements(file(load_cells([0, 0, 0], 0.03)))
    assert len(found) == 60 and found.tensions.min() == 0 and not found.doubt
    unloaded = (found.tensions == 0).sum(axis=0)
    assert (unloaded >= 15).all()  # the readings above zero as well: no bias
    [text] = [text for _, text in found.issues if text.startswith("tension_1_N")]
    assert re.fullmatch(
        rf"tension_1_N: {unloaded[0]} readings within 0\.0\d+ N of 0, \d+ of them below, "
        "are without load",
        text,
    )
    lines = load_cells([0, 0, 0], 0.03).splitlines()
    lines[9] = "1,-3,0,10,0,641"
    found = read_measurements(file("\n".join(lines)))
    assert len(found) == 59 and (10, "left out: tension_2_N is -3; a tendon cannot push, give zero "
                                 "or more") in found.issues  # fmt: skip


def test_spikes_and_saturated_sensors_are_named(file: Write, shell: Shell) -> None:
    lines = load_cells([0, 0, 0], 0.01).splitlines()
    at = [line.split(",") for line in lines]
    at[30][1], at[40][0], at[40][4] = "8388.607", "-40", "3e4"
    path = file("\n".join(map(",".join, at)))
    found = read_measurements(path)
    spikes = [issue for issue in found.issues if "spike" in issue[1]]
    assert spikes == [
        (31, "left out: tension_2_N is 8388.607, a spike"),
        (41, "left out: tension_1_N is -40, a spike"),
    ]
    says = (
        "In line 31 tension_2_N is 8388.607, a spike far from all other rows: the row is left out"
    )
    assert len(found) == 58 and found.left_out == 2
    assert says in found.doubt
    checked = shell.json("bench", "check", str(path), "--robot", "amouri2019")
    assert says in checked["warnings"][0] and "wind" not in " ".join(checked["warnings"])
    at = [line.split(",") for line in lines]
    for row in at[20:27]:
        row[2] = "3.1415"
    [fault] = read_measurements(file("\n".join(map(",".join, at)))).faults
    assert fault.startswith("From line 21 tension_3_N stays at 3.1415, an end of its range, in 7")
    for row in at[1:]:
        row[2] = "0.25"
    issues = read_measurements(file("\n".join(map(",".join, at)))).issues
    assert (2, "tension_3_N is 0.25 in all rows: was it measured?") in issues


@pytest.mark.parametrize("rotated", [False, True])
def test_a_spike_of_a_tip_leaves_out_its_point_alone(file: Write, rotated: bool) -> None:
    """Its command may be right, and is part of the path."""
    at = [line.split(",") for line in load_cells([0, 0, 0], 0).splitlines()]
    for row, tip in zip(at[1:], np.random.default_rng(1).normal(641, 5, (60, 3)), strict=True):
        row[3:] = [f"{x:.4f}" for x in tip]
    at[30][4] = "-3e4"
    text = "\n".join(map(",".join, at))
    about: dict[str, object] = {
        "source": "synthetic",
        "tendons": {"quantity": "tension", "unit": "N", "columns": at[0][:3]},
        "tip": {"unit": "mm", "columns": at[0][3:]},
        "frame": {"axes": ["z", "x", "y"]},
    }
    mapping = Mapping.model_validate(about) if rotated else None
    found = read_measurements(file(text), mapping=mapping)
    assert len(found) == 60 and np.flatnonzero(~found.seen).tolist() == [29]
    assert (31, "left out as a point: tip_y_mm is -30000, a spike") in found.issues
    assert (
        "In line 31 tip_y_mm is -30000, a spike far from all other rows: the point" in found.doubt
    )


@pytest.mark.parametrize("ratio", [4, 5, 10, 20])
@pytest.mark.parametrize("count", [6, 7, 8])
def test_the_last_load_of_a_geometric_series_is_no_spike(ratio: int, count: int) -> None:
    loads = 0.01 * float(ratio) ** np.arange(count)
    there_and_back = np.r_[0, loads, loads[-2::-1], 0]
    for readings in (loads, -loads, 641 - loads, np.r_[0, loads], there_and_back):
        assert not len(spikes(readings))
    assert spikes(np.r_[there_and_back, 1e4 * loads[-1]]).tolist() == [len(there_and_back)]


NOISE = np.random.default_rng(5).normal(0.0, 2e-3, (1000, 3))
HELD = np.interp(np.arange(1000), [0, 400, 600, 1000], [0, 10, 10, 0.01])
PEAK = np.interp(np.arange(1000), [0, 20, 500, 1000], [1.7, 1.7, 11.7, 1.71])
FALL = np.linspace(9.0, 0.1, 1000)
PULSE = np.where(abs(np.arange(1000) - 507) < 8, 5.0, 0.0)


@pytest.mark.parametrize(
    ("quantity", "first", "second", "bend"),
    [
        ("tension_{}_N", HELD, 0 * HELD, HELD),
        ("tension_{}_N", PEAK, FALL, FALL),  # a load cell that rests at 1.7 N
        ("displacement_{}_mm", PULSE + NOISE[:, 1], NOISE[:, 2] - PULSE, 3 * PULSE),
    ],
    ids=["ramp and hold", "rest", "pulse"],
)
def test_rests_and_pulses_are_no_faults_of_sensors(
    quantity: str, first: np.ndarray, second: np.ndarray, bend: np.ndarray, file: Write
) -> None:
    tips = np.column_stack([3 * bend, 0 * bend, 90 - bend]) + NOISE
    names = [quantity.format(1), quantity.format(2), "tip_x_mm", "tip_y_mm", "tip_z_mm"]
    rows = [",".join(f"{x:.4f}" for x in row) for row in np.column_stack([first, second, tips])]
    found = read_measurements(file("\n".join([",".join(names), *rows])))
    assert found.faults == () and len(found) == 1000


def test_the_likely_zero_of_load_cells_is_named(file: Write) -> None:
    found = read_measurements(file(load_cells([1.3, -0.4, 0.7], 0.005)))
    assert found.is_biased and [name for name, _ in found.likely_zeros] == [
        f"tension_{k}_N" for k in (1, 2, 3)
    ]
    np.testing.assert_allclose(
        [zero for _, zero in found.likely_zeros], [1.3, -0.4, 0.7], atol=0.03
    )
    assert "The likely zero is 1.3" in found.doubt and "'# zero: 1.3" in found.doubt


@pytest.mark.parametrize("pretension", [0.0, 3.0])
def test_tensions_with_turned_signs_are_no_zeros(file: Write, pretension: float) -> None:
    rng = np.random.default_rng(4)
    loads = np.maximum(rng.uniform(-20, 40, (80, 3)), 0.0) + pretension
    loads += rng.normal(0.0, 0.01, loads.shape)

    def rows(signs: Sequence[int]) -> str:
        lines = (f"{a:.4f},{b:.4f},{c:.4f},1,2,{k}" for k, (a, b, c) in enumerate(loads * signs))
        head = "tension_1_N,tension_2_N,tension_3_N,tip_x_mm,tip_y_mm,tip_z_mm"
        return "\n".join([head, *lines])

    with pytest.raises(InputError) as refused:
        read_measurements(file(rows([-1, -1, -1])))
    assert "tension_1_N, tension_2_N and tension_3_N read below zero" in str(refused.value)
    assert "{column: tension_1_N, sign: -1} and so on." in str(refused.value)
    assert "zero in the mapping" not in str(refused.value)
    if not pretension:  # some rows have that tendon without load
        found = read_measurements(file(rows([1, -1, 1])))
        assert found.negated == ("tension_2_N",) and "sign: -1}." in found.doubt
        assert read_measurements(file(rows([1, 1, 1]))).negated == ()


@pytest.mark.parametrize("zero", ["first", "rows 1-1", "1.3 -0.4 0.7"])
def test_zeros_in_a_comment(file: Write, zero: str) -> None:
    found = read_measurements(file(f"# zero: {zero}\n" + load_cells([1.3, -0.4, 0.7], 0)))
    same = read_measurements(file(load_cells([0, 0, 0], 0)))
    assert len(found) == 60
    np.testing.assert_allclose(found.tensions, same.tensions, atol=1e-9)


def test_a_spike_is_no_part_of_a_zero(file: Write) -> None:
    """Nor of its error, by which a fit weights it; 95 % of Student's intervals hold the truth."""
    lines = load_cells([0, 0, 0], 0).splitlines()
    rng, held = np.random.default_rng(2), 0
    for _ in range(40):
        zeros = 1.3 + 0.05 * rng.normal(size=8)
        zeros[rng.integers(8)] += rng.choice([4095, -3])
        rows = [f"{zero:.5f},0,0,0,0,641" for zero in zeros]
        found = read_measurements(
            file("\n".join(["# zero: rows 1-8", lines[0], *rows, *lines[9:]]))
        )
        said = next(text for _, text in found.issues if text.startswith("the zero of tension_1_N"))
        assert " without " in said
        error = float(said.rpartition(": ")[2]) - 1.3
        assert found.zero_error is not None
        held += abs(error) < 1.96 * found.zero_error[0]
    assert held >= 35


@pytest.mark.parametrize(
    ("zero", "says"),
    [
        ("last", "the comment '# zero:' got \"last\"; must be a number in the unit of the column"),
        ("rows 3-1", 'got "rows 3-1"'),
        ("1 2", "has 2 numbers; give one for all, or one for each of 3 tendons"),
        ("rows 1-61", "the zero of tension_1_N is its mean in rows 1 to 61, and the table has 60"),
        ("rows 2-4", "line 5: the zero of tension_2_N is its mean in rows 2 to 4, and here it is"),
    ],
)
def test_zeros_that_cannot_be_read(file: Write, zero: str, says: str) -> None:
    lines = load_cells([0, 0, 0], 0).splitlines()
    lines[3] = "0,NaN,0,1,0,641"
    with pytest.raises(InputError, match=re.escape(says)):
        read_measurements(file("\n".join([f"# zero: {zero}", *lines])))


def test_rows_left_out_for_other_reasons(file: Write) -> None:
    broken = noisy(40, 0).replace("10,0,640", "10,,640").replace("11,0,639", "11,?,639")
    broken = broken.replace("12,0,639", "12,x,639")
    assert read_measurements(file(broken)).doubt == (
        "3 of 40 rows are left out, the first in line 2: results are of the other rows alone."
    )


def test_rows_that_a_mapping_leaves_out_do_not_count(file: Write) -> None:
    lines = noisy(40, 1).splitlines()
    text = "\n".join(f"{line},{'ok' if k == 0 else k % 2}" for k, line in enumerate(lines)) + "\n"
    tendons = "{quantity: tension, unit: N, columns: [tension_1_N, tension_2_N, tension_3_N]}"
    mapping = f"source: synthetic\nkeep: {{column: ok, value: 1}}\ntendons: {tendons}\n"
    mapping += "tip: {unit: mm, columns: [tip_x_mm, tip_y_mm, tip_z_mm]}\n"
    found = _mapped(file, mapping, text)
    assert (found.left_out, found.filtered, found.below_zero) == (21, 20, 1) and not found.doubt
