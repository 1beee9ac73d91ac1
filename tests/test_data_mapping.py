"""Tables of other programs: mappings, headers, logs joined by time, Motive exports."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import bowstring as bs
from bowstring.data.clock import AmbiguousDateError, seconds_of
from bowstring.data.mapping import load_mapping
from bowstring.data.mapping_draft import draft
from bowstring.data.measurements import Measurements, read_measurements, write_measurements
from bowstring.data.tables import Table
from bowstring.errors import InputError
from objects import drafted, measured, refused, workbook
from shell import Shell

Read = Callable[..., Measurements]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Read a table by a mapping, both given as text; further files lie beside it."""

    def write(mapping: str, table: str, *robot: bs.Robot, **others: str) -> Measurements:
        (tmp_path / "map.yaml").write_text(mapping)
        (tmp_path / "table.csv").write_text(table)
        for name, text in others.items():
            (tmp_path / f"{name}.csv").write_text(text)
        return read_measurements(tmp_path / "table.csv", *robot, mapping=tmp_path / "map.yaml")

    return write


TIP = "tip: {columns: [x, y, z], unit: mm}\n"
TABLE = "F,G,x,y,z\n0,1,0,0,640\n5,2,3,4,600\n"


def _mapping(columns: str, tip: str = TIP, quantity: str = "tension", unit: str = "N") -> str:
    tendons = f"tendons: {{quantity: {quantity}, unit: {unit}, columns: {columns}}}\n"
    return f"source: measured\n{tendons}{tip}"


# -- columns -------------------------------------------------------------------------------------


@pytest.mark.parametrize("nothing", ["0", "null", "~", "0.0"])
def test_constants_in_place_of_columns(rao: bs.Robot, nothing: str, read: Read) -> None:
    found = read(_mapping(f"[{nothing}, {nothing}, 1.5, F, 0, {nothing}]"), TABLE, rao)
    assert found.tensions.tolist() == [[0, 0, 1.5, 0, 0, 0], [0, 0, 1.5, 5, 0, 0]]


def test_a_constant_coordinate_and_a_column_whose_name_is_a_number(read: Read) -> None:
    found = read(_mapping("[0, F]", "tip: {columns: [x, 1.5, z], unit: cm}\n"), TABLE)
    np.testing.assert_allclose(found.tip[1], [0.03, 0.015, 6])
    named = read(_mapping("['1', 2]"), TABLE.replace("F,G", "1,H"))
    assert named.tensions.tolist() == [[0, 2], [5, 2]]
    with pytest.raises(InputError, match="of each point at least one coordinate must be a column"):
        read(_mapping("[F]", "tip: {columns: [0, 0, null], unit: mm}\n"), TABLE)


def test_blank_cells_beside_a_constant_are_a_tip_that_was_not_measured(read: Read) -> None:
    tip = "tip: {columns: [x, 0, z], unit: mm}\n"
    found = read(_mapping("[F]", tip), TABLE + "6,0,,,\n")
    assert found.without_tip == 1 and len(found) == 3


def test_scale_and_sign_of_a_column(read: Read) -> None:
    columns = "[{column: F, unit: 0.1 mm}, {column: G, sign: -1}]"
    tip = "tip: {columns: [{column: x, unit: cm}, {column: y, sign: '-'}, z], unit: 0.5 mm}\n"
    found = read(_mapping(columns, tip, "displacement", "2 mm"), TABLE)
    np.testing.assert_allclose(found.displacements, [[0, -2e-3], [5e-4, -4e-3]])
    np.testing.assert_allclose(found.tip[1], [0.03, -2e-3, 0.3])
    negative = read(_mapping("[{column: F, sign: -1}]"), TABLE.replace("\n5,", "\n-5,"))
    assert negative.tensions.tolist() == [[0], [5]]
    refused = read(_mapping("[{column: F, sign: -1}]"), TABLE)
    assert refused.left_out == 1 and "a tendon cannot push" in refused.issues[0][1]


def test_the_zero_of_a_column_is_in_its_own_unit(read: Read) -> None:
    table = "m1,m2,l,x,y,z\n2048,1990,250,0,0,640\n2098,1890,249,1,0,640\n"
    own = "{column: l, unit: mm, sign: -1, zero: 250}"
    for zero, columns in (
        ("first", f"[m1, m2, {own}]"),
        ("2048", f"[m1, {{column: m2, zero: rows 1-1}}, {own}]"),
    ):
        text = _mapping(columns, TIP, "displacement", "0.02 mm")
        found = read(text.replace("columns: [m1", f"zero: {zero}, columns: [m1"), table)
        np.testing.assert_allclose(
            found.displacements, [[0, 0, 0], [1e-3, -2e-3, 1e-3]], atol=1e-12
        )
    tip = "tip: {columns: [{column: x, zero: first}, y, {column: z, zero: 600}], unit: mm}\n"
    found = read(_mapping("[m1, m2, 0]", tip), table)
    np.testing.assert_allclose(found.tip, [[0, 0, 0.04], [1e-3, 0, 0.04]])
    with pytest.raises(InputError, match="a constant has no zero"):
        read(_mapping("[m1, m2, {column: 0, zero: 1}]"), table)
    with pytest.raises(InputError, match="must be a number in the unit of the column, first"):
        read(_mapping("[m1, m2, {column: l, zero: second}]"), table)


def test_one_column_for_an_antagonistic_pair(read: Read) -> None:
    table = "d,x,y,z\n-3,0,0,640\n0,0,0,641\n4,0,0,640\n"
    pair = "[{column: d, part: positive}, {column: d, part: negative}]"
    found = read(_mapping(pair), table)
    assert found.tensions.tolist() == [[0, 3], [0, 0], [4, 0]] and found.left_out == 0
    both = read(_mapping("[d, {column: d, sign: -1}]", TIP, "displacement", "mm"), table)
    np.testing.assert_allclose(both.displacements, [[-3e-3, 3e-3], [0, 0], [4e-3, -4e-3]])


@pytest.mark.parametrize(
    ("columns", "unit", "says"),
    [
        ("[F, F]", "N", "one is there twice; each tendon has its own, or of one column for a pair"),
        ("[F, {column: F, part: all}]", "N", "one is there twice"),
        ("[{column: F, unit: mm}]", "N", 'columns[0].unit: got "mm"'),
        ("[F]", "0.1", "unit: got 0.1, which has no unit"),
        ("[F]", "-1 N", "which must be above zero; for the sign of a column write sign: -1"),
        ("[{column: F, sign: 2}]", "N", "tendons.columns[0].sign: got 2; must be"),
        ("[{column: F, parts: all}]", "N", "parts: unknown field; did you mean part?"),
        ("[[F]]", "N", "must be a column, a number or null"),
        ("[H]", "N", 'there is no column "H"'),
    ],
)
def test_errors_in_columns(columns: str, unit: str, says: str, read: Read) -> None:
    with pytest.raises(InputError) as error:
        read(_mapping(columns, unit=unit), TABLE)
    assert says in str(error.value).partition("\n")[0]


def test_a_left_handed_frame_says_which_axes_to_give(read: Read) -> None:
    with pytest.raises(InputError) as error:
        read(_mapping("[F]") + "frame: {handed: left}\n", TABLE)
    assert "give axes as well" in str(error.value)
    for axes in ("[x, z, y]", "[x, -y, z]", "[x, y, -z]"):
        assert axes in str(error.value)
        read(_mapping("[F]") + f"frame: {{handed: left, axes: {axes}}}\n", TABLE)


# -- where the table lies in its file --------------------------------------------------------------


def test_lines_to_skip_above_and_below_the_header(read: Read) -> None:
    above = "Rig 7, operator: A. B.\nrate,100,Hz\n\n"
    table = above + TABLE.replace("z\n", "z\nN,N,mm,mm,mm\n")
    found = read(_mapping("[F, G]") + "table: {skip: 3, skip_below: 1}\n", table)
    assert found.tensions.tolist() == [[0, 1], [5, 2]] and not found.issues
    assert found.line.tolist() == [6, 7]


@pytest.mark.parametrize(
    ("table", "form"),
    [
        ("0,1,0,0,640\n5,2,3,4,600\n", "{header: none}"),
        ("0,1,0,0,640\n5,2,3,4,600\n", "{header: none, names: [a, b, c, d, e]}"),
        ("0 1 0 0 640\n5  2 3 4 600 \n", "{header: none, separator: blanks}"),
        ("0;1;0;0;640,0\n5;2;3;4;600,0\n", "{header: none}"),
    ],
)
def test_tables_without_a_header(table: str, form: str, read: Read) -> None:
    named = "names" in form
    tip, first = ("[c, d, e]", "a") if named else ("[column_3, column_4, column_5]", "column_1")
    mapping = _mapping(f"[{first}]", f"tip: {{columns: {tip}, unit: mm}}\n") + f"table: {form}\n"
    found = read(mapping, table)
    assert found.tensions.tolist() == [[0], [5]]
    np.testing.assert_allclose(found.tip[1], [0.003, 0.004, 0.6])


def test_a_sheet_with_lines_to_skip(tmp_path: Path) -> None:
    rows = [["Rig 7"], ["F", "x", "y", "z"], ["N", "mm", "mm", "mm"], [5, 3, 4, 600]]
    mapping = tmp_path / "map.yaml"
    mapping.write_text(_mapping("[F, 0, null]") + "table: {skip: 1, skip_below: 1}\n")
    found = read_measurements(workbook(tmp_path / "a.xlsx", rows), mapping=mapping)
    assert found.tensions.tolist() == [[5, 0, 0]] and found.line.tolist() == [4]


def test_a_sheet_with_a_header_of_two_rows_gets_a_draft(tmp_path: Path) -> None:
    start, step = datetime.datetime(2024, 2, 29, 13), datetime.timedelta(seconds=0.25)
    rows = [
        ["Rig 7", "sampling rate", 4],
        ["Time", "Force", None, "Tip"],
        [None, "F1", "F2", "X", "Y", "Z"],
        ["-", "N", "N", "mm", "mm", "mm"],
        *([start + i * step, i, 0, 9 * i, 0.5, 600 - i] for i in range(7)),
        ["mean", 3, 0, 27, 0.5, 597],
    ]
    path, mapping = workbook(tmp_path / "a.xlsx", rows), tmp_path / "map.yaml"
    text = drafted(path, bs.load_robot("amouri2019"))
    assert "table: {skip: 1, skip_below: 1, header_rows: 2}" in text
    mapping.write_text(text.replace("rows: 2}", "rows: 2, last: 11}"))
    found = read_measurements(path, mapping=mapping)
    assert found.tensions[:, 0].tolist() == [0, 1, 2, 3, 4, 5, 6] and not found.left_out
    np.testing.assert_allclose(found.tip[3], [0.027, 0.0005, 0.597])
    assert found.time is not None and np.diff(found.time).tolist() == [0.25] * 6
    mapping.write_text(text.replace("rows: 2}", "rows: 2, block: b}"))
    says = "block is for text files; give skip and last"
    refused(says, lambda: read_measurements(path, mapping=mapping))


@pytest.mark.parametrize(
    ("form", "says"),
    [
        ("{skip: 9}", "no line below the 9 that are skipped"),
        ("{names: [a, b]}", "the mapping names 2 columns, here there are 5"),
        ("{skip: -1}", "table.skip: got -1"),
        ("{heder: none}", "did you mean header?"),
        ("{skip: 4, last: 3}", "last: got 3; must be a line below the 4 of skip"),
        ("{block: a, last: 3}", "block and last: write one of them"),
        ("{block: a}", 'no block "a"; it has none'),
    ],
)
def test_errors_in_a_form(form: str, says: str, read: Read) -> None:
    refused(says, lambda: read(_mapping("[F]") + f"table: {form}\n", TABLE))


TRIAL = (
    "Devices\n200\n,,Cell,\nFrame,Sub Frame,F1,F2\n,,N,N\n"
    + "".join(f"{i // 2},{i % 2},{i},0\n" for i in range(2, 10))
    + "\nTrajectories\n100\n,,mid,,,tip,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,,mm,mm,mm,mm,mm,mm\n"
    + "".join(f"{i},0,0,{i},300,{i},0,600\n" for i in range(1, 5))
)


@pytest.mark.parametrize("part", ["block: Devices, skip: 1", "last: 13, skip: 2"])
def test_a_block_of_a_file(part: str, read: Read) -> None:
    tip = "tip: {columns: [tip X, tip Y, tip Z], unit: mm}\n"
    block = "table: {block: Trajectories, skip: 1, header_rows: 2, skip_below: 1}\n"
    time = "time: {column: Frame, unit: 10 ms}\n"
    frames = "{column: Frame, unit: 10 ms, plus: {column: Sub Frame, unit: 5 ms}}"
    form = f"{{{part}, header_rows: 2, skip_below: 1}}"
    join = f"join: {{file: table.csv, time: {frames}, table: {form}}}"
    found = read(_mapping("[Cell F1, Cell F2]", tip) + block + time + join, TRIAL)
    assert found.tensions[:, 0].tolist() == [2, 4, 6, 8] and not found.left_out
    np.testing.assert_allclose(found.tip, [[i / 1e3, 0, 0.6] for i in range(1, 5)])
    assert found.line[0] == 20
    with pytest.raises(
        InputError, match='no block "Joints"; the file has "Devices", "Trajectories"'
    ):
        read(_mapping("[F]") + "table: {block: Joints}\n", TRIAL)


# -- rotations of the tip --------------------------------------------------------------------------

# 40 degrees towards 90 degrees from x, then turned about the tip's own axis by 50 degrees
TURNED = (
    Rotation.from_rotvec([-np.radians(40), 0, 0]) * Rotation.from_euler("z", 50, degrees=True)
).as_quat()
IMU = "F,ox,oy,oz,ow\n0,0,0,0,1\n5," + ",".join(f"{v:.9f}" for v in -0.99 * TURNED)


@pytest.mark.parametrize(
    "angles", ["quaternion: [ow, ox, oy, oz]", "quaternion: [ox, oy, oz, ow], order: xyzw"]
)
def test_quaternions_in_either_order(angles: str, read: Read) -> None:
    found = read(_mapping("[F]", f"angles: {{{angles}}}\n"), f"{IMU}\n6,1,1,0,0\n")
    assert found.bend is not None and found.direction is not None and not found.points.size
    np.testing.assert_allclose(np.degrees(found.bend), [0, 40], atol=1e-6)
    assert np.degrees(found.direction[1]) == pytest.approx(90, abs=1e-6)
    assert found.left_out == 1 and "has the length 1.41, not 1" in found.issues[0][1]


@pytest.mark.parametrize(
    ("angles", "says"),
    [
        ("unit: deg", "give either bend, a column, or quaternion"),
        ("bend: ox", "write for example unit: deg"),
        ("quaternion: [ow, ox, oy, oz], unit: deg", "no unit; leave both out"),
    ],
)
def test_errors_in_angles(angles: str, says: str, read: Read) -> None:
    refused(says, lambda: read(_mapping("[F]", f"angles: {{{angles}}}\n"), IMU))


def test_a_draft_knows_a_quaternion(tmp_path: Path) -> None:
    table = tmp_path / "imu.csv"
    table.write_text(IMU)
    assert 'quaternion: ["ow", "ox", "oy", "oz"]' in drafted(table)


# -- two tables, joined by time --------------------------------------------------------------------

FORCES = "ms,force\n1000,0\n1100,10\n1200,20\n1300,\n1400,40\n"
CAMERA = "t,x,y,z\n0.0,1,0,640\n0.05,2,0,640\n0.15,3,0,640\n0.3,4,0,640\n0.9,5,0,640\n"


def _joined(more: str = "", time: str = "{column: ms, unit: ms}") -> str:
    join = f"join: {{file: forces.csv, time: {time}, shift: -1 s{more}}}\n"
    return _mapping("[force, 0]") + join + "time: {column: t, unit: s}\n"


def test_a_log_joined_by_time(read: Read) -> None:
    found = read(_joined(), CAMERA, forces=FORCES)
    np.testing.assert_allclose(found.tensions[:, 0], [0, 5, 15], atol=1e-9)
    assert found.tip[:, 0].tolist() == [0.001, 0.002, 0.003]
    lines = dict(found.issues)
    assert "force is empty" in lines[5]  # the log has a gap there
    assert any("too far from the samples of forces.csv" in text for _, text in found.issues)


@pytest.mark.parametrize(
    ("more", "tensions"),
    [
        (", how: nearest", [0, 0, 10]),
        (", how: previous", [0, 0, 10]),
        (", within: 1 ms", [0]),
        (", how: previous, within: 60 ms", [0, 0, 10]),
    ],
)
def test_between_the_samples_of_a_log(more: str, tensions: list[float], read: Read) -> None:
    found = read(_joined(more), CAMERA, forces=FORCES)
    assert len(found) >= len(tensions)
    np.testing.assert_allclose(found.tensions[: len(tensions), 0], tensions, atol=1e-9)


def test_a_log_with_dates(read: Read) -> None:
    dates = [f"2026-05-01T10:00:0{s},force" for s in ("0.000", "1.000000", "2.5")]
    log = "when,force\n" + "".join(
        f"{date.partition(',')[0]},{f}\n" for date, f in zip(dates, (0, 10, 40), strict=True)
    )
    table = "t,x,y,z\n2026-05-01T10:00:00.5Z,1,0,640\n2026-05-01 12:00:02+02:00,2,0,640\n"
    join = "join: {file: forces.csv, time: {column: when, unit: iso}}\n"
    mapping = _mapping("[force]") + join + "time: {column: t, unit: iso}\n"
    found = read(mapping, table, forces=log)
    np.testing.assert_allclose(found.tensions[:, 0], [5, 30])
    assert found.time is not None and np.diff(found.time).tolist() == [1.5]
    assert np.isnan(seconds_of("yesterday")) and seconds_of("1970-01-01") == 0


def test_a_log_beside_decimal_commas_and_a_name_that_both_have(read: Read) -> None:
    table = CAMERA.replace(",", ";").replace(".", ",")
    log = FORCES.replace("ms,force", "t,force").replace("\n1", "\n1")
    join = "join: {file: forces.csv, time: {column: t, unit: ms}, shift: -1 s}\n"
    tip = "tip: {columns: [x, log.t, z], unit: mm}\n"
    mapping = _mapping("[force]", tip) + join + "time: {column: t, unit: s}\n"
    found = read(mapping, table, forces=log)
    np.testing.assert_allclose(found.tensions[:3, 0], [0, 5, 15], atol=1e-9)
    np.testing.assert_allclose(found.tip[:3, 1], [1.0, 1.05, 1.15])


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("shift: -1 s", "shift: 100 s", "no row lies within the times of forces.csv"),
        ("{column: ms, unit: ms}", "{column: x, unit: ms}", 'there is no column "x", which the'),
        ("{column: ms, unit: ms}", "{column: ms, unit: iso}", "no row has a time"),
        ("time: {column: t, unit: s}\n", "", "time: missing; tables are joined by time"),
        ("forces.csv", "nothing.csv", "the table cannot be read"),
        ("file: forces.csv", "file: forces.csv, how: guess", "join.how: got"),
    ],
)
def test_errors_in_a_join(old: str, new: str, says: str, read: Read) -> None:
    refused(says, lambda: read(_joined().replace(old, new), CAMERA, forces=FORCES))


def test_a_log_out_of_order(read: Read) -> None:
    with pytest.raises(InputError, match="line 4: ms goes back"):
        read(_joined(), CAMERA, forces="ms,force\n1000,0\n1100,1\n1050,2\n")
    two = FORCES + "\nCell B\nms,force\n1000,0\n"
    with pytest.raises(
        InputError, match=r"line 10: ms goes back.*; where another table.* last: 6 in"
    ):
        read(_joined(), CAMERA, forces=two)
    found = read(_joined(", table: {last: 6}"), CAMERA, forces=two)
    np.testing.assert_allclose(found.tensions[:, 0], [0, 5, 15], atol=1e-9)


def test_a_gap_in_a_log_is_reported(read: Read) -> None:
    log = "ms,force\n" + "".join(f"{1000 + i},1\n" for i in range(50)) + "1900,2\n"
    found = read(_joined(), CAMERA, forces=log)
    assert any("has no sample for up to 0.851 s" in text for _, text in found.issues)


# -- clocks ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cell", "order", "seconds"),
    [
        ("2.5 sec", "iso", 2.5),
        ("0,5 min", "iso", 30),
        ("3 hr", "iso", 10_800),
        ("00:01:02.50", "iso", 62.5),
        ("-0:00:02", "iso", -2),
        ("1 days 00:00:01.000250", "iso", 86_401.00025),
        ("01:02.5", "iso", 62.5),
        ("12:00:01 AM", "iso", 1),
        ("12:30:00 pm", "iso", 45_000),
        ("1-Jan-1970 00:00:03.250", "iso", 3.25),
        ("Jan 2, 1970 1:00 PM", "iso", 133_200),
        ("02.01.1970 00:00:01,5", "iso", 86_401.5),
        ("1970/01/02 00:00:01", "iso", 86_401),
        ("1970-01-01T01:00:02.1234567+01:00", "iso", 2.1234567),
        ("13/01/1970 00:00", "iso", 12 * 86_400),
        ("01/13/1970", "iso", 12 * 86_400),
        ("02/02/1970", "iso", 32 * 86_400),
        ("03/02/1970 0:00:01", "d/m/y", 33 * 86_400 + 1),
        ("03/02/1970 0:00:01", "m/d/y", 60 * 86_400 + 1),
    ],
)
def test_seconds_of_dates_clock_times_and_durations(cell: str, order: str, seconds: float) -> None:
    assert seconds_of(cell, order) == pytest.approx(seconds, abs=1e-9)


@pytest.mark.parametrize(
    "cell",
    ["", "x", "5", "12:30", "13:00:15:01.00", "13:00:01 PM", "0:75:00", "31-Feb-2024", "2 mm",
     "1-Foo-2024", "25:00 o'clock"],
)  # fmt: skip
def test_text_that_is_no_time(cell: str) -> None:
    assert np.isnan(seconds_of(cell))


def test_a_date_with_a_short_year_needs_its_order() -> None:
    for cell in ("24-02-29", "2/29/24"):
        with pytest.raises(AmbiguousDateError):
            seconds_of(cell)
    assert seconds_of("2/29/24", "m/d/y") == seconds_of("2024-02-29") == seconds_of("29.2.24")


@pytest.mark.parametrize("unit", ["s", "iso"])
def test_a_table_with_durations_in_words(unit: str, read: Read) -> None:
    rows = "".join(f"{0.25 * i:g} sec,{i},0,{i},640\n" for i in range(5))
    time = f"time: {{column: Time, unit: {unit}}}\n"
    found = read(_mapping("[F]") + time, "Time,F,x,y,z\n" + rows)
    assert found.time is not None and found.time.tolist() == [0, 0.25, 0.5, 0.75, 1]
    assert not found.issues


def test_the_order_of_day_and_month_is_asked_for(read: Read) -> None:
    table = "when,F,x,y,z\n03/04/2024 1:00:00 PM,1,0,0,640\n03/04/2024 1:00:02 PM,2,0,1,640\n"
    time = "time: {column: when, unit: %s}\n"
    with pytest.raises(InputError) as error:
        read(_mapping("[F]") + time % "iso", table)
    assert 'table.csv, line 2: when is "03/04/2024 1:00:00 PM"' in str(error.value)
    assert "unit: d/m/y where the day is first, or unit: m/d/y" in str(error.value)
    april, march = (read(_mapping("[F]") + time % u, table).time for u in ("d/m/y", "m/d/y"))
    assert april is not None and march is not None and (april - march == 30 * 86_400).all()
    join = "join: {file: log.csv, time: {column: when, unit: iso}}\n"
    with pytest.raises(InputError, match=r'log.csv, line 2: when is "03/04/2024'):
        read(_mapping("[G]") + time % "d/m/y" + join, table, log=table.replace("F", "G"))
    none = read(_mapping("[F]") + time % "m/d/y", table + "25/04/2024,3,0,2,640\n")
    assert 'when is "25/04/2024", which is no time in the order m/d/y' in none.issues[0][1]


def test_columns_of_time_that_are_added(read: Read) -> None:
    table = "sec,nanosec,F,x,y,z\n7,999999000,1,0,0,640\n8,1000,2,0,1,640\n"
    time = "time: {column: sec, unit: s, plus: {column: nanosec, unit: ns}}\n"
    found = read(_mapping("[F]") + time, table)
    np.testing.assert_allclose(found.time, [7.999999, 8.000001], atol=1e-9)
    log = "Date,Clock,G\n01.01.1970,00:00:07,5\n01.01.1970,00:00:09,7\n"
    clock = "{column: Date, unit: iso, plus: {column: Clock, unit: iso}}"
    join = f"join: {{file: log.csv, time: {clock}}}\n"
    found = read(_mapping("[F, G]") + time + join, table, log=log)
    np.testing.assert_allclose(found.tensions[:, 1], [5.999999, 6.000001])
    found = read(_mapping("[F]") + time, table + "9,,3,0,2,640\n")
    assert "sec is 9, and nanosec is added, which is no time" in found.issues[0][1]


# -- what was not measured, and other doubts -------------------------------------------------------


def test_values_that_say_that_nothing_was_measured(read: Read) -> None:
    table = "F,x,y,z,a,b,c\n1,0,0,640,0,0,300\n"
    for cell in ("-3.697314E+028", "-3.6973140000000001e+28", "", "NaN", "NULL", "n/a"):
        table += f"2,{cell},{cell},{cell},0,1,300\n3,1,2,640,{cell},{cell},{cell}\n"
    points = "points: {columns: [[a, b, c], [x, y, z]], unit: mm}\n"
    found = read(_mapping("[F]", points), table)
    assert (len(found), found.without_tip, found.left_out) == (13, 6, 0)
    assert np.isnan(found.points[2::2, 0]).all()
    found = read(_mapping("[F]"), "F,x,y,z\n-3.697314E+028,0,0,640\n1,0,0,-3.697314E+28\n2,0,0,6\n")
    assert found.line.tolist() == [4]  # a command, and one coordinate
    assert "F is -3.697314E+028, which says that nothing was measured" in found.issues[0][1]
    log = "t,G\n0,1\n1,-3.697314E+028\n2,3\n"
    join = "time: {column: F, unit: s}\njoin: {file: log.csv, time: {column: t, unit: s}}\n"
    found = read(
        _mapping("[G]") + join, "F,x,y,z\n0.0,0,0,640\n1.2,0,0,640\n2.0,0,0,640\n", log=log
    )
    assert found.tensions[:, 0].tolist() == [1, 3]


def test_a_marker_with_another_name_after_a_gap(read: Read) -> None:
    table = "F,aX,aY,aZ,bX,bY,bZ\n1,1,2,3,,,\n2,,,,4,5,6\n3,,,,,,\n"
    tip = "tip: {columns: [[aX, bX], {column: aY, instead: [bY], sign: -1}, [aZ, bZ]], unit: mm}\n"
    found = read(_mapping("[F]", tip), table)
    np.testing.assert_allclose(found.tip[:2], [[1e-3, -2e-3, 3e-3], [4e-3, -5e-3, 6e-3]])
    assert found.without_tip == 1
    both = read(_mapping("[F]", tip), table + "4,1,2,3,7,8,9\n")
    assert (5, "one row has values in aX and in a column that is read instead; aX is read") in (
        both.issues
    )
    refused('no column "cX"', lambda: read(_mapping("[F]", tip.replace("bX", "cX")), table))
    with pytest.raises(InputError, match="must be a column, a number or null"):
        read(_mapping("[[F, aX]]", tip), table)


def test_times_that_come_again_are_reported(read: Read) -> None:
    table = "t,F,x,y,z\n0,0,0,0,640\n1,1,1,0,640\n1,2,2,0,640\n0.5,3,3,0,640\n"
    found = read(_mapping("[F]") + "time: {column: t, unit: s}\n", table)
    assert found.issues == (
        (4, "t is the same as in the row before: both are kept"),
        (5, "time goes back in t: rows must stand in the order in which they were measured"),
    )
    found = read(_joined(), CAMERA, forces=FORCES.replace("1100", "1000"))
    says = "ms of forces.csv is the same in its lines 2 and 3; of samples at one time the last is"
    assert any(text.startswith(says) for _, text in found.issues)


def test_decimal_commas_and_points_in_one_log(read: Read) -> None:
    log = FORCES.replace(",", ";").replace("1100;10", "1100;10,5").replace("1200;20", "1200;20.5")
    with pytest.raises(InputError, match=r"force has a decimal comma in line 3 and a decimal poi"):
        read(_joined(), CAMERA, forces=log)


# -- exports of Motive -----------------------------------------------------------------------------

MOTIVE = """\
Format Version,1.23,Take Name,Take 7,Capture Frame Rate,120.000000,Export Frame Rate,120.000000,\
Total Frames in Take,4,Total Exported Frames,4,Rotation Type,Quaternion,Length Units,Meters,\
Coordinate Space,Global

,Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,\
Rigid Body Marker,Rigid Body Marker,Rigid Body Marker,Marker,Marker,Marker
,Name,tip,tip,tip,tip,tip,tip,tip,tip,tip:Marker1,tip:Marker1,tip:Marker1,tip:Marker1,\
tip:Marker1,tip:Marker1
,ID,"1","1","1","1","1","1","1","1","2","2","2","3","3","3"
,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error,Position,\
Position,Position,Position,Position,Position
Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,X,Y,Z,X,Y,Z
0,0.000000,0,0,0,1,0.1,0.64,0.0,0.0002,0.1,0.65,0.0,0.1,0.65,0.0
1,0.100000,0,0,0,1,0.2,0.63,0.0,0.0002,0.2,0.64,0.0,,,
2,0.200000,,,,,,,,,,,,,,
3,0.300000,0,0,0,1,0.3,0.60,0.1,0.0002,0.3,0.61,0.1,0.3,0.61,0.1
"""
PLUMB = "frame: {axes: [z, x, y]}\n"


def test_a_motive_export_is_read_as_it_is(read: Read) -> None:
    found = read("source: measured\ntip: {name: tip}\n" + PLUMB, MOTIVE)
    assert found.name == "Take 7" and found.line.tolist() == [8, 9, 10, 11]
    np.testing.assert_allclose(found.tip[[0, 3]], [[0, 0.1, 0.64], [0.1, 0.3, 0.6]])
    assert found.without_tip == 1 and found.time is not None
    np.testing.assert_allclose(found.time, [0, 0.1, 0.2, 0.3])


def test_other_versions_and_units_of_motive(read: Read) -> None:
    text = MOTIVE.replace("1.23", "1.25").replace("Meters", "Millimeters")
    text = text.replace(',ID,"1"', ",Parent,,,,,,,,,,,,,,\n,ID,1")
    found = read("source: measured\ntip: {name: 'tip:Marker1'}\n", "\ufeff" + text)
    np.testing.assert_allclose(found.tip[0], [1e-4, 6.5e-4, 0])
    columns = "tip: {columns: [tip Position X, tip Position Y, tip Position Z]}\n"
    assert read("source: measured\n" + columns, text).without_tip == 1
    second = "tip:Marker1 Position {} (Marker)"
    names = ", ".join(f"'{second.format(axis)}'" for axis in "XYZ")
    markers = read(f"source: measured\ntip: {{columns: [{names}]}}\n", text)
    assert markers.without_tip == 2


def test_a_body_that_changes_its_name(read: Read) -> None:
    text = MOTIVE.replace("3,0.300000,0,0,0,1,0.3,0.60,0.1", "3,0.300000,0,0,0,1,,,")
    mapping = "source: measured\ntip: {name: [tip, 'tip:Marker1']}\n"
    found = read(mapping, text)
    np.testing.assert_allclose(found.tip[[0, 3]], [[0.1, 0.64, 0], [0.3, 0.61, 0.1]])
    refused('no rigid body or marker "tipp"', lambda: read(mapping.replace("[tip", "[tipp"), text))


def test_a_motive_export_with_a_force_log(read: Read) -> None:
    join = "join: {file: forces.csv, time: {column: ms, unit: ms}, shift: -1 s}\n"
    mapping = _mapping("[force, 0, 0]", "tip: {name: tip}\n") + PLUMB + join
    found = read(mapping, MOTIVE, bs.load_robot("amouri2019"), forces=FORCES)
    np.testing.assert_allclose(found.tensions[:3, 0], [0, 10, 20], atol=1e-9)
    # the other order: a row for each sample of the log
    back = "join: {file: take.csv}\ntime: {column: s, unit: s}\n"
    mapping = _mapping("[force, 0, 0]", "tip: {name: tip}\n") + PLUMB + back
    found = read(mapping, "s,force\n0.05,1\n0.15,2\n0.31,3\n", take=MOTIVE)
    assert found.tensions[:, 0].tolist() == [1, 2, 3]
    np.testing.assert_allclose(found.tip[0], [0, 0.15, 0.635])
    assert found.seen.tolist() == [True, False, True]  # no interpolation at a gap


@pytest.mark.parametrize(
    ("mapping", "old", "new", "says"),
    [
        ("tip: {name: tipp}\n", "", "", 'no rigid body or marker "tipp"'),
        ("tip: {name: tip, unit: mm}\n", "", "", 'tip.unit: got "mm"; '),
        ("tip: {name: tip}\n", "Meters", "Furlongs", 'lengths in "Furlongs"'),
        ("tip: {name: tip}\n", "Frame,Time", "Bild,Zeit", "the line that begins with Frame"),
        ("tip: {name: tip}\n", "Position", "Velocity", "has no position of a rigid body"),
        ("tip: {}\n", "", "", "give either columns, those of x, y and z, or name"),
        ("tip: {name: tip, unit: mm}\n", MOTIVE, TABLE, "it is no Motive export, give columns"),
        ("tip: {columns: [x, y, z]}\n", MOTIVE, TABLE, "write for example unit: mm"),
    ],
)
def test_errors_in_an_export(mapping: str, old: str, new: str, says: str, read: Read) -> None:
    text = MOTIVE.replace(old, new) if old else MOTIVE
    refused(says, lambda: read("source: measured\n" + mapping, text))


# -- a mapping to start from -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("table", "tensions", "tip"),
    [
        (
            "Time [ms],Force [N],Tip X [cm],Tip Y [cm],Tip Z [cm],q\n0,5,1,2,3,1\n",
            [5, 0, 0],
            [0.01, 0.02, 0.03],
        ),
        ("load_g,x,y,z\n100,1,2,630\n0,180,2,600\n", [0.980665, 0, 0], [1e-3, 2e-3, 0.63]),
        ("force_2_N X Y Z\n3 0.1 0 0.63\n7 0.4 0 0.5\n", [0, 3, 0], [0.1, 0, 0.63]),
    ],
)
def test_an_unknown_table_gets_a_mapping_to_start_from(
    table: str, tensions: list[float], tip: list[float], shell: Shell, tmp_path: Path
) -> None:
    path = tmp_path / "bench.csv"
    path.write_text(table)
    code, out, err = shell("bench", "check", str(path), "--robot", "amouri2019")
    assert (code, out) == (2, "")
    sentence, _, mapping = err.partition("\n\n")
    assert "save these lines as map.yaml, check them, and give --mapping map.yaml" in sentence
    assert "\n" not in sentence and "?;" not in sentence
    (tmp_path / "map.yaml").write_text(mapping)
    found = read_measurements(path, bs.load_robot("amouri2019"), tmp_path / "map.yaml")
    np.testing.assert_allclose(found.tensions[0], tensions)
    np.testing.assert_allclose(found.tip[0], tip)


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ("1,2,3,4,5\n7,8,9,4,5\n", ["the tip: no three columns", "the commands of the tendons"]),
        ("F1,F2,F3,x,y,z\n1,2,3,4,5,6\n", ["the tip: ", 'the unit of "F1"']),
        ("F1 [N],x,y,z\n1,2,3,4\n3,2,13,9\n", ["the unit of the tip"]),
        ("pull_1_mm,pull_2_mm,pull_3_mm,pull_4_mm,x_m,y_m,z_m\n" + 2 * "1,2,3,4,5,6,7\n",
         ["the tip: no three columns", 'which of "pull_1_mm"']),
        ("F1 [N],a_x_mm,a_y_mm,a_z_mm,b_x_mm,b_y_mm,b_z_mm\n1,2,3,4,5,6,7\n2,3,4,5,6,7,8\n",
         ["which point is the tip"]),
        ("t,F1 [N],x_m,y_m,z_m\n0,1,2,3,4\n10,2,2,2,3\n", ['the unit of "t"']),
        ("stamp,F1 [N],x_m,y_m,z_m\n5,1,2,3,4\n5,2,2,2,3\n", ['the time: "stamp" does not']),
    ],
)  # fmt: skip
def test_a_draft_says_what_it_cannot_decide(table: str, says: list[str], tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(table)
    lines = drafted(tmp_path / "a.csv", bs.load_robot("amouri2019")).splitlines()
    said = [line.removeprefix("# not decided: ") for line in lines if "# not decided" in line]
    assert [text[: len(begin)] for text, begin in zip(said, says, strict=True)] == says


def test_columns_of_a_quaternion_are_no_tip(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    four = rng.normal(size=(9, 4))
    rows = np.hstack([four / np.linalg.norm(four, axis=1)[:, None], rng.uniform(-0.3, 0.3, (9, 3))])
    text = "F [N],x,y,z,w,px,py,pz\n"
    text += "".join(f"{i}," + ",".join(map(str, row)) + "\n" for i, row in enumerate(rows))
    (tmp_path / "a.csv").write_text(text)
    text = drafted(tmp_path / "a.csv", bs.load_robot("amouri2019"))
    assert 'tip: {columns: ["px", "py", "pz"], unit: m}' in text and "other columns" not in text


def test_a_motive_export_without_a_mapping_gets_one(shell: Shell, tmp_path: Path) -> None:
    (tmp_path / "take.csv").write_text(MOTIVE)
    (tmp_path / "forces.csv").write_text(
        "time,tension_1,tension_2,tension_3\n-1,0,0,0\n0.15,9,0,0\n1,0,0,0\n"
    )
    _, _, err = shell("bench", "check", str(tmp_path / "take.csv"), "--robot", "amouri2019")
    mapping = err.partition("\n\n")[2]
    assert '# of "tip"' in mapping
    (tmp_path / "map.yaml").write_text(mapping)
    found = read_measurements(
        tmp_path / "take.csv", bs.load_robot("amouri2019"), tmp_path / "map.yaml"
    )
    assert len(found) == 4 and found.tensions.max() > 7


@settings(max_examples=150, deadline=None)
@given(
    st.lists(st.text(max_size=12).map(str.strip), min_size=1, max_size=8, unique=True),
    st.lists(st.lists(st.sampled_from(["", "1", "2.5", "-1e9", "x", "0:01", "3/4/2024"]))),
    st.booleans(),
)
def test_any_table_gives_a_mapping_that_is_valid_or_says_why_not(
    header: list[str], rows: list[list[str]], has_robot: bool
) -> None:
    import tempfile

    table = Table(Path("t.csv"), "", header, 1, {}, ",", rows=iter(enumerate(rows)))
    text = draft([table], bs.load_robot("amouri2019") if has_robot else None)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "map.yaml")
        path.write_text(text, "utf-8")
        if "not decided" not in text:
            load_mapping(path)


@pytest.mark.parametrize(
    ("name", "columns"),
    [("tamm-spring", ["l1_mm", "l2_mm", "l3_mm"]), ("crl-ftdcr-mocap", ["servo_4_mm"])],
)
def test_drafts_for_public_tables(
    name: str, columns: list[str], public_data: Callable[[str], Path], tmp_path: Path
) -> None:
    folder = public_data(name)
    path = next(iter(sorted(folder.glob("*.csv"))))
    (tmp_path / "map.yaml").write_text(drafted(path))
    mapping = load_mapping(tmp_path / "map.yaml")
    assert mapping.tendons is not None and mapping.tendons.quantity == "displacement"
    assert [c.column for c in mapping.tendons.columns][: len(columns)] == columns
    found = read_measurements(path, mapping=mapping)
    whole = read_measurements(path, mapping=name)
    np.testing.assert_array_equal(found.displacements, whole.displacements)
    np.testing.assert_array_equal(found.points, whole.points)


# -- several recordings ----------------------------------------------------------------------------


def _recordings(robot: bs.Robot) -> Measurements:
    """Two recordings of a robot with friction, each from home: loading, unloading."""
    loads = np.outer([20, 40, 21, 20, 19.5], [1.0, 0, 0])
    tips = bs.sweep(robot, loads).tip_position
    return measured(
        np.vstack([tips, tips]),
        tensions=np.vstack([loads, loads]),
        group=np.repeat(["a", "b"], len(loads)),
        recording=np.repeat([1, 2], len(loads)),
    )


def test_each_recording_is_a_path_of_its_own(tmp_path: Path) -> None:
    from bowstring.calibration.fitting import fit
    from bowstring.study.calibration import predicted

    robot = bs.load_robot("amouri2019").with_({"segments.0.tendons.friction": 0.2})
    data = _recordings(robot)
    one_path = predicted(robot, data.select(slice(None)), "cosserat").tip_position
    np.testing.assert_allclose(one_path, data.tip, atol=1e-12)
    assert not np.allclose(bs.sweep(robot, data.tensions).tip_position, data.tip, atol=1e-4)
    noise = np.random.default_rng(1).normal(scale=1e-5, size=data.points.shape)
    noisy = replace(data, points=data.points + noise)
    found = fit(robot, noisy, ["segments.0.backbone.E"])
    assert (
        found.score.rmse
        < 4e-5
        < 4e-4
        < fit(robot, replace(noisy, recording=None), ["segments.0.backbone.E"]).score.rmse
    )
    assert found["segments.0.backbone.E"].value == pytest.approx(35, rel=1e-3)
    again = read_measurements(write_measurements(data, tmp_path / "a.csv"))
    assert again.recording is not None and again.recording.tolist() == [1] * 5 + [2] * 5
    assert not [text for _, text in again.issues if "comes again" in text]


def test_recordings_are_counted(shell: Shell, tmp_path: Path) -> None:
    table = "tension_1_N,tip_x_mm,tip_y_mm,tip_z_mm,recording\n1,2,3,4,a\n1,2,3,5,b\n"
    (tmp_path / "a.csv").write_text(table)
    assert shell.json("bench", "check", str(tmp_path / "a.csv"))["recordings"] == 2
    _, out, _ = shell("bench", "check", str(tmp_path / "a.csv"))
    assert "recordings: 2, each a path of its own" in out


@pytest.mark.parametrize(
    ("header", "comment"),
    [("recording", ""), ("group", "# recording: group\n")],
)
def test_recordings_in_a_table(header: str, comment: str, tmp_path: Path, read: Read) -> None:
    table = comment + f"tension_1_N,tip_x_mm,tip_y_mm,tip_z_mm,time_s,{header}\n"
    table += "".join(f"{f},{f},0,640,{f},{name}\n" for name in "ab" for f in (0, 1, 2))
    (tmp_path / "a.csv").write_text(table)
    found = read_measurements(tmp_path / "a.csv")
    assert found.recording is not None and found.recording.tolist() == [1, 1, 1, 2, 2, 2]
    assert list(found.split()) == ["a", "b"] and not found.issues  # time may start again
    mapping = _mapping(
        "[tension_1_N]", "tip: {columns: [tip_x_mm, tip_y_mm, tip_z_mm], unit: mm}\n"
    )
    mapping += f"group: {header}\nrecording: {header}\n"
    assert read(mapping, table).recording is not None


def test_a_comment_without_a_column(tmp_path: Path) -> None:
    table = "# recording: run\ntension_1_N,tip_x_mm,tip_y_mm,tip_z_mm\n1,2,3,4\n"
    (tmp_path / "a.csv").write_text(table)
    with pytest.raises(InputError, match=r"'# recording:' is \"run\"; must be group or repeat"):
        read_measurements(tmp_path / "a.csv")
