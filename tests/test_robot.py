"""The robot file: its meaning, its checks and their messages."""

import copy
import inspect
import json
import math
import pickle
import re
import subprocess
import sys
import time
from collections.abc import Callable
from operator import attrgetter
from pathlib import Path

import jsonschema
import numpy as np
import pint
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic_core import PydanticCustomError

import bowstring as bs
import bowstring.units as units
from bowstring.errors import InputError
from bowstring.robot.model import Robot
from bowstring.robot.parts import (
    Backbone,
    Disks,
    Part,
    Payload,
    Segment,
    Tendon,
    TendonRing,
)
from bowstring.robot.reader import load_robot, robot_names, robot_schema

ROOT = Path(__file__).parent.parent
BUILT_IN = ROOT / "python" / "bowstring" / "robot" / "builtin"
AMOURI = (BUILT_IN / "amouri2019.yaml").read_text(encoding="utf-8")
LENGTH = units.Quantity("m", "641 mm", "0 m", "1 km")
GOOD = """
segments:
  - length: 200 mm
    backbone: {diameter: 2 mm, E: 60 GPa, nu: 0.3, density: 6450 kg/m^3}
    disks: {count: 4, mass: 3 g, radius: 15 mm, thickness: 3 mm}
    tendons: {count: 3, pitch_radius: 12 mm}
"""


@pytest.fixture
def load(tmp_path):
    def load_text(text, overrides=None):
        path = tmp_path / "r.yaml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return load_robot(path, overrides)

    return load_text


@pytest.fixture
def refuse(load):
    """The message of a rejected file, without the file's name."""

    def refused(text, overrides=None):
        with pytest.raises(InputError) as caught:
            load(text, overrides)
        return re.sub(r"^.*r\.yaml:? ?", "", str(caught.value))

    return refused


def changed(old, new):
    assert GOOD.count(old) == 1
    return GOOD.replace(old, new)


# --- contents of a robot --------------------------------------------------------------


def test_amouri2019_matches_table_1():
    robot = load_robot("amouri2019")
    (segment,) = robot.segments
    assert robot.length == segment.length == 0.641
    assert (segment.backbone.diameter, segment.backbone.E) == (0.005, 35e9)
    assert (segment.backbone.nu, segment.backbone.density) == (0.3, 1800.0)
    assert robot.gravity == (0, 0, 0)
    np.testing.assert_allclose(robot.disks.station_m, 0.641 * np.arange(1, 10) / 9, rtol=1e-15)
    assert robot.disks.station_m[-1] == 0.641
    for field, value in [
        ("mass_kg", 0.02),
        ("radius_m", 0.032),
        ("thickness_m", 0.003),
        ("clamped_length_m", 0.0),
        ("segment", 0),
    ]:
        assert getattr(robot.disks, field).tolist() == [value] * 9
    np.testing.assert_allclose(
        robot.tendons.angle_rad, [0, math.tau / 3, 2 * math.tau / 3], rtol=1e-15
    )
    assert robot.tendons.pitch_radius_m.tolist() == [0.029] * 3
    assert robot.tendons.end_disk.tolist() == [8] * 3


def test_rao2021_has_two_segments_that_share_their_holes():
    robot = load_robot("rao2021")
    assert [s.length for s in robot.segments] == [0.2, 0.2]
    assert [(s.backbone.diameter, s.backbone.E, s.backbone.nu) for s in robot.segments] == [
        (0.0014, 54e9, 0.3)
    ] * 2
    np.testing.assert_allclose(robot.disks.station_m, 0.02 * np.arange(1, 21), rtol=1e-14)
    assert robot.disks.segment.tolist() == [0] * 10 + [1] * 10
    tendons = robot.tendons
    np.testing.assert_allclose(np.degrees(tendons.angle_rad), [90, -30, 210] * 2, rtol=1e-15)
    r, s = 0.01, 0.01 * math.sqrt(3) / 2
    np.testing.assert_allclose(
        tendons.hole_m, [[0, r], [s, -r / 2], [-s, -r / 2]] * 2, atol=1e-17, rtol=1e-14
    )
    assert tendons.segment.tolist() == [0, 0, 0, 1, 1, 1]
    assert tendons.end_disk.tolist() == [9, 9, 9, 19, 19, 19]
    assert robot.gravity == (0, 0, 0)


def test_crl_ftdcr_v4_matches_the_published_geometry():
    robot = load_robot("crl-ftdcr-v4")
    assert [s.length for s in robot.segments] == [0.06, 0.0625, 0.064]
    assert robot.length == pytest.approx(0.1865, rel=1e-15)
    for segment in robot.segments:
        backbone = segment.backbone
        assert (backbone.diameter, backbone.inner_diameter) == (0.001, 0.0)
        assert (backbone.E, backbone.nu) == (50e9, 0.3)
    assert robot.disks.segment.tolist() == [0] * 10 + [1] * 10 + [2] * 10
    np.testing.assert_allclose(
        robot.disks.station_m[[0, 9, 10, 19, 29]],
        np.cumsum([0.006, 0.054, 0.00625, 0.05625, 0.064]),
        rtol=1e-14,
    )
    assert robot.disks.radius_m.tolist() == [0.0055] * 30
    tendons = robot.tendons
    base = np.repeat([-3.0589, -2.5615, -2.0506], 3)
    around = np.tile([0, math.tau / 3, 2 * math.tau / 3], 3)
    np.testing.assert_allclose(tendons.angle_rad, base + around, rtol=0, atol=1e-14)
    assert tendons.pitch_radius_m.tolist() == [0.0045] * 9
    assert tendons.segment.tolist() == [0] * 3 + [1] * 3 + [2] * 3
    assert tendons.end_disk.tolist() == [9] * 3 + [19] * 3 + [29] * 3
    assert robot.gravity == (0, 0, 0)
    # mass of the source's backbone at 37708 kg/m^3
    mass = robot.disks.mass_kg.sum() + robot.mass_per_length @ [s.length for s in robot.segments]
    assert mass == pytest.approx(37708 * math.pi * 0.0005**2 * 0.1865, rel=0.03)


def test_stiffness_of_rod_and_tube(load):
    rod = load_robot("amouri2019")
    second_moment, area = math.pi * 0.005**4 / 64, math.pi * 0.005**2 / 4
    assert rod.bending_stiffness == pytest.approx([35e9 * second_moment])
    assert rod.torsion_stiffness == pytest.approx([35e9 / 2.6 * 2 * second_moment])
    assert rod.axial_stiffness == pytest.approx([35e9 * area])
    assert rod.shear_stiffness == pytest.approx([35e9 / 2.6 * area])
    assert rod.mass_per_length == pytest.approx([1800 * area])
    assert rod.rotary_inertia == pytest.approx([1800 * second_moment])

    tube = rod.with_(
        {"segments.0.backbone.inner_diameter": "3 mm", "segments.0.backbone.G": "10 GPa"}
    )
    second_moment, area = math.pi * (5**4 - 3**4) * 1e-12 / 64, math.pi * 16e-6 / 4
    assert tube.bending_stiffness == pytest.approx([35e9 * second_moment])
    assert tube.torsion_stiffness == pytest.approx([10e9 * 2 * second_moment])
    assert tube.axial_stiffness == pytest.approx([35e9 * area])
    assert tube.shear_stiffness == pytest.approx([10e9 * area])
    assert tube.mass_per_length == pytest.approx([1800 * area])


def test_each_segment_has_its_own_disks_and_tendons(load):
    robot = load_robot(ROOT / "examples" / "my_robot.yaml")
    assert robot.length == pytest.approx(0.34)
    assert robot.disks.station_m[8:] == pytest.approx([0.18, 0.22, 0.26, 0.30, 0.34])
    assert robot.tendons.end_disk.tolist() == [8] * 4 + [12] * 4
    assert np.degrees(robot.tendons.angle_rad) == pytest.approx(
        [0, 90, 180, 270, 45, 135, 225, 315]
    )
    assert robot.gravity == (0, 0, 9.80665)
    assert robot.warnings == ()


def test_documented_example_matches_its_comments(load):
    text = (ROOT / "docs" / "reference" / "robot-file.md").read_text(encoding="utf-8")
    example, coupled = re.findall(r"```yaml\n(.*?)```", text, re.S)
    robot = load(example)
    jsonschema.validate(yaml.safe_load(example), robot_schema())
    assert (robot.name, robot.gravity) == ("two_segments", (0, 0, -9.80665))
    assert len(robot.disks.station_m) == 14
    assert robot.disks.clamped_length_m.tolist() == [0.003] * 10 + [0.0] * 4
    assert np.degrees(robot.tendons.angle_rad) == pytest.approx([90, 210, 330, 30, 150, -90])
    assert robot.segments[1].backbone.shear_modulus == 23e9
    assert robot.tendons.axial_stiffness_N.tolist() == [15e3] * 3 + [math.inf] * 3
    assert robot.tendons.friction.tolist() == [0.1] * 3 + [0, 0.15, 0]
    assert robot.warnings == ()
    # every field of the model is in the example
    schema = robot_schema()
    for part in (schema, *schema["$defs"].values()):
        for field in part["properties"]:
            assert re.search(rf"\b{field}:", example + coupled), field
    # the other kind of backbone in place of the first one's
    tree = yaml.safe_load(example)
    tree["segments"][0] |= yaml.safe_load(coupled)
    jsonschema.validate(tree, robot_schema())
    assert load(yaml.safe_dump(tree)).segments[0].backbone.stiffness[0][2] == 0.03


def test_robot_names():
    assert robot_names() == ["amouri2019", "crl-ftdcr-v4", "rao2021"]


def test_name_is_the_file_name_unless_given(load):
    assert load(GOOD).name == "r"
    assert load("name: 12\n" + GOOD).name == "12"


# --- tendon properties ----------------------------------------------------------------

# text in a file, SI value, array, and value where the field is omitted
DRIVE = {
    "axial_stiffness": ("20 kN", 20e3, "axial_stiffness_N", math.inf),
    "free_length": ("300 mm", 0.3, "free_length_m", 0.0),
    "compliance": ("0.01 mm/N", 1e-5, "compliance_m_per_N", 0.0),
    "friction": ("0.1", 0.1, "friction", 0.0),
    "pretension": ("2 N", 2.0, "pretension_N", 0.0),
    "spool_radius": ("10 mm", 0.01, "spool_radius_m", math.nan),
}
DRIVEN = ", ".join(f"{name}: {text}" for name, (text, *_) in DRIVE.items())
RING = "{count: 3, pitch_radius: 12 mm}"


def arrays(robot):
    return {array: getattr(robot.tendons, array).tolist() for _, _, array, _ in DRIVE.values()}


def test_a_ring_sets_all_of_its_tendons(load):
    robot = load(changed(RING, f"{{count: 3, pitch_radius: 12 mm, {DRIVEN}}}"))
    assert arrays(robot) == {array: [value] * 3 for _, value, array, _ in DRIVE.values()}
    for tendon in robot.segments[0].tendon_list:
        assert [getattr(tendon, name) for name in DRIVE] == [v for _, v, _, _ in DRIVE.values()]
    for array in arrays(robot):
        with pytest.raises(ValueError, match="read-only"):
            getattr(robot.tendons, array)[0] = 1
    # the same as a list, which gives the same robot
    tree = robot.model_dump(mode="json", exclude_none=True)
    tree["segments"][0]["tendons"] = [
        tendon.model_dump(mode="json", exclude_none=True)
        for tendon in robot.segments[0].tendon_list
    ]
    listed = Robot.model_validate(tree)
    assert arrays(listed) == arrays(robot) and listed.hash == robot.hash


def test_each_tendon_of_a_list_has_its_own_properties(load):
    one = f"{{angle: 0 deg, pitch_radius: 12 mm, {DRIVEN}}}"
    two = "{angle: 180 deg, pitch_radius: 11 mm, friction: 0.2}"
    robot = load(changed(RING, f"[{one}, {two}]"))
    absent = {name: none for name, (_, _, _, none) in DRIVE.items()} | {"friction": 0.2}
    for name, (_, value, array, _) in DRIVE.items():
        np.testing.assert_array_equal(getattr(robot.tendons, array), [value, absent[name]])
    # segment by segment, inner first
    both = load(changed(RING, f"[{one}, {two}]") + "".join(GOOD.splitlines(keepends=True)[2:]))
    assert both.tendons.friction.tolist() == [0.1, 0.2, 0, 0, 0]
    assert both.tendons.axial_stiffness_N.tolist() == [20e3] + [math.inf] * 4


def test_overrides_of_tendon_properties():
    robot = load_robot("amouri2019")
    by_text = robot.with_({f"segments.0.tendons.{name}": v[0] for name, v in DRIVE.items()})
    by_si = robot.with_({f"segments[0].tendons.{name}": v[1] for name, v in DRIVE.items()})
    assert arrays(by_text) == arrays(by_si) and by_text.hash == by_si.hash
    assert arrays(by_text) == {array: [value] * 3 for _, value, array, _ in DRIVE.values()}
    assert by_text.with_({f"segments.0.tendons.{name}": None for name in DRIVE}) == robot
    one = load_robot("rao2021", {"segments.1.tendons.2.friction": 0.3})
    assert one.tendons.friction.tolist() == [0, 0, 0, 0, 0, 0.3]


@pytest.mark.parametrize("form", ["ring", "list"])
@pytest.mark.parametrize(
    ("field", "text", "problem"),
    [
        ("axial_stiffness", "0 N", 'got "0 N"; must lie between 1 mN and 1e12 N'),
        ("axial_stiffness", "20000", 'got 20000 without a unit; write for example "20 kN"'),
        (
            "axial_stiffness",
            "35 GPa",
            'got "35 GPa"; "GPa" is not a unit of force; write for example "20 kN"',
        ),
        ("free_length", "-1 mm", 'got "-1 mm"; must lie between 0 mm and 1 km'),
        ("compliance", "-1 mm/N", 'got "-1 mm/N"; must lie between 0 m/N and 1000 m/N'),
        ("compliance", "0", 'got 0 without a unit; write for example "0.01 mm/N"'),
        (
            "compliance",
            "5 N/mm",
            'got "5 N/mm"; "N/mm" is not a unit of compliance; write for example "0.01 mm/N"',
        ),
        ("friction", "-0.1", "got -0.1; must lie between 0 and 10"),
        ("friction", "1e999", "got 1e999; must lie between 0 and 10"),
        ("friction", "nan", 'got "nan", which is not a number; write for example 0.1'),
        (
            "friction",
            "10 %",
            'got "10 %"; this is a plain number without a unit; write for example 0.1',
        ),
        ("friction", "", "got nothing, which is not a number; write for example 0.1"),
        ("pretension", "-1 N", 'got "-1 N"; must lie between 0 N and 1e9 N'),
        ("spool_radius", "0 mm", 'got "0 mm"; must lie between 1 um and 100 m'),
    ],
)
def test_invalid_tendon_properties_are_named(refuse, form, field, text, problem):
    if form == "ring":
        tendons, where = f"{{count: 3, pitch_radius: 12 mm, {field}: {text}}}", "tendons"
    else:
        good = "{angle: 0 deg, pitch_radius: 12 mm}"
        bad = f"{{angle: 90 deg, pitch_radius: 12 mm, {field}: {text}}}"
        tendons, where = f"[{good}, {bad}]", "tendons[1]"
    assert refuse(changed(RING, tendons)) == f"segments[0].{where}.{field}: {problem}."


# --- units ----------------------------------------------------------------------------


@pytest.mark.parametrize("si", [si for si in units._UNITS if si])
def test_own_table_of_units_agrees_with_pint(si):
    registry = pint.UnitRegistry()
    for unit, factor in units._UNITS[si].items():
        assert float(factor) == pytest.approx(registry.Quantity(1.0, unit).m_as(si), rel=1e-15)


@pytest.mark.parametrize(
    ("field", "text", "value"),
    [
        ("length", "641 mm", 0.641),
        ("length", "641mm", 0.641),
        ("length", "  64.1   cm ", 0.641),
        ("length", "0.641 m", 0.641),
        ("length", "6.41e2 mm", 0.641),
        ("length", "+641000 µm", 0.641),
        ("length", "641000 um", 0.641),
        ("length", "25 inch", 0.635),
        ("length", "2 ft", 0.6096),
        ("tendons.axial_stiffness", "0.02 MN", 20e3),
        ("tendons.free_length", "0 mm", 0.0),
        ("tendons.compliance", "10 um/N", 1e-5),
        ("tendons.compliance", "10 m/MN", 1e-5),
        ("tendons.friction", ".25", 0.25),
        ("tendons.pretension", "500 mN", 0.5),
        ("backbone.density", "1.8 g/cm³", 1800.0),
        ("backbone.density", "1800 kg/m**3", 1800.0),
        ("backbone.density", "1800 kg / m^3", 1800.0),
        ("backbone.density", "1800 kg·m^-3", 1800.0),
        ("backbone.E", "35 kN/mm^2", 35e9),
        ("disks.mass", "20000 mg", 0.02),
        ("tendons.first_angle", "120°", math.radians(120)),
        ("tendons.first_angle", "-30 deg", math.radians(-30)),
        ("tendons.first_angle", "0.25 turn", math.pi / 2),
    ],
)
def test_spellings_of_units(load, field, text, value):
    found = attrgetter(field)(load(GOOD, {f"segments.0.{field}": text}).segments[0])
    assert found == pytest.approx(value, rel=1e-15)


@given(st.integers(1, 10**9))
def test_every_unit_gives_the_same_float(micrometres):
    exact = micrometres / 10**6
    for unit, power in (("um", 0), ("mm", 3), ("cm", 4), ("m", 6)):
        digits = f"{micrometres:010d}"
        text = f"{digits[:-power]}.{digits[-power:]}" if power else digits
        assert LENGTH.read(f"{text} {unit}") == exact


@given(st.floats(1e-6, 1e3))
def test_round_trip_of_numbers_with_units(value):
    quantity = units.Quantity("m", "641 mm", "0 m", "2 km")
    assert quantity.read(f"{value!r} m") == value
    assert quantity.read(value) == value
    assert quantity.read(f"{value!r} mm") == pytest.approx(value / 1000, rel=1e-15)


@given(st.text(max_size=30))
@settings(max_examples=300, deadline=None)
def test_any_text_is_read_or_refused_with_a_sentence(text):
    try:
        value = LENGTH.read(text)
    except PydanticCustomError as error:
        message = str(error)
        assert message.startswith("got ") and message.isprintable() and len(message) < 250
    else:
        assert isinstance(value, float) and 0 <= value <= 1000


def test_rare_unit_text_cannot_make_pint_compute():
    for text in (
        "1 m**9999999",
        "1 9**9**9",
        "1 m^9^9^9",
        "1 (m)",
        "1 m;import os",
        "1 " + "m*" * 99,
    ):
        with pytest.raises(PydanticCustomError, match="is not a unit"):
            LENGTH.read(text)


@pytest.mark.parametrize(
    "text",
    [
        "1" * 900_000 + " mm",
        "1 " * 400_000,
        "1e" * 400_000,
        "1." * 400_000 + "\n.",
        "1 " + "m" * 900_000,
        "1 " + "m/" * 400_000,
        "9" * 90 + " mm",
    ],
    ids=range(7),
)
def test_hostile_text_is_refused_at_once(text):
    start = time.process_time()
    with pytest.raises(PydanticCustomError) as caught:
        LENGTH.read(text)
    assert time.process_time() - start < 2.0
    assert len(str(caught.value)) < 250


def test_gravity_forms(load):
    for form in ("0 0 -9.81 m/s^2", "[0 m/s^2, 0 m/s^2, -9.81 m/s^2]", "0 0 -981 cm/s^2"):
        assert load(f"gravity: {form}\n" + GOOD).gravity == (0, 0, -9.81)
    for value in ("0 0 -9.81", "[0, 0, -9.81]", [0, 0, -9.81], np.array([0, 0, -9.81])):
        assert load(GOOD, {"gravity": value}).gravity == (0, 0, -9.81)


def test_positions_forms(load):
    for form in ("50 80.5 200 mm", "[50 mm, 8.05 cm, 0.2 m]"):
        robot = load(changed("count: 4", f"positions: {form}"))
        assert robot.disks.station_m.tolist() == [0.05, 0.0805, 0.2]


# --- rejected files -------------------------------------------------------------------


def fields_of(part: type[Part]) -> str:
    """Known fields as messages list them: a part's own ones before those that it inherits."""
    return ", ".join(sorted(part.model_fields, key=lambda name: name not in part.__annotations__))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("200 mm", "641", 'length: got 641 without a unit; write for example "641 mm".'),
        (
            "200 mm",
            "641 kg",
            'length: got "641 kg"; "kg" is not a unit of length; write for example "641 mm".',
        ),
        ("200 mm", "-200 mm", 'length: got "-200 mm"; must lie between 1 um and 1 km.'),
        (
            "200 mm",
            "200 gondolas",
            'length: got "200 gondolas"; "gondolas" is not a known unit; '
            'write for example "641 mm".',
        ),
        (
            "200 mm",
            "nan mm",
            'length: got "nan mm", which is not a number with a unit; write for example "641 mm".',
        ),
        (
            "length: 200 mm",
            "length:",
            'length: got nothing, which is not a number with a unit; write for example "641 mm".',
        ),
        ("length: 200 mm", "name: a", 'length: missing; write for example "length: 641 mm".'),
        ("200 mm", "[200 mm]", 'length: got a list of 1; write for example "641 mm".'),
        (
            "60 GPa",
            "60 gpa",
            'backbone.E: got "60 gpa"; "gpa" is not a known unit '
            "(units are case-sensitive: GPa); "
            'write for example "35 GPa".',
        ),
        ("0.3", "0.6", "backbone.nu: got 0.6; must lie between -0.99 and 0.5."),
        ("0.3", "-1", "backbone.nu: got -1; must lie between -0.99 and 0.5."),
        (
            "nu: 0.3",
            "nu: 0.3, G: 20 GPa",
            "backbone: G and nu: both given; write exactly one of the two.",
        ),
        ("nu: 0.3, ", "", "backbone: G and nu: missing; write exactly one of the two."),
        (
            "diameter: 2 mm",
            "diameter: 2 mm, inner_diameter: 2 mm",
            "backbone.inner_diameter: got 2 mm; must be smaller than the diameter, 2 mm.",
        ),
        ("count: 4", "count: 0", "disks.count: got 0; must be a whole number from 1 to 100000."),
        (
            "count: 4",
            "count: 100001",
            "disks.count: got 100001; must be a whole number from 1 to 100000.",
        ),
        (
            "count: 4",
            "count: 4.5",
            "disks.count: got 4.5; must be a whole number from 1 to 100000.",
        ),
        (
            "count: 4",
            "count: yes",
            'disks.count: got "yes"; must be a whole number from 1 to 100000.',
        ),
        ("count: 4, ", "", "disks: count and positions: missing; write exactly one of the two."),
        (
            "count: 4",
            "positions: 50 40 200 mm",
            "disks.positions: got 40 mm after 50 mm; must increase from base to tip.",
        ),
        (
            "count: 4",
            "positions: 50 190 mm",
            "disks.positions: the last is 190 mm; must be the segment's length, 200 mm.",
        ),
        (
            "count: 4",
            "positions: []",
            'disks.positions: got 0 numbers; must have at least one, for example "100 150 200 mm".',
        ),
        (
            "12 mm",
            "15 mm",
            "tendons.pitch_radius: got 15 mm, a hole outside its disk; "
            "must be smaller than the disk's radius, 15 mm.",
        ),
        (
            "12 mm",
            "1 mm",
            "tendons.pitch_radius: got 1 mm, a hole inside its backbone; "
            "must be larger than the backbone's radius, 1 mm.",
        ),
        ("count: 3", "count: 0", "tendons.count: got 0; must be a whole number from 1 to 1000."),
        (
            "{count: 3, pitch_radius: 12 mm}",
            "[{angle: 400 deg, pitch_radius: 12 mm}]",
            'tendons[0].angle: got "400 deg"; must lie between -360 deg and 360 deg.',
        ),
        (
            "{count: 3, pitch_radius: 12 mm}",
            "three",
            f'tendons: got "three"; must be a set of fields: {fields_of(TendonRing)}.',
        ),
        (
            "pitch_radius: 12 mm",
            "pitch_radius: {normal: {sd: 1 %}}",
            "tendons.pitch_radius: got a set of fields; write one number, for example "
            '"29 mm"; a distribution, such as {normal: {sd: 5 %}}, goes into the file of '
            "uncertainty --distributions.",
        ),
        (
            "pitch_radius: 12 mm",
            "pitch_radius: 12 mm, mu: 0.1",
            "tendons.mu: unknown field; did you mean friction? Known here: "
            f"{fields_of(TendonRing)}.",
        ),
        (
            "thickness: 3 mm",
            "thickness: 3 mm, clamped_length: 50 mm",
            "disks.clamped_length: got 50 mm; the disks would clamp all of the "
            "50 mm before disk 2 of the segment; write a smaller length, "
            "so that some backbone is free to bend.",
        ),
        (
            "thickness: 3 mm",
            "thickness: 3 mm, clamped: 1 mm",
            "disks.clamped: unknown field; did you mean clamped_length? Known here: "
            f"{fields_of(Disks)}.",
        ),
        (
            "diameter:",
            "outer_diameter:",
            "backbone.outer_diameter: unknown field; did you mean diameter? "
            f"Known here: {fields_of(Backbone)}.",
        ),
    ],
)
def test_an_invalid_field_is_named_with_its_value_and_rule(refuse, old, new, message):
    assert refuse(changed(old, new)) == f"segments[0].{message}"


def test_all_problems_are_listed_at_once(refuse):
    text = changed("200 mm", "641").replace("60 GPa", "60 kg").replace("3 g", "-3 g")
    lines = refuse(text).splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("segments[0].length: got 641") and lines[0].endswith("(and 2 more).")
    assert lines[1].startswith('  segments[0].backbone.E: got "60 kg"')
    assert lines[2].startswith('  segments[0].disks.mass: got "-3 g"')


def test_a_file_with_many_errors_gets_a_short_message(refuse):
    lines = refuse("segments: [" + "{}, " * 90 + "]").splitlines()
    assert len(lines) == 22 and lines[-1].endswith("more.")


def test_outer_tendons_must_pass_the_inner_disks(load, refuse):
    two = GOOD + "".join(GOOD.splitlines(keepends=True)[2:])
    assert len(load(two).segments) == 2
    bad = {"segments.1.disks.radius": "30 mm", "segments.1.tendons.pitch_radius": "20 mm"}
    assert refuse(two, bad) == (
        "segments[1].tendons.pitch_radius: got 20 mm, a hole outside the disks of segments[0], "
        "which it passes; must be smaller than the disk's radius, 15 mm."
    )
    # clamps of two segments meet at the border
    inner = {"segments.0.disks.clamped_length": "49 mm"}
    load(two, {**inner, "segments.1.disks.clamped_length": "49 mm"})
    # the end disk of the inner segment clamps the outer one's first module
    for own, also in (("2 mm", ", which clamps 1 mm"), ("0 mm", "")):
        narrow = {"segments.1.disks.count": 9, "segments.1.disks.clamped_length": own}
        text = refuse(two, {**inner, **narrow})
        assert "segments[0].disks.clamped_length: got 49 mm; the end disk of segments[0]" in text
        assert f"before disk 1 of segments[1]{also}; write a smaller length" in text
        assert "got 0 mm" not in text and "segments[1].disks.clamped_length" not in text
    wide = {"segments.1.disks.count": 2, "segments.1.disks.clamped_length": "300 mm"}
    assert "segments[1].disks.clamped_length: got 300 mm" in refuse(two, {**inner, **wide})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty; a robot file has at least 'segments'."),
        ("# nothing\n", "is empty; a robot file has at least 'segments'."),
        ("\ufeff", "is empty; a robot file has at least 'segments'."),
        ("- 1\n- 2\n", "got a list of 2; must be fields such as 'segments: ...'."),
        ("hello", "got \"hello\"; must be fields such as 'segments: ...'."),
        ("segments:", "segments: got nothing; must be a list of segments, each after a '-'."),
        ("segments:" + "\n - {}" * 101, "segments: got a list of 101; must have at most 100."),
        ("segments: []", "segments: got an empty list; must have at least one."),
        ("a: {b: 1", "not valid YAML"),
        ("a: b: c", "line 1, column 5: not valid YAML"),
        (
            "a:\n  - b: 1\n\tc: 2",
            "line 3, column 1: the line begins with a tab; indent with spaces",
        ),
        ("a: \x01", "not valid YAML"),
        (b"a: 1\nb: \xff\xfe", "line 2: not UTF-8 text; save the file as UTF-8."),
        (GOOD + "---\n" + GOOD, "a second document starts; give one robot a file."),
        (changed("count: 4", "count: 4, count: 5"), 'the field "count" is given twice.'),
        (changed("200 mm", "&a 200 mm"), "line 3: anchors and aliases (& and *) are not allowed"),
        (changed("200 mm", "!!float 200"), "line 3: tags (!) are not allowed"),
        ("a: !!python/object/apply:os.system [true]", "line 1: tags (!) are not allowed"),
        ("? [a, b]\n: c", "a field's name must be plain text"),
        ("a: " + "[" * 5000 + "]" * 5000, "nested deeper than 20 levels."),
        ("a: " + "[" * 100_000, "nested deeper than 20 levels."),
        ("a: 1\n" * 250_000, "is too large; a robot file has at most 1 MB."),
    ],
)
def test_malformed_files(refuse, text, message):
    got = refuse(text)
    assert message in got
    assert "\n" not in got


def test_billion_laughs_is_refused_at_the_first_anchor(refuse):
    laughs = "a0: &a0 [lol, lol]\n" + "".join(
        f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)
    )
    assert refuse(laughs).startswith(", line 1: anchors and aliases")


def test_the_pure_python_yaml_reader_works(load, refuse, monkeypatch):
    fast = load(GOOD)
    monkeypatch.delattr(yaml, "CBaseLoader", raising=False)
    assert load(GOOD) == fast
    assert "line 1, column 5: not valid YAML" in refuse("a: b: c")
    assert "anchors and aliases" in refuse(changed("200 mm", "&a 200 mm"))
    assert "not valid YAML" in refuse("a: \x01")


def test_yaml_guesses_do_not_happen(load):
    robot = load("name: no\n" + changed("count: 4", "count: 010"))
    assert robot.name == "no"
    assert len(robot.disks.mass_kg) == 10


def test_a_misspelt_file_is_suggested(here):
    Path("mine.yaml").write_text("")
    Path("notes.txt").write_text("")
    for wrong in ("mine.yml", here / "mine.ymal"):
        near = Path(wrong).with_name("mine.yaml")
        with pytest.raises(InputError, match=f"did you mean {re.escape(str(near))}[?] built in"):
            load_robot(wrong)
    with pytest.raises(InputError, match="built-in robot; built in are"):
        load_robot("notes.yaml")


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (
            "amouri2018",
            "amouri2018 is neither a file nor a built-in robot; did you mean amouri2019? "
            "built in are amouri2019, crl-ftdcr-v4, rao2021.",
        ),
        (
            "no/such.yaml",
            "no/such.yaml is neither a file nor a built-in robot; "
            "built in are amouri2019, crl-ftdcr-v4, rao2021.",
        ),
        ("", "is a folder"),
        ("/dev/null", "/dev/null is a device or pipe"),
        ("a\0b", '"a\\u0000b" is neither'),
        ("a\nb", '"a\\nb" is neither'),
        ("x" * 5000, "cannot be read"),
    ],
)
def test_sources_that_are_not_robots(source, message):
    with pytest.raises(InputError) as caught:
        load_robot(source)
    text = str(caught.value)
    assert message in text
    assert text.isprintable() and len(text) < 300


@given(st.binary(max_size=200))
@settings(max_examples=200, deadline=None)
def test_any_bytes_are_refused_with_a_message(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("any") / "r.yaml"
    path.write_bytes(data)
    with pytest.raises(InputError):
        load_robot(path)


# --- overrides ------------------------------------------------------------------------


def test_overrides_with_units_and_in_si(load):
    for value in ("3 mm", "0.003", 0.003, "0.3 cm"):
        robot = load_robot("amouri2019", {"segments.0.disks.clamped_length": value})
        assert robot.disks.clamped_length_m.tolist() == [0.003] * 9
        assert (
            robot.hash
            == load_robot("amouri2019").with_({"segments[0].disks.clamped_length": value}).hash
        )


def test_override_of_fields_absent_in_the_file(load):
    paths = {
        "segments.0.disks.clamped_length": "1 mm",
        "segments.0.backbone.inner_diameter": "1 mm",
        "segments.0.tendons.first_angle": "90 deg",
        "gravity": "0 0 9.81",
        "description": "added",
        "name": "7",
    }
    robot = load(GOOD, paths)
    assert load(GOOD).with_(paths) == robot
    assert robot.segments[0].backbone.inner_diameter == 0.001
    assert robot.tendons.angle_rad[0] == math.pi / 2
    assert (robot.name, robot.description, robot.gravity) == ("7", "added", (0, 0, 9.81))


@pytest.mark.parametrize("star", ["segments.*", "segments[*]"])
def test_an_asterisk_stands_for_every_index(star):
    robot = load_robot("crl-ftdcr-v4")
    count = len(robot.segments)
    assert count > 1
    changes = {f"{star}.backbone.G": "20 GPa", f"{star}.length": 0.1, "segments.1.length": "0.2 m"}
    each = {f"segments.{i}.{name}": 0.1 for i in range(count) for name in ["length"]}
    each |= {f"segments.{i}.backbone.G": 20e9 for i in range(count)} | {"segments.1.length": 0.2}
    assert robot.with_(changes) == robot.with_(each) == load_robot("crl-ftdcr-v4", changes)
    for make in (robot.with_, lambda changes: load_robot("crl-ftdcr-v4", changes)):
        with pytest.raises(InputError, match=r'Override "?segments.0.\*.E"?: nothing matches; '):
            make({"segments.0.*.E": 1e9})
        with pytest.raises(InputError, match=r"segments\[0\].backbon: unknown field; did you mean"):
            make({f"{star}.backbon.E": 1e9})


def test_a_field_of_tendons_without_an_index_is_that_of_all():
    """As it is where they are a ring."""
    robot = load_robot("rao2021")
    each = {f"segments.0.tendons.{i}.compliance": "0.1 mm/N" for i in range(3)}
    given = {"segments.0.tendons.compliance": "0.1 mm/N"}
    assert robot.with_(given) == robot.with_(each) == load_robot("rao2021", given)
    mixed = robot.with_({"segments.1.tendons": {"count": 3, "pitch_radius": 0.01}})
    soft = mixed.with_({"segments.*.tendons.compliance": 1e-4})
    assert soft.tendons.compliance_m_per_N.tolist() == [1e-4] * 6
    with pytest.raises(InputError, match=r"segments\[0\].tendons\[0\].complianc: unknown field"):
        robot.with_({"segments.0.tendons.complianc": 1e-4})


def test_override_of_one_of_a_pair_removes_the_other():
    robot = load_robot("amouri2019")
    by_g = robot.with_({"segments.0.backbone.G": "13 GPa"})
    assert (by_g.segments[0].backbone.nu, by_g.segments[0].backbone.shear_modulus) == (None, 13e9)
    assert by_g.with_({"segments.0.backbone.nu": 0.3}) == robot
    placed = robot.with_({"segments.0.disks.positions": "[100 mm, 0.641]"})
    assert placed.disks.station_m.tolist() == [0.1, 0.641]
    assert placed.with_({"segments.0.disks.count": "9"}) == robot
    with pytest.raises(InputError, match="both given"):
        robot.with_({"segments.0.backbone.G": 1e9, "segments.0.backbone.nu": 0.3})


def test_overrides_of_whole_parts():
    robot = load_robot("amouri2019")
    two = "[{angle: 0 deg, pitch_radius: 20 mm}, {angle: 180 deg, pitch_radius: 0.025}]"
    changed_robot = robot.with_({"segments.0.tendons": two})
    assert changed_robot.tendons.hole_m == pytest.approx(np.array([[0.02, 0], [-0.025, 0]]))
    assert changed_robot.with_({"segments.0.tendons.1.angle": "90 deg"}).tendons.hole_m[
        1
    ] == pytest.approx([0, 0.025])
    assert robot.with_({"segments.0.tendons": {"count": 4, "pitch_radius": 0.02}}).tendons.hole_m[
        1
    ] == pytest.approx([0, 0.02])


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (
            "segments.0.disks.clamp",
            1,
            "amouri2019: segments[0].disks.clamp: unknown field; did you mean clamped_length? "
            f"Known here: {fields_of(Disks)}.",
        ),
        (
            "segment.0.length",
            1,
            "amouri2019: segment: unknown field; did you mean segments? "
            "Known here: name, description, gravity, segments, payloads.",
        ),
        (
            "segments.3.length",
            1,
            "Override segments.3.length: there is no 3 in segments; write segments.0.",
        ),
        (
            "segments.-1.length",
            1,
            "Override segments.-1.length: there is no -1 in segments; write segments.0.",
        ),
        (
            "segments.0.length.mm",
            1,
            'Override segments.0.length.mm: segments.0.length is a value, there is no "mm" in it.',
        ),
        ("segments..length", 1, 'Override "segments..length": write it as "segments.0.length".'),
        ("a\nb", 1, 'Override "a\\nb": write it as "segments.0.length".'),
        ("", 1, 'Override nothing: write it as "segments.0.length".'),
        (7, 1, 'Override 7: write it as "segments.0.length".'),
        (
            "segments.0.length",
            float("nan"),
            "amouri2019: segments[0].length: got nan m; must lie between 1 um and 1 km.",
        ),
        (
            "segments.0.tendons.friction",
            math.inf,
            "amouri2019: segments[0].tendons.friction: got inf; must lie between 0 and 10.",
        ),
        (
            "segments.0.tendons.friction",
            10**400,
            "amouri2019: segments[0].tendons.friction: got a huge number; must be a finite number; "
            "write for example 0.1.",
        ),
        (
            "segments.0.length",
            True,
            'amouri2019: segments[0].length: got True; write for example "641 mm".',
        ),
        (
            "segments.0.length",
            None,
            'amouri2019: segments[0].length: missing; write for example "length: 641 mm".',
        ),
        (
            "segments.0.tendons.first_angle",
            120,
            "amouri2019: segments[0].tendons.first_angle: got 120.0 rad; "
            "must lie between -360 deg and 360 deg.",
        ),
        (
            "gravity",
            "0 -9.81",
            'amouri2019: gravity: got 2 numbers; must have 3, for example "0 0 -9.80665 m/s^2".',
        ),
        (
            "segments.0",
            None,
            "Override segments.0: an entry of a list cannot be removed.",
        ),
    ],
)
def test_wrong_overrides(path, value, message):
    for make in (
        lambda: load_robot("amouri2019", {path: value}),
        lambda: load_robot("amouri2019").with_({path: value}),
    ):
        with pytest.raises(InputError) as caught:
            make()
        lines = str(caught.value).splitlines()
        assert re.sub(r" \(and \d more\)", "", lines[0]) == message


@pytest.mark.parametrize("value", [1.6, "1.6", np.float64(1.6)])
def test_a_number_that_is_valid_in_its_usual_unit_only_is_named(value):
    path = "segments.*.backbone.diameter"
    for make in (
        lambda changes: load_robot("amouri2019", changes),
        lambda changes: load_robot("amouri2019").with_(changes),
    ):
        with pytest.raises(InputError) as caught:
            make({"segments.0.length": 0.6, path: value})
        assert str(caught.value).splitlines()[-1] == (
            f'  {path}: got 1.6 without a unit, which is 1.6 m; write "1.6 mm" if that is meant.'
        )
        make({path: "1.6 mm"})
        with pytest.raises(InputError) as caught:
            make({path: "1.6 m"})
        assert "without a unit" not in str(caught.value)


def test_limits_apply_over_all_segments():
    segment = load_robot("amouri2019").model_dump(mode="json", exclude_none=True)["segments"][0]
    segment["disks"]["count"] = 60_000
    with pytest.raises(InputError, match="got 120000 disks in all; must be at most 100000"):
        load_robot("amouri2019", {"segments": [segment, segment]})
    segment["disks"]["count"], segment["tendons"]["count"] = 5, 600
    with pytest.raises(InputError, match="got 1200 tendons in all; must be at most 1000"):
        load_robot("amouri2019", {"segments": [segment, segment]})
    segment["disks"]["count"] = 4_000
    with pytest.raises(InputError, match="got 4000 disks and 600 tendons in all; disks times"):
        load_robot("amouri2019", {"segments": [segment]})


# --- warnings -------------------------------------------------------------------------


def test_the_modulus_printed_in_the_study_gives_a_warning():
    robot = load_robot("amouri2019", {"segments.0.backbone.E": "35 MPa"})
    (warning,) = robot.warnings
    assert warning == (
        "segments[0].backbone.E = 35 MPa looks wrong: the robot's own weight (2 N) as the tension "
        "of one tendon would wind the backbone 5.5 times around; with 35 GPa it would bend it by "
        "2 degrees: is 35 GPa meant?"
    )


def test_an_upright_robot_of_that_modulus_buckles_too():
    overrides = {"segments.0.backbone.E": "35 MPa", "gravity": "0 0 -9.81"}
    warnings = load_robot("amouri2019", overrides).warnings
    assert len(warnings) == 2
    assert "the upright backbone buckles under its own weight" in warnings[1]
    assert "segments[0].backbone.E = 35 MPa" in warnings[1] and "MPa, GPa" in warnings[1]


@pytest.mark.parametrize(("beyond", "least"), [("0 mm", 0.5864), ("300 mm", 0.2897)])
def test_a_payload_beyond_the_tip_buckles_sooner(beyond, least):
    """Least masses (kg) at which the straight equilibrium of the rod is no longer stable."""
    for share in (0.97, 1.1):
        payload = {"mass": f"{share * least} kg", "centre": f"0 0 {beyond}"}
        changes = {"gravity": "0 0 -9.81", "payloads": [payload]}
        warnings = load_robot("amouri2019", changes).warnings
        assert any("buckles under its own weight" in each for each in warnings) == (share > 1.0)


@pytest.mark.parametrize("name", robot_names())
@pytest.mark.parametrize("gravity", [0, 9.81, -9.81])
def test_built_in_robots_give_no_warning(name, gravity):
    assert load_robot(name, {"gravity": [0, 0, gravity]}).warnings == ()
    assert load_robot(name, {"gravity": [gravity, 0, 0]}).warnings == ()


def robot_of(**parts):
    """The built-in robot with other fields of its segment: numbers, or fields of a part."""
    changes = {}
    for part, fields in parts.items():
        for name, value in fields.items() if isinstance(fields, dict) else [("", fields)]:
            changes[f"segments.0.{part}.{name}".rstrip(".")] = value
    return load_robot("amouri2019", changes)


NITINOL = {"diameter": "1 mm", "E": "60 GPa", "density": 6450}
SOFT_BUT_REAL = {
    "Nitinol 1 mm, r 5 mm": dict(
        length="200 mm",
        backbone=NITINOL,
        disks={"mass": "1 g", "radius": "7 mm", "thickness": "2 mm"},
        tendons={"pitch_radius": "5 mm"},
    ),
    "Nitinol 1 mm under heavy disks, r 10 mm": dict(
        length="500 mm",
        backbone=NITINOL,
        disks={"mass": "10 g", "radius": "15 mm", "thickness": "4 mm"},
        tendons={"pitch_radius": "10 mm"},
    ),
    "catheter": dict(
        length="1 m",
        backbone={**NITINOL, "diameter": "0.4 mm"},
        disks={"count": 50, "mass": "5 mg", "radius": "1.5 mm", "thickness": "0.5 mm"},
        tendons={"pitch_radius": "1 mm"},
    ),
    "silicone": dict(
        length="200 mm",
        backbone={"diameter": "20 mm", "E": "100 kPa", "density": 1070, "nu": 0.49},
        disks={"mass": "5 g", "radius": "12 mm", "thickness": "5 mm"},
        tendons={"pitch_radius": "11 mm"},
    ),
}


@pytest.mark.parametrize("name", SOFT_BUT_REAL)
def test_soft_but_real_robots_give_a_warning_of_a_thousandth_of_their_modulus_only(name):
    robot = robot_of(**SOFT_BUT_REAL[name])
    assert robot.warnings == ()
    softer = robot.segments[0].backbone.E / 1000
    (warning,) = robot.with_({"segments.0.backbone.E": softer}).warnings
    assert warning.startswith("segments[0].backbone.E = ") and "wind the backbone" in warning


def test_self_weight_buckling_of_the_uniform_column():
    """The exact critical length of a column under its own weight is (7.837 E I / q)^(1/3)."""
    column = robot_of(backbone={"E": "1 GPa"}, disks={"mass": 0}).with_({"gravity": "0 0 -9.81"})
    q = float(column.mass_per_length[0]) * 9.81
    critical = (7.837 * float(column.bending_stiffness[0]) / q) ** (1 / 3)
    for factor, count in ((0.97, 0), (1.05, 1)):
        found = column.with_({"segments.0.length": factor * critical}).warnings
        assert len([w for w in found if "buckles" in w]) == count


def test_buckling_of_a_column_split_into_segments_is_that_of_the_whole():
    whole = load_robot("amouri2019", {"gravity": "0 0 -9.81", "segments.0.disks.mass": 0})
    part = whole.model_dump(mode="json", exclude_none=True)["segments"][0]
    part["length"] /= 2
    halves = whole.with_({"segments": [part, part]})

    def ratio(robot):
        paths = {f"segments.{k}.backbone.E": "100 kPa" for k in range(len(robot.segments))}
        (text,) = [w for w in robot.with_(paths).warnings if "buckles" in w]
        return re.search(r"weight, (\S+) times", text).group(1)

    assert ratio(whole) == ratio(halves)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("segments.0.disks.mass", "20 kg", ["disks.mass = 20 kg", "is the mass in g?"]),
        ("segments.0.disks.mass", "20 mg", ["disks.mass = 0.02 g", "is the mass in kg?"]),
        ("segments.0.backbone.density", "1.8 kg/m^3", ["density = 1.8 kg/m^3", "g/cm^3"]),
        ("segments.0.backbone.density", "90000 kg/m^3", ["density = 90000 kg/m^3"]),
        ("segments.0.length", "641 m", ["length = 641 m ", "(m, mm)"]),
        ("segments.0.backbone.E", "3.5 TPa", ["E = 3500 GPa", "stiffer than diamond"]),
        ("segments.0.backbone.diameter", "5 cm", ["diameter = 50 mm", "less than a degree"]),
        ("segments.0.backbone.G", "13 MPa", ["G = 13 MPa", "E = 35 GPa", "nu ="]),
        ("segments.0.disks.thickness", "80 mm", ["disks.thickness = 80 mm", "overlap"]),
        ("gravity", "0 0 9810 m/s^2", ["gravity = 9810 m/s^2", "mm/s^2"]),
    ],
)
def test_other_warnings_name_the_value(path, value, words):
    text = "\n".join(load_robot("amouri2019", {path: value}).warnings)
    for word in words:
        assert word in text


def test_thick_disks_need_a_clamped_length():
    """With 3 mm the tip of the study's robot is 16 mm elsewhere at 80 N."""
    path = "segments.0.disks.clamped_length"
    for robot in (
        load_robot("amouri2019", {path: None}),
        load_robot("amouri2019", {path: None}).with_({"segments.0.backbone.E": "34 GPa"}),
    ):
        (warning,) = robot.warnings
        assert warning.startswith("segments[0].disks.clamped_length: missing")
        assert "thickness of 3 mm would clamp 4.2 % of it" in warning and "0 mm if none" in warning
        assert robot.with_({path: "0 mm"}).warnings == robot.with_({path: "3 mm"}).warnings == ()
    thin = load_robot("amouri2019", {path: None, "segments.0.disks.thickness": "1 mm"})
    assert thin.warnings == ()


SILICONE = robot_of(
    length="400 mm",
    backbone={"diameter": "20 mm", "E": "1 MPa", "density": 1070},
    disks={"count": 10, "mass": "30 g", "thickness": "5 mm"},
    tendons={"pitch_radius": "25 mm"},
).with_({"gravity": "0 0 9.80665"})


@pytest.mark.parametrize("friction", [0, 0.1])
def test_a_load_without_a_solution_names_its_likely_cause(friction):
    """A doubtful modulus if there is one, otherwise the bend that the load would cause."""
    overrides = {"segments.0.tendons.friction": friction}
    soft = load_robot("amouri2019", {"segments.0.backbone.E": "60 MPa", **overrides})
    said = bs.solve(soft, [80, 0, 0]).message
    assert "segments[0].backbone.E = 60 MPa looks too small (GPa, not MPa?)" in said
    # a thousand times this modulus is no material: its unit is not the cause
    thin = {"segments.0.backbone.diameter": "0.2 mm", "segments.0.backbone.E": "30 GPa"}
    said = bs.solve(load_robot("amouri2019", {**thin, **overrides}), [80, 0, 0]).message
    assert "By the linear law these tensions would bend" in said and "GPa" not in said
    silicone = SILICONE.with_(overrides)
    assert silicone.warnings == ()
    for said in (
        bs.solve(silicone, [10, 0, 0]).message,
        bs.sweep(silicone, [[0, 0, 0], [10, 0, 0]]).message(1),
    ):
        assert "By the linear law these tensions would bend amouri2019 by 730 degrees." in said
        assert "GPa" not in said
    # equal tensions bend nothing: no cause is named
    balanced = bs.solve(load_robot("amouri2019", overrides), [1000, 1000, 1000]).message
    assert "GPa" not in balanced and "linear law" not in balanced


# --- identity, copies, speed ----------------------------------------------------------


def test_hash_is_that_of_the_physics_only(load):
    robot = load_robot("amouri2019")
    # a fixed value: it must not change with Python's version or the platform
    assert robot.hash == "5dfffc5e318180783a513699e998397e58cf37ce11233613eed1c7fa98a8e9d5"
    same = {
        "name": "other",
        "description": "x",
        "segments.0.name": "y",
        "segments.0.length": "64.1 cm",
        "gravity": [-0.0, 0.0, -0.0],
        "segments.0.tendons": [
            {"angle": t.angle, "pitch_radius": t.pitch_radius}
            for t in robot.segments[0].tendon_list
        ],
        "segments.0.disks.positions": list(robot.segments[0].disk_positions),
        "segments.0.backbone.G": robot.segments[0].backbone.shear_modulus,
    }
    assert robot.with_(same).hash == robot.hash
    tree = yaml.safe_load(AMOURI)
    for part in (tree, tree["segments"][0], tree["segments"][0]["backbone"]):
        items = list(part.items())
        part.clear()
        part.update(reversed(items))
    assert load(yaml.safe_dump(tree, sort_keys=False)).hash == robot.hash


def test_every_physical_field_changes_the_hash():
    robot = load_robot("amouri2019")
    hashes = {robot.hash}
    changes = {
        "gravity": "0 0 1",
        "segments.0.length": "642 mm",
        "segments.0.backbone.diameter": "5.1 mm",
        "segments.0.backbone.inner_diameter": "1 mm",
        "segments.0.backbone.E": "36 GPa",
        "segments.0.backbone.nu": 0.31,
        "segments.0.backbone.density": 1801,
        "segments.0.disks.count": 10,
        "segments.0.disks.mass": "21 g",
        "segments.0.disks.radius": "33 mm",
        "segments.0.disks.thickness": "4 mm",
        "segments.0.disks.clamped_length": "1 mm",
        "segments.0.tendons.count": 4,
        "segments.0.tendons.pitch_radius": "28 mm",
        "segments.0.tendons.first_angle": "1 deg",
    }
    for name, (_, value, _, absent) in DRIVE.items():
        changes[f"segments.0.tendons.{name}"] = value
        if absent == 0:
            same = robot.with_({f"segments.0.tendons.{name}": -0.0})
            assert same.hash == robot.hash  # the hash from before there were tendon properties
    for path, value in changes.items():
        hashes.add(robot.with_({path: value}).hash)
    assert len(hashes) == len(changes) + 1


def test_a_robot_is_immutable():
    robot = load_robot("amouri2019")
    with pytest.raises(ValueError, match="frozen"):
        robot.name = "x"
    with pytest.raises(ValueError, match="frozen"):
        robot.segments[0].length = 1.0
    for array in (robot.disks.station_m, robot.tendons.hole_m, robot.bending_stiffness):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_core_is_built_once_and_not_copied(monkeypatch):
    import bowstring._core

    class Core:
        def __init__(self, robot):
            self.robot = robot

        def __reduce__(self):
            raise TypeError("cannot be pickled")

    monkeypatch.setattr(bowstring._core, "Robot", Core, raising=False)
    robot = load_robot("rao2021", {"gravity": "0 0 -9.81"})
    assert robot.core is robot.core and robot.core.robot is robot
    for twin in (
        pickle.loads(pickle.dumps(robot)),
        copy.copy(robot),
        copy.deepcopy(robot),
        robot.with_({}),
    ):
        assert twin == robot and twin.hash == robot.hash
        assert twin.core is not robot.core
    assert robot.with_({"segments.0.length": 0.3}).disks.station_m[9] == 0.3


def test_common_units_do_not_load_pint():
    code = (
        "import sys; from bowstring import load_robot;"
        "load_robot('amouri2019').warnings; "
        f"load_robot({str(ROOT / 'examples' / 'my_robot.yaml')!r}).hash; "
        "sys.exit('pint' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- JSON Schema ----------------------------------------------------------------------


def test_schema_is_valid_and_accepts_the_robots():
    schema = robot_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    json.dumps(schema)
    for path in (*BUILT_IN.glob("*.yaml"), ROOT / "examples" / "my_robot.yaml"):
        jsonschema.validate(yaml.safe_load(path.read_text(encoding="utf-8")), schema)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("200 mm", "641"),
        ("200 mm", "mm"),
        ("0.3", "0.3 mm"),
        ("count: 4", "count: 0"),
        ("count: 4", "count: 4, colour: red"),
        ("nu: 0.3", "nu: 0.3, G: 20 GPa"),
        ("segments:", "gravity: 0 0 m/s^2\nsegments:"),
        ("12 mm", "12 mm, friction: -0.1"),
        ("12 mm", "12 mm, friction: 0.1 N"),
        ("12 mm", "12 mm, axial_stiffness: 20000"),
    ],
)
def test_schema_refuses(old, new):
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(yaml.safe_load(changed(old, new)), robot_schema())


def test_schema_examples_are_good_and_fields_described():
    schema = robot_schema()
    parts = {"": schema, **schema["$defs"]}
    for name, part in parts.items():
        assert part["description"] and "\n" not in part["description"]
        for field, content in part["properties"].items():
            if "$ref" in content or "oneOf" in content or field == "segments":
                continue
            assert content.get("description"), (name, field)
            for example in content.get("examples", []):
                jsonschema.validate(example, content)


def test_a_part_omitted_in_the_file_can_be_set() -> None:
    changed = load_robot("amouri2019").with_({"gravity.2": -9.81})
    assert changed.gravity == (0.0, 0.0, -9.81)


@pytest.mark.parametrize(
    "call",
    [
        lambda: bs.run_study("amouri2019"),
        lambda: bs.check_tendons("amouri2019", None),
        lambda: bs.read_measurements(ROOT / "examples" / "bench.csv", "amouri2019"),
        lambda: bs.constant_curvature.RobotArcs.from_lengths("amouri2019", [1, 2, 3]),
        lambda: bs.fem.check("amouri2019"),
        lambda: bs.load_robot(None),
        lambda: bs.load_robot(3),
    ],
)
def test_non_robots_are_refused_in_a_sentence(call: Callable[[], object]) -> None:
    with pytest.raises(InputError, match=r"^robot is .*, it must be "):
        call()


@pytest.mark.parametrize("overrides", [None, [1], "x", 3])
def test_overrides_are_a_mapping(overrides: object) -> None:
    with pytest.raises(InputError, match=r"^overrides is .*, it must be a mapping"):
        load_robot("amouri2019").with_(overrides)


def test_modules_of_the_data_are_attributes() -> None:
    code = "import bowstring as bs; bs.data.registration, bs.data.synthetic, bs.data.datasets"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    "part",
    [Robot, Backbone, Disks, Payload, Segment, Tendon, TendonRing],
)
def test_the_docstring_of_a_part_has_all_of_its_fields(part: type[Part]) -> None:
    said = re.findall(r"(?m)^(\w+) : ", inspect.cleandoc(part.__doc__ or ""))
    assert said == list(part.model_fields)
