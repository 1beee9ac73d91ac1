"""What the report draws and writes of a robot's geometry: figures 2 to 4, equations, Table 1."""

from __future__ import annotations

import copy
import itertools
import math
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bowstring.formatting import in_mm
from bowstring.robot.reader import load_robot, robot_names
from bowstring.study import report
from bowstring.study.counterparts import counterparts
from bowstring.study.equations import study_equations
from bowstring.study.figures import _DRAWINGS
from bowstring.study.first_segment import first_segment
from bowstring.study.parameters import DEFAULT, DERIVED, GIVEN, assumed, parameters
from bowstring.study.study import Study
from bowstring.viz.style import LIGHT, figure_style
from stages import Stages

TWO_TUBES = Path(__file__).parent / "two_tubes.yaml"
ROBOTS: dict[str, dict[str, Any]] = {
    **{name: {} for name in robot_names()},
    str(TWO_TUBES): {},  # two tendons in its first segment, unequal pitch radii, clamps
    "four tendons": {"segments.0.tendons.count": 4},
    "eight tendons": {"segments.0.tendons.count": 8},
    "two clamped disks": {
        "segments.0.disks.positions": "500 641 mm",
        "segments.0.disks.clamped_length": "20 mm",
        "segments.0.disks.hole_diameter": "2 mm",
    },
    "turned": {"segments.0.tendons.first_angle": "200 deg", "gravity": "0 0 -9.81 m/s^2"},
}


@cache
def stages(name: str) -> Stages:
    """A robot of `ROBOTS` with a sweep of few loads."""
    known = name in robot_names() or name.endswith(".yaml")
    return Stages(load_robot(name if known else "amouri2019", ROBOTS[name]), points=3)


def studied(name: str, paper: Study) -> Study:
    return stages(name).over(paper)


# -- equations ---------------------------------------------------------------------------------


def evaluated(line: str) -> list[float | None]:
    """Both sides of an equation in MathML, computed; None for a side with symbols."""
    (row,) = ElementTree.fromstring(line)
    groups = itertools.groupby(row, lambda e: e.tag == "mo" and e.text in ("=", "\u2248"))
    sides = ["".join(map(python_of, parts)) for sign, parts in groups if not sign]
    names = {"sqrt": math.sqrt, "cos": math.cos, "sin": math.sin, "atan2": math.atan2}
    names |= {"arcsin": math.asin}
    out: list[float | None] = []
    for side in sides:
        text = side.replace(")(", ")*(")
        try:
            out.append(float(eval(text, {"__builtins__": {}}, names)))
        except NameError:
            out.append(None)
    return out


def python_of(element: ElementTree.Element) -> str:
    """MathML as Python; numbers and parts have parentheses, side by side they multiply."""
    parts = [python_of(child) for child in element]
    text = (element.text or "").strip()
    match element.tag:
        case "mspace" | "mtext":
            return ""
        case "mn":
            number = text.replace("\u2212", "-")
            value = math.radians(float(number[:-1])) if number.endswith("°") else float(number)
            return f"({value!r})"
        case "mi":
            known = ("cos", "sin", "atan2", "arcsin")
            return text if text in known else "(symbol)"
        case "mo":
            return {"\u2212": "-", "\u22c5": "*", "\u2061": ""}.get(text, text)
        case "mfrac":
            return f"(({parts[0]})/({parts[1]}))"
        case "msqrt":
            return f"(sqrt({''.join(parts)}))"
        case "msup":
            return f"({parts[0]}**{parts[1]})"
        case "msub":
            return "(symbol)"
        case "mrow":
            function = len(element) > 1 and element[1].tag == "mi" and len(parts) > 3
            return f"({''.join(parts)})" if function else "".join(parts)
    raise AssertionError(element.tag)


@pytest.mark.parametrize("name", ROBOTS)
def test_numbers_put_into_the_equations_give_what_is_printed(name: str, paper: Study) -> None:
    found = study_equations(studied(name, paper))
    counted = 0
    for equation in found.equations:
        for line in equation.lines:
            *before, last = evaluated(line)
            known = [value for value in before if value is not None]
            if equation.name == "Eq. 2" and last is not None:  # the same up to a whole turn
                known = [last + math.remainder(value - last, math.tau) for value in known]
            assert last is not None or not known, line  # symbols are never a result
            for value in known:
                assert last is not None
                off = 0.02 if "Eqs. 2 to 4" in equation.name else 1e-3
                assert value == pytest.approx(last, rel=1e-4, abs=off), line
                counted += 1
    assert counted >= 3
    three_at_120_degrees = (*robot_names(), "two clamped disks", "turned")
    assert ("Eq. 5" in [e.name for e in found.equations]) == (name in three_at_120_degrees)


def test_the_equations_are_those_of_the_comparisons(paper: Study) -> None:
    found = {e.name: e for e in study_equations(paper).equations}
    assert list(found) == [
        *("Eq. 2", "Eqs. 3 and 4", "Eq. 1", "Eq. 5"),
        *("First correction", "Linear law", "Second correction"),
    ]
    tip = paper.comparison("cc_from_lengths").tip_position[-1] * 1e3
    for name in ("Eq. 1", "Eq. 5"):
        point = [evaluated(line)[-1] for line in found[name].lines]
        assert point == pytest.approx(tip, abs=6e-4)
    lengths = paper.statics.tendon_lengths[-1] * 1e3
    assert evaluated(found["Eqs. 3 and 4"].lines[0])[-1] == pytest.approx(lengths.mean(), abs=6e-4)
    for name, ours in (
        ("Eq. 1", "cc_from_lengths"),
        ("First correction", "cc_from_lengths_chord"),
        ("Linear law", "cc_from_force"),
        ("Second correction", "cc_from_force_arm"),
    ):
        error = in_mm(paper.comparison(ours).error[-1])
        assert f"{error} from the tip by statics" in found[name].note


def test_a_segment_with_few_tendons_has_the_arc_of_their_lengths(paper: Study) -> None:
    found = study_equations(studied(str(TWO_TUBES), paper))
    assert "lengths are those of the robot by statics" in " ".join(found.intro)
    note = found.equations[0].note
    assert "fewer than three, so that the backbone keeps" in note and "length 120 mm" in note
    # its disks clamp the backbone, so that no equation is that of all modules
    assert [e.name for e in found.equations[1:]] == ["Eq. 1", "Linear law"]


def test_a_segment_where_no_tendon_ends_has_the_arc_of_the_linear_law(paper: Study) -> None:
    robot = load_robot(TWO_TUBES, {"segments.0.tendons": []})
    found = study_equations(Stages(robot).over(paper))
    assert "give no arc (segment 1:" in " ".join(found.intro)
    # its disks clamp the backbone, so that no equation is that of all modules
    assert [e.name for e in found.equations] == ["Eq. 1", "Linear law"]
    assert len(found.arcs) == 2


def test_a_straight_robot_has_no_numbers_to_put_in(paper: Study) -> None:
    robot, every = load_robot("amouri2019"), {1: 1.0, 2: 1.0, 3: 1.0}
    balanced = Stages(robot, points=3, tendon=every, max_tension=9.0).over(paper)
    found = study_equations(balanced)
    assert found.equations == () and "straight at this load" in found.intro[-1]
    for stem in ("fig01_robot", "fig02_arc", "fig03_spaces", "fig04_module"):
        with figure_style():
            _DRAWINGS[stem](balanced).draw_without_rendering()


# -- figures -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ROBOTS)
def test_drawings_fit_and_carry_the_robots_numbers(name: str, paper: Study) -> None:
    found = studied(name, paper)
    segment = first_segment(found)
    angle = f"{math.degrees(segment.theta):.3g}°"
    part = found.robot.segments[0]
    with figure_style():
        for stem, expected in (
            ("fig02_arc", [angle, f"{segment.length * 1e3:.4g} mm"]),
            ("fig04_module", [in_mm(part.disks.radius), in_mm(part.backbone.diameter)]),
        ):
            figure = _DRAWINGS[stem](found)
            figure.draw_without_rendering()
            key = "\n".join(text.get_text() for text in figure.texts)
            assert all(text in key for text in expected), key
            texts = [*figure.texts, *(t for axes in figure.axes for t in axes.texts)]
            boxes = [(t.get_text(), t.get_window_extent()) for t in texts if t.get_text()]
            for text, box in boxes:
                assert box.x0 > -1 and box.y0 > -1, text
                assert box.x1 < figure.bbox.x1 + 1 and box.y1 < figure.bbox.y1 + 1, text
            rows = [t.get_window_extent() for t in figure.texts if t.get_text()]
            for one, other in itertools.combinations(rows, 2):
                assert not one.overlaps(other)
            for axes in figure.axes:  # to scale
                assert axes.get_aspect() == 1.0


@pytest.mark.parametrize("name", ROBOTS)
def test_the_spaces_carry_the_robots_numbers(name: str, paper: Study) -> None:
    found = studied(name, paper)
    segment = first_segment(found)
    with figure_style():
        figure = _DRAWINGS["fig03_spaces"](found)
        figure.draw_without_rendering()
    text = "\n".join(t.get_text() for t in figure.axes[0].texts)
    lengths = found.statics.tendon_lengths[segment.load][segment.tendons] * 1e3
    end = segment.arcs.disk_positions[len(segment.stations) - 1] * 1e3
    assert f"{math.degrees(segment.theta):.3g}°" in text and f"{end[2]:.4g}) mm" in text
    assert (f"{lengths[0]:.4g}" in text) == segment.from_lengths == ("physics: statics" in text)
    assert all(t.get_window_extent().x0 >= 0 for t in figure.axes[0].texts)
    assert all(t.get_window_extent().x1 <= figure.bbox.x1 for t in figure.axes[0].texts)


def test_a_module_is_drawn_to_scale(paper: Study) -> None:
    segment = first_segment(paper)
    with figure_style():
        figure = _DRAWINGS["fig04_module"](paper)
    spans = {}
    for line in figure.axes[0].lines:
        points = np.asarray(line.get_xydata())
        if len(points) == 2 and line.get_linestyle() in ("-", "--") and line.get_linewidth() == 1.5:
            spans[line.get_color()] = float(np.linalg.norm(points[1] - points[0]))
    radius, a = segment.length / segment.theta, segment.theta / 9
    inner = 2e3 * (radius - 29e-3) * math.sin(a / 2)  # the chord of docs/theory
    outer = 2e3 * (radius + 14.5e-3) * math.sin(a / 2)
    assert spans == pytest.approx({LIGHT["red"]: inner, LIGHT["blue"]: outer})


def test_disks_without_thickness_are_not_drawn_and_the_report_says_why(paper: Study) -> None:
    robot = load_robot("amouri2019", {"segments.0.disks.thickness": "0 mm"})
    flat = Stages(robot, points=3).over(paper)
    assert "fig02_disk" not in [f.stem for f in flat.figures]
    row = next(c for c in counterparts(flat) if c.source == "Fig. 2")
    assert row.anchor is None and "thickness is 0 mm" in row.missing
    assert [v.value for v in assumed(flat)] == [v.value for v in assumed(paper)[:2]]


# -- Table 1 -----------------------------------------------------------------------------------


def test_the_table_tells_given_values_from_those_left_out() -> None:
    rows = {p.field or p.meaning: p for p in parameters(load_robot("amouri2019"))}
    assert (rows["backbone.E"].value, rows["backbone.E"].origin) == ("35 GPa", GIVEN)
    assert (rows["gravity"].value, rows["gravity"].origin) == ("0 0 0 m/s²", DEFAULT)
    assert rows["backbone.inner_diameter"].origin == DEFAULT
    assert rows["Bending stiffness E I"].value == "1.074 N m²"
    assert rows["Bending stiffness E I"].origin == DERIVED
    assert not any(p.where for p in rows.values())
    robot = load_robot("amouri2019").with_({"segments.0.backbone.inner_diameter": "1 mm"})
    for each in (robot, copy.copy(robot)):
        rows = {p.field: p for p in parameters(each)}
        assert rows["backbone.inner_diameter"].origin == GIVEN
        assert rows["tendons.friction"].origin == DEFAULT


def test_values_that_segments_or_tendons_share_are_listed_once() -> None:
    rows = parameters(load_robot("crl-ftdcr-v4"))
    lengths = [(p.where, p.value) for p in rows if p.field == "length"]
    assert lengths == [("segment 1", "60 mm"), ("segment 2", "62.5 mm"), ("segment 3", "64 mm")]
    assert [p.where for p in rows if p.field == "backbone.E"] == [""]
    angles = [p.where for p in rows if p.field == "tendons.first_angle"]
    assert angles == ["tendons 1 to 3", "tendons 4 to 6", "tendons 7 to 9"]
    radii = [p for p in parameters(load_robot(TWO_TUBES)) if p.field == "tendons.pitch_radius"]
    assert [(p.where, p.value) for p in radii] == [
        ("tendon 1", "20 mm"),
        ("tendon 2", "15 mm"),
        ("tendons 3 to 5", "18 mm"),
    ]


def test_the_page_has_the_equations_and_the_note_on_youngs_modulus(written: Path) -> None:
    page = (written / "report.html").read_text(encoding="utf-8")
    assert page.count("<math ") == 19 and page.count("<p><strong>Eq. 2") == 1
    robot = page[page.index('id="robot"') : page.index('id="assumed"')]
    assert "Table 1 prints 35 MPa" in robot and ">35 GPa<" in robot
    assert page.index('id="assumed"') < page.index("friction 0.1</th>") < page.index("provenance")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["crl-ftdcr-v4", "four tendons", str(TWO_TUBES)])
def test_the_report_of_other_robots_is_written(name: str, paper: Study, tmp_path: Path) -> None:
    found = replace(studied(name, paper), budget=paper.budget)
    page = (report.write(found, tmp_path / "out") / "report.html").read_text(encoding="utf-8")
    segments = len(found.robot.segments)
    assert ("The arcs of all segments" in page) == (segments > 1)
    assert 'id="fig02_arc"' in page and 'id="fig04_module"' in page
