"""Chains of rigid links: MJCF and URDF models, beside MuJoCo, the rod and independent readers."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.errors import InputError, NoSolutionError
from bowstring.integrations.rigid_links.chain import LinkChain
from bowstring.integrations.rigid_links.mjcf import write_mjcf
from bowstring.integrations.rigid_links.urdf import write_urdf
from bowstring.integrations.rigid_links.xml_file import joint_names
from objects import refused
from shell import Shell


def tip_error(chain: LinkChain, load: bs.Load) -> float:
    rod = bs.solve(chain.robot, load=load)
    assert rod.tip is not None
    return float(np.linalg.norm(chain.pose(chain.solve(load)).tip - rod.tip.position))


# -- the chain -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("robot", "load", "most", "better"),
    [
        (bs.load_robot("amouri2019"), bs.Load([90.0, 0, 0]), 4e-4, 50),
        (bs.load_robot("rao2021"), bs.Load([8.0, *[0.0] * 5]), 4e-4, 50),
        (
            bs.load_robot("amouri2019", {"gravity": [3.0, 0.0, -9.0]}),
            bs.Load([40.0, 10.0, 0.0], tip_force=[0.0, 1.0, -0.5], tip_moment=[0.0, 0.1, 0.2]),
            4e-4,
            1,
        ),
        (
            bs.load_robot(
                "amouri2019",
                {
                    "segments.0.disks.clamped_length": "6 mm",
                    "segments.0.disks.hole_length": "4 mm",
                    "payloads": [{"mass": "80 g", "centre": ["10 mm", "0 mm", "20 mm"]}],
                    "gravity": [0.0, 0.0, -9.81],
                },
            ),
            bs.Load([50.0, 0.0, 20.0]),
            5e-4,
            1,
        ),
    ],
    ids=["amouri2019", "rao2021", "out of the plane", "clamps, planes and payload"],
)
def test_two_joints_a_module_are_close_to_the_rod(
    robot: bs.Robot, load: bs.Load, most: float, better: float
) -> None:
    one, two, four = (tip_error(LinkChain(robot, n), load) for n in (1, 2, 4))
    assert four < two < most * robot.length < one and one > better * two


def test_the_sum_of_masses_is_that_of_the_robot() -> None:
    robot = bs.load_robot("amouri2019", {"payloads": [{"mass": "80 g", "centre": [0.01, 0, 0.02]}]})
    chain = LinkChain(robot, 2)
    sections = robot.sections[0][0]
    # the backbone before the first joint is fixed to the base
    backbone = sections[6] * (robot.length - chain.stations[0])
    total = backbone + robot.disks.mass_kg.sum() + 0.08
    assert sum(body.mass for body in chain.bodies) == pytest.approx(total)


def test_springs_in_series_are_the_flexibility_of_the_free_backbone() -> None:
    robot = bs.load_robot("amouri2019", {"segments.0.disks.clamped_length": "6 mm"})
    for joints in (1, 2, 6):
        chain = LinkChain(robot, joints)
        free = robot.length - 6e-3 * (len(robot.disks.station_m) - 0.5)
        bend = free / robot.sections[0][0][0]
        np.testing.assert_allclose((1.0 / chain.stiffness[:, 1]).sum(), bend, rtol=1e-9)


def test_angles_of_a_solution_turn_the_disks_as_the_rod() -> None:
    robot = bs.load_robot("crl-ftdcr-v4")
    rod = bs.solve(robot, np.linspace(0.0, 3.0, len(robot.tendons.segment)))
    assert rod.disk_rotations is not None and rod.tip is not None
    for joints in (1, 2, 4):
        chain = LinkChain(robot, joints)
        pose = chain.pose(chain.angles_of(rod))
        disks = pose.rotation[joints - 1 :: joints]
        np.testing.assert_allclose(disks, rod.disk_rotations, atol=1e-12)
        assert np.linalg.norm(pose.tip - rod.tip.position) < 1e-3 * robot.length


def test_moments_are_the_slope_of_an_energy() -> None:
    """Springs, tendons and weights are conservative: the matrix of slopes is symmetric at rest."""
    from bowstring.integrations.rigid_links import chain as module

    robot = bs.load_robot("amouri2019", {"gravity": [3.0, 0.0, -9.0]})
    chain = LinkChain(robot, 2)
    forces = module._Forces(
        np.array([40.0, 10.0, 0.0]), np.array([3.0, 0, -9.0]), np.array([0.0, 1.0, 0]), np.zeros(3)
    )

    def energy(q: Floats) -> float:
        pose = chain.pose(q)
        total = 0.5 * float((chain.stiffness * q**2).sum()) - float(pose.tip @ forces.tip)
        for b, body in enumerate(chain.bodies):
            centre = pose.joint[b] + pose.rotation[b] @ body.centre
            total -= body.mass * float(centre @ forces.gravity)
        for tension, path in zip(forces.tensions, chain.tendon_points, strict=True):
            places = [p if b < 0 else pose.joint[b] + pose.rotation[b] @ p for b, p in path]
            total += tension * float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
        return total

    q = np.random.default_rng(3).normal(0.0, 0.1, chain.stiffness.shape)
    found = chain._moments(q, forces, 1.0)
    step = 1e-6
    for b, k in ((0, 0), (0, 2), (3, 1), (9, 0), (17, 2), (17, 1)):
        change = np.zeros_like(q)
        change[b, k] = step
        slope = (energy(q + change) - energy(q - change)) / (2.0 * step)
        assert found[b, k] == pytest.approx(slope, abs=2e-7)


# -- MuJoCo --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["amouri2019", "rao2021", "crl-ftdcr-v4"])
def test_mujoco_finds_the_same_equilibrium(name: str, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo")
    robot = bs.load_robot(name, {"gravity": [0.0, -9.81, 0.0]})
    tensions = np.zeros(len(robot.tendons.segment))
    tensions[0] = {"amouri2019": 80.0, "rao2021": 6.0, "crl-ftdcr-v4": 10.0}[name]
    load = bs.Load(tensions)
    chain = LinkChain(robot, 2)
    file = write_mjcf(chain, tmp_path / "robot.xml", load=load)
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("loaded").id)
    mujoco.mj_forward(model, data)
    tip = chain.pose(chain.solve(load)).tip
    np.testing.assert_allclose(data.site("tip").xpos, tip, atol=1e-9)
    rest = data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias
    assert abs(rest).max() < 1e-8 * chain.stiffness.min() + 1e-9
    # and it stays there
    for _ in range(100):
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.site("tip").xpos, tip, atol=1e-6 * robot.length)
    weights = model.body_mass.sum()
    assert weights == pytest.approx(sum(body.mass for body in chain.bodies), rel=1e-6)


def test_mujoco_moves_it_in_stable_steps(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo")
    robot = bs.load_robot("amouri2019")
    chain = LinkChain(robot, 2)
    file = write_mjcf(chain, tmp_path / "robot.xml", damping_time=0.05)
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    data.ctrl[:] = [60.0, 0.0, 0.0]
    while data.time < 4.0:
        mujoco.mj_step(model, data)
    tip = chain.pose(chain.solve(bs.Load([60.0, 0.0, 0.0]))).tip
    np.testing.assert_allclose(data.site("tip").xpos, tip, atol=1e-4 * robot.length)


# -- URDF ----------------------------------------------------------------------------------------


def test_urdf_poses_are_those_of_the_chain(tmp_path: Path) -> None:
    """Read with nothing but the rules of URDF."""
    robot = bs.load_robot("amouri2019")
    chain = LinkChain(robot, 2)
    root = ET.parse(write_urdf(chain, tmp_path / "robot.urdf")).getroot()
    angles = np.random.default_rng(1).normal(0.0, 0.1, chain.stiffness.shape)
    names = [name for row in joint_names(chain) for name in row]
    values = dict(zip(names, angles.ravel(), strict=True))

    def numbers(element: Any, key: str) -> Floats:
        return np.array([float(x) for x in element.get(key).split()])

    links = {link.get("name") for link in root.iter("link")}
    joints = {j.find("parent").get("link"): j for j in root.iter("joint")}  # type: ignore[union-attr]
    place, turned, at = np.zeros(3), np.eye(3), "base"
    while at in joints:
        joint: Any = joints.pop(at)
        place = place + turned @ numbers(joint.find("origin"), "xyz")
        if joint.get("type") == "revolute":
            axis = numbers(joint.find("axis"), "xyz")
            turned = turned @ Rotation.from_rotvec(values[joint.get("name")] * axis).as_matrix()
        at = joint.find("child").get("link")
        assert at in links
    assert at == "tip" and not joints
    np.testing.assert_allclose(place, chain.pose(angles).tip, atol=1e-9)
    masses = [float(m.get("value", "")) for m in root.iter("mass")]
    assert sum(masses) == pytest.approx(sum(b.mass for b in chain.bodies), rel=1e-6)


# -- the command, and what it refuses ------------------------------------------------------------


def test_export_states_its_tip_error(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "robot.xml"
    code, out, err = shell("export", "amouri2019", "--out", str(file), "--tension", "80,0,0")
    assert code == 0 and not err and "18 joints of three hinges" in out and "simulated" in out
    found = shell.json("export", "amouri2019", "--out", str(file), "--tension", "80,0,0")
    chain = LinkChain(bs.load_robot("amouri2019"), 2)
    assert found["tip_error_m"] == pytest.approx(tip_error(chain, bs.Load([80.0, 0.0, 0.0])))
    assert found["format"] == "MJCF" and ET.parse(file).getroot().tag == "mujoco"
    urdf = shell.json("export", "rao2021", "--out", str(tmp_path / "robot.urdf"), "--joints", "1")
    assert urdf["format"] == "URDF" and 0 < urdf["tip_error_m"] < 1e-3
    assert json.dumps(urdf["tensions_N"])


def test_export_refuses(shell: Shell, tmp_path: Path) -> None:
    mine = tmp_path / "mine.xml"
    mine.write_text("<mine/>")
    for words, message in (
        (
            ["--out", str(tmp_path / "robot.sdf")],
            ".xml or .urdf (rigid links for MuJoCo, for viewers)",
        ),
        (["--out", str(mine)], "mine.xml"),
        (["--out", str(tmp_path / "none" / "robot.xml")], "does not exist"),
        (["--out", str(tmp_path / "a.xml"), "--joints", "3"], "it must be 1 or an even number"),
        (["--out", str(tmp_path / "a.xml"), "--tension", "1,2"], "--tension"),
        (["--out", str(tmp_path / "a.xml"), "--set", "friction=0.1"], "friction"),
    ):
        code, out, err = shell("export", "amouri2019", *words)
        assert code == 2 and not out and message in " ".join(err.split()), (words, err)
    assert mine.read_text() == "<mine/>" and sorted(tmp_path.iterdir()) == [mine]


def test_what_links_cannot_express_is_refused() -> None:
    robot = bs.load_robot("amouri2019")
    with pytest.raises(InputError, match="bent without load"):
        LinkChain(robot.with_({"segments.0.backbone.rest_bend": "20 deg"}))
    chain, other = LinkChain(robot), bs.solve(bs.load_robot("rao2021"), [1.0] * 6)
    displaced = bs.Load(displacements=[0.01, 0.0, 0.0])
    refused("takes tensions, gravity", lambda: chain.solve(displaced))
    refused("3 finite numbers, none negative", lambda: chain.solve(bs.Load([-1.0, 0.0, 0.0])))
    refused(r"must end in \(18, 3\)", lambda: chain.pose(np.zeros((18, 2))))
    refused("one of amouri2019 with a pose", lambda: chain.angles_of(other))
    refused("up to 400 are possible", lambda: LinkChain(bs.load_robot("crl-ftdcr-v4"), 32))


def test_a_load_without_equilibrium_is_said() -> None:
    with pytest.raises(NoSolutionError, match="it buckles"):
        LinkChain(bs.load_robot("amouri2019"), 2).solve(bs.Load([1e5, 1e5, 1e5]))


def test_names_cannot_inject(tmp_path: Path) -> None:
    robot = bs.load_robot("amouri2019").with_({"name": 'a"><x>&'})
    chain = LinkChain(robot, 1)
    assert ET.parse(write_mjcf(chain, tmp_path / "r.xml")).getroot().get("model") == 'a"><x>&'
    assert ET.parse(write_urdf(chain, tmp_path / "r.urdf")).getroot().get("name") == 'a"><x>&'
