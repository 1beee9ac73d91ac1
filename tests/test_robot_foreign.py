"""Robot files from parameter files of other programs; the files here are in their formats."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bowstring.errors import InputError
from bowstring.robot.draft import Draft
from bowstring.robot.foreign import convert
from bowstring.robot.foreign.values import cpp, matlab, python
from bowstring.robot.model import Robot
from bowstring.robot.reader import robot_of_text

Converted = Callable[[str, str], tuple[Draft, Robot]]


@pytest.fixture
def converted(tmp_path: Path) -> Converted:
    """Convert a text under a file name."""

    def convert_text(name: str, text: str) -> tuple[Draft, Robot]:
        (tmp_path / name).write_text(text)
        draft = convert(tmp_path / name)
        return draft, robot_of_text(draft.text, name)

    return convert_text


PARAMETERS = """
% two sections, 8 disks in all
n = [5;3]; n_disk = sum(n);
L = [150e-3; 90e-3]; % m
l = [L(1)/n(1)*ones(1,n(1)) L(2)/n(2)*ones(1,n(2))];
r_disk = 8*1e-3;
r1 = [r_disk 0 0 1]'; r2 = [r_disk*cos(2*pi/3) r_disk*sin(2*pi/3) 0 1]';
r3 = [-r_disk 0 0 1]'; r4 = [0 -r_disk ...
   0 1]';
p_tendon = [r1 r2 r3 r4];
E = 50*10^9; nu = 0.31; G = E/(2*(1+nu));
ro = 1.2/2*10^-3; ri = 0.2e-3;
g = 0; %9.81
m_bb = 0.007*l*g;
m_disk = 0.4*1e-3*ones(1,n_disk)*g;
"""


def test_matlab_parameters_of_tdcr_modeling(converted: Converted) -> None:
    draft, robot = converted("two.m", PARAMETERS)
    inner, outer = robot.segments
    assert [s.length for s in robot.segments] == [0.15, 0.09]
    assert [s.disks.count for s in robot.segments] == [5, 3]
    assert (inner.backbone.diameter, inner.backbone.inner_diameter) == (1.2e-3, 0.4e-3)
    assert (inner.backbone.E, inner.backbone.nu) == (50e9, 0.31)
    # masses although g is 0: 7 g/m of backbone, 0.4 g a disk
    np.testing.assert_allclose(robot.mass_per_length, 0.007, rtol=1e-11)
    assert outer.disks.mass == 0.4e-3
    np.testing.assert_allclose(np.degrees(robot.tendons.angle_rad), [0, 120, 180, -90], atol=1e-9)
    assert robot.tendons.segment.tolist() == [0, 0, 1, 1]
    assert robot.gravity == (0, 0, 0)
    assert draft.assumed == ["disk radius 9.6 mm", "disk thickness 0 mm", "clamped length 0 mm"]


def test_gravity_of_tdcr_modeling_presses_on_the_base(converted: Converted) -> None:
    _, robot = converted("two.m", PARAMETERS.replace("g = 0;", "g = 9.81;"))
    assert robot.gravity == (0, 0, -9.81)
    np.testing.assert_allclose(robot.mass_per_length, 0.007, rtol=1e-11)  # not its weight


def test_weights_without_g_are_no_masses(converted: Converted) -> None:
    text = PARAMETERS.replace("*ones(1,n_disk)*g", "*9.81*ones(1,n_disk)")
    draft, _ = converted("two.m", text)
    assert "disk mass 0 g" in draft.assumed


CALL = """
#include "tendondrivenrobot.h" // std::array<double,2> length
int main() {
    TendonDrivenRobot robot;
    std::array<double,2> length = {0.12, 0.08};
    double young = 55*1e9; /* Pa
    double ro = 1; */
    std::array<int,2> disks; disks[0] = 6; disks[1] = 4;
    std::array<double,2> pitch; pitch[0] = 7e-3; pitch[1] = 7*1e-3;
    std::vector<Eigen::Vector3d> routing;
    Eigen::Vector3d t;
    t << 0, pitch[0], 0;                              routing.push_back(t);
    t << pitch[0]*std::cos(-M_PI/6), pitch[0]*std::sin(-M_PI/6), 0; routing.push_back(t);
    routing.push_back(t);
    t << pitch[1], 0, 0;
    routing.push_back(t); routing.push_back(t); routing.push_back(t);
    robot.setRobotParameters(length,young,routing,disks,pitch,0.5*1e-3,false);
    Eigen::MatrixXd q; q << 4, 0, 0, 0, 2, 0;
}
"""


def test_call_of_tdcr_modeling(converted: Converted) -> None:
    draft, robot = converted("main.cpp", CALL)
    assert [s.length for s in robot.segments] == [0.12, 0.08]
    assert [s.disks.count for s in robot.segments] == [6, 4]
    backbone = robot.segments[1].backbone
    assert (backbone.diameter, backbone.E, backbone.nu) == (1e-3, 55e9, 0.3)
    np.testing.assert_allclose(np.degrees(robot.tendons.angle_rad), [90, -30, -30, 0, 0, 0])
    assert "density 0 kg/m^3" in draft.assumed and "disk mass 0 g" in draft.assumed


MATERIAL = {
    "density": 7000,
    "youngs_modulus": 40e9,
    "poisson_ratio": 0.32,
    "inner_radius": 0.0002,
    "outer_radius": 0.0006,
}
RING = {"number_of_tendons": 3, "distance_to_backbone": 0.005}
CONFIGURATION: dict[str, Any] = {
    "_comment": "ignored",
    "num_segments": 2,
    "links_per_segment": {"1": 8, "2": 6},
    "segment_lengths": {"1": 0.07, "2": 0.05},
    "radius": 0.006,
    "joint_config_mode": "material",
    "material_properties": MATERIAL,
    "actuation_mode": "parallel_tendons",
    "actuation_details": {"segments": [RING, {**RING, "number_of_tendons": 4}]},
    "seg_offsets": [0.1, -3.0],
    "tendon_angle_deltas": [[0.0, 0.02, -0.03]],
    "gravity": "0 0 -9.81",
}


def test_configuration_of_opencr_mujoco(converted: Converted) -> None:
    draft, robot = converted("two.json", json.dumps(CONFIGURATION))
    assert [s.length for s in robot.segments] == [0.07, 0.05]
    assert [s.disks.count for s in robot.segments] == [8, 6]
    backbone = robot.segments[0].backbone
    assert (backbone.diameter, backbone.inner_diameter, backbone.E) == (1.2e-3, 0.4e-3, 40e9)
    third, quarter = 2 * np.pi / 3, np.pi / 2
    expected = [0.1, 0.1 + third + 0.02, 0.1 + 2 * third - 0.03, *(-3 + quarter * np.arange(4))]
    turned = np.exp(1j * (robot.tendons.angle_rad - expected))
    np.testing.assert_allclose(turned, 1.0, atol=1e-10)
    assert robot.segments[1].disks.mass == 0 and robot.segments[1].disks.radius == 0.006
    assert robot.gravity == (0, 0, -9.81) and "mounting is not read" in draft.text
    assert "pretension" in draft.notes[0]


def test_modules_of_opencr_mujoco_are_segments(converted: Converted) -> None:
    def module(young: float, length: float) -> dict[str, Any]:
        material = {**MATERIAL, "youngs_modulus": young}
        return {"length": length, "radius": 0.01, "num_links": 4, "material_properties": material}

    tree = {
        "modular": True,
        "module_library": {"stiff": module(200e9, 0.04), "soft": module(50e9, 0.03)},
        "segments": [
            {"modules": ["stiff", "soft"], "actuation": RING},
            {"modules": ["soft"], "actuation": RING},
        ],
        "actuation_mode": "parallel_tendons",
        "gravity": "0 0 0",
    }
    _, robot = converted("modules.json", json.dumps(tree))
    assert [s.backbone.E for s in robot.segments] == [200e9, 50e9, 50e9]
    assert [s.length for s in robot.segments] == [0.04, 0.03, 0.03]
    assert robot.tendons.segment.tolist() == [1, 1, 1, 2, 2, 2]  # none ends within a segment


def test_evaluation_of_opencr_mujoco_is_a_bare_rod(converted: Converted) -> None:
    rod = {
        "joint_config_mode": "material",
        "material_properties": MATERIAL,
        "actuation_mode": "none",
        "gravity": "0 -9.81 0",
        "total_length": 0.5,
    }
    _, robot = converted("rod.json", json.dumps({"generator_config": rod, "n_values": [25]}))
    assert robot.length == 0.5 and len(robot.tendons.angle_rad) == 0
    assert robot.gravity == (0, -9.81, 0)


SCRIPT = """
import jax.numpy as jnp
pattern = "\\d"
def unused(): return LinkSpec(E=1.0)
if __name__ == "__main__":
    first = LinkSpec(E=3e5, nu=0.45, rho=1200.0, eta=1e4, L=0.1 + 0.15, r_i=0.012, r_f=0.008)
    last = LinkSpec(E=3e5, nu=0.45, rho=1200.0, eta=1e4, L=0.05, r_i=0.008, r_f=0.006)
    angles = jnp.deg2rad(jnp.array([20.0, 160.0]))
    way = jnp.stack((jnp.zeros_like(angles), jnp.cos(angles), jnp.sin(angles)), axis=-1)
    routing = ThreadlikeRouting.linear(
        intercept=0.009 * way, slope=-0.016 * way, end_segment_index=(0, 0)
    )
    segments = [GVSSegment(link=first, joint=j), GVSSegment(link=last, joint=j)]
    robot = GVS.from_segments(
        segments,
        gravity=jnp.asarray([0.5, 0.0, -9.81]),
        base_pose=jnp.array([jnp.sqrt(0.5), 0.0, jnp.sqrt(0.5), 0.0, 0.0, 0.0, 0.0]),
        actuators=ThreadlikeActuator.tendons(routing),
    )
"""


def test_links_of_soromox(converted: Converted) -> None:
    draft, robot = converted("hanging.py", SCRIPT)
    body, tail = (s.backbone for s in robot.segments)
    assert [s.length for s in robot.segments] == [0.25, 0.05]
    assert (body.diameter, body.end_diameter) == (0.024, 0.016)
    assert (tail.diameter, tail.end_diameter) == (0.016, 0.012)
    assert (body.E, body.nu, body.density) == (3e5, 0.45, 1200)
    one, other = robot.segments[0].tendon_list
    np.testing.assert_allclose(np.degrees([one.angle, other.angle]), [20, 160])
    assert one.pitch_radius == 0.009
    assert one.end_pitch_radius == pytest.approx(0.009 - 0.016 * 0.25)
    assert robot.is_embedded and not robot.segments[1].tendon_list
    # its x, along the backbone, points down, and its z along x of the world
    assert robot.gravity == (0, 0.5, 9.81)
    assert draft.assumed == []


BODIES = """
n = 2
size = 0.03 * jnp.ones((n,))
params = PCSParams(
    length=0.1 * jnp.ones((n,)), radius=size, density=1070 * jnp.ones((n,)),
    young_modulus=2e4, shear_modulus=jnp.array([8e3, 7e3]),
)
table = {"y": jnp.array([0.01, 0.0]), "end": jnp.array([1, 0])}
routing = ThreadlikeRouting.linear(
    intercept=jnp.stack((jnp.zeros(2), table["y"], 0.02 * jnp.ones(2)), axis=-1),
    end_segment_index=tuple(int(i) for i in table["end"]),
)
robot = PCS(params=params, actuators=ThreadlikeActuator.tendons(routing))
"""
LISTS = """
sizes, links = jnp.array([0.02, 0.01]), []
tail: LinkSpec = LinkSpec.circular(length=0.1, radius=0.01, density=1000, young_modulus=1e6)
links.append(LinkSpec.circular(
    length=0.1, radius=LinearProfile(base=float(sizes[0]), tip=float(sizes[1])),
    density=1000.0, young_modulus=1e6, shear_modulus=4e5,
))
links.append(tail)
robot = GVS.from_segments([GVSSegment(link=a, joint=b) for a, b in zip(links, [1, 2])])
"""


def test_other_scripts_of_soromox(converted: Converted) -> None:
    draft, robot = converted("pcs.py", BODIES)
    assert [s.backbone.G for s in robot.segments] == [8e3, 7e3]
    assert robot.tendons.segment.tolist() == [0, 1]
    assert draft.notes[1] == "Tendons 1 to 2 are tendons 2, 1 of the script."
    np.testing.assert_allclose(np.tan(robot.tendons.angle_rad[1]), 2.0)
    assert robot.gravity == (0, 0, -9.81)  # upright, its default
    assert draft.assumed == ["gravity 0 0 -9.81 m/s^2"]
    draft, robot = converted("gvs.py", LISTS)
    first, last = (s.backbone for s in robot.segments)
    assert (first.diameter, first.end_diameter, first.G) == (0.04, 0.02, 4e5)
    assert (last.diameter, last.end_diameter, last.nu) == (0.02, None, 0.5)
    assert "nu 0.5" in draft.assumed and not len(robot.tendons.angle_rad)


def without(name: str) -> str:
    return json.dumps({key: value for key, value in CONFIGURATION.items() if key != name})


def changed(**fields: Any) -> str:
    return json.dumps({**CONFIGURATION, **fields})


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("link.mat", "MATLAB 5.0", "SoRoSim is not converted; give the numbers"),
        ("links.m", "L1 = SorosimLink('empty'); L1.L = 0.3;", "--material NAME,E --diameter"),
        ("robot.urdf", "<robot/>", "cannot tell what it is"),
        ("two.m", " " * 100_001, "too long; keep only"),
        ("two.m", "L = [1 2", "cannot read n, L, p_tendon, E, ro"),
        ("two.m", PARAMETERS.replace("[5;3]", "[5;3;2]"), "disks of 3 and 4 tendons"),
        ("two.m", f"{PARAMETERS}\nif big\n ro = 2;\nend", "cannot read ro"),
        ("two.m", f"{PARAMETERS}\np_tendon = [1 2 3];", "p_tendon, which must have 4 rows"),
        ("two.m", f"{PARAMETERS}\nE = [1 2]; p_tendon = pi;", "cannot read E;"),
        ("two.m", PARAMETERS.replace("ri = 0.2e-3", "ri = ro"), "inner_diameter"),
        ("main.cpp", CALL.replace("{0.12, 0.08}", "{}"), "got lengths of 0 segments"),
        ("main.cpp", CALL.replace("0.5*1e-3", "pitch"), "no call of setRobotParameters"),
        ("main.cpp", CALL.replace("0.12", "atof(argv[1])"), "no call of setRobotParameters"),
        ("a.json", "{", "it is no JSON"),
        ("a.json", "[1]", "valid dictionary"),
        ("a.json", without("joint_config_mode"), "joint_config_mode is direct, it must be"),
        ("a.json", without("segment_lengths"), "it has no total_length"),
        ("a.json", without("actuation_details"), "it has no actuation_details"),
        ("a.json", changed(num_segments=3), "segment_lengths has no entry 3"),
        ("a.json", changed(num_segments=1e9), "num_segments must be"),
        ("a.json", changed(gravity="down"), "three numbers"),
        ("a.json", changed(seg_offsets=[0.1]), "seg_offsets has no entry 1"),
        ("a.json", changed(independent_segments=True), "not modelled"),
        ("a.json", json.dumps(CONFIGURATION).replace("7000", "NaN"), "density"),
        ("a.py", "x = (", "not valid Python"),
        ("a.py", "x = 1", "no robot whose links stand in the script"),
        ("a.py", "PCSParams(length=jnp.array([1, 2]))", "link 1: young_modulus: no number"),
        ("a.py", SCRIPT.replace("link=last", "link=measured()"), "no robot whose links"),
        ("a.py", SCRIPT.replace("segments,", "segments * 2,"), "no robot whose links"),
        ("a.py", SCRIPT.replace("r_f=0.008", "r_f=measured()"), "link 1: radius: no number"),
        ("a.py", SCRIPT.replace("rho=1200.0, ", ""), "link 1: density: no number"),
        ("a.py", SCRIPT.replace("-0.016", "-0.2"), "tendon 1 of ThreadlikeRouting.linear"),
        ("a.py", SCRIPT.replace("slope=-0.016 * way", "slope=0.1"), "turns about it"),
        ("a.py", SCRIPT.replace("(0, 0)", "(0, 2)"), "do not fit its links"),
        ("a.py", SCRIPT.replace("tendons(routing)", "muscles(routing)"), "actuators must be"),
        ("a.py", SCRIPT.replace("[0.5, 0.0, -9.81]", "read()"), "base_pose and gravity"),
    ],
)
def test_what_is_not_converted(converted: Converted, name: str, text: str, says: str) -> None:
    with pytest.raises(InputError) as caught:
        converted(name, text)
    assert says in str(caught.value) and name in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("two.m", PARAMETERS),
        ("main.cpp", CALL),
        ("two.json", json.dumps(CONFIGURATION)),
        ("a.py", SCRIPT),
    ],
)
def test_damaged_files_are_read_or_refused(converted: Converted, name: str, text: str) -> None:
    random = np.random.default_rng(3)
    refused = 0
    for _ in range(40):
        start, more = random.integers(len(text)), random.integers(1, 30)
        insert = random.choice(["", "(", "]", "'", "{", ";", "9e999", "-1", "@"])
        damaged = text[:start] + insert + text[start + more :]
        try:
            converted(name, damaged)
        except InputError:
            refused += 1
    assert refused


def found(values: Any) -> dict[str, Any]:
    """Numbers of the names of a script."""
    known = {name: value for name, value in values.names.items() if value is not None}
    return {name: np.ravel(known[name]).tolist() for name in known.keys() - {"pi", "M_PI"}}


def test_values_of_expressions() -> None:
    text = "a = [1 -2 +3]; b = [a(2), a']; c = 2^3/4; d = [1 2; 3 4]; e = d(2);\n%{\nc = 1;\n%}\n"
    assert found(matlab(text + "f = [-a(1) (c)]'; % = 3", "")) == {
        "a": [1, -2, 3],
        "c": [2],
        "d": [1, 2, 3, 4],
        "e": [3],  # by columns
        "f": [-1, 2],
    }
    text = "a = 2\nfor i in x:\n    a = 3\nb, c = 1, -2 ** 2\nd = [c] * 3\ne = [b]\n"
    assert found(python(text + "while b:\n    e.append(b)\nf = [b]\nf.sort()", "")) == {
        "b": [1],
        "c": [-4],
    }
    text = "double a = 1/2; double b = 1e-3/2; b2 = M_PI/4; c[0] = b; c[1] = 1; d = {1, 2};"
    assert found(cpp(text + "e = d; for (i = 0; i < 2; i++) { e.push_back(1); }", "")) == {
        "b": [5e-4],
        "b2": [np.pi / 4],
        "c": [5e-4, 1],
        "d": [1, 2],
    }


@pytest.mark.parametrize(
    "hostile",
    [
        "x = 9^9^9^9;",
        "x = 2; " + "x = x*x; " * 60,
        "x = [1 2]; " + "x = [x x]; " * 60,
        "x = ones(1, 1e9);",
        "x = " + "(" * 4000,
        "x = " + "-" * 4000 + "1;",
        "x = " + "1+" * 3000 + "1;",
        "x = 1/0;",
        "x = [1 2]*[3;4];",
        "x = 2^-3^2;",
        "x = [1 2]; x(1) = 3;",
        "x = (-8)^0.5;",
    ],
)
def test_hostile_expressions_have_no_value(hostile: str) -> None:
    assert "x" not in found(matlab(hostile, ""))


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (matlab, "x = 1;\n" * 9000),
        (cpp, "x.push_back(1); " * 5000),
        (python, "x = [1]\n" + "x = [x, x]\n" * 60),
        (python, "x = [[i for i in range(999)] for j in range(999)]"),
    ],
)
def test_long_work_is_refused(read: Callable[[str, str], Any], text: str) -> None:
    with pytest.raises(InputError, match=r"too much to compute; keep only the robot's parameters"):
        read(text, "a file")
