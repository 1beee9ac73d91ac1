"""What is refused, and in which words: a table for each border.

Robot file, arguments of loads, loads on a robot, calls that do not take a robot or load, histories,
and flags. Fields of the robot file that every robot has are in `test_robot.py`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.constant_curvature import RobotArcs
from bowstring.dynamics import modes, ramp
from bowstring.errors import InputError
from bowstring.fem import run as fem
from bowstring.robot.designs import Designs
from bowstring.robot.model import check_round
from bowstring.statics.design_sweeps import sweep_designs
from objects import refused
from shell import Shell

ROBOT = bs.load_robot("amouri2019")
TENSIONS = [40.0, 5.0, 10.0]


def of(part: str, **values: Any) -> dict[str, Any]:
    """Fields of a part of the first segment by their paths."""
    return {f"segments.0.{part}.{name}": value for name, value in values.items()}


# -- the robot file ----------------------------------------------------------------------------

MATERIAL = {"E": 1e9, "nu": 0.3, "density": 0.0}
STRIP = {"width": "8 mm", "height": "2 mm", **MATERIAL}
CONE = of("backbone", diameter="6 mm", end_diameter="3.5 mm")


def ring(**fields: Any) -> dict[str, Any]:
    """Two tendons, the first with these fields."""
    first = {"angle": "0 deg", "pitch_radius": "29 mm", **fields}
    return {"segments.0.tendons": [first, {"angle": "120 deg", "pitch_radius": "29 mm"}]}


def payload(**fields: Any) -> dict[str, Any]:
    return {"payloads": [fields]}


def matrix(*changes: tuple[int, int, Any], **fields: Any) -> dict[str, Any]:
    """A stiffness matrix with these entries, and other fields of the backbone."""
    stiffness: list[list[Any]] = np.diag([0.06, 0.09, 0.05, 900.0, 900.0, 1500.0]).tolist()
    for i, j, value in changes:
        stiffness[i][j] = value
    whole = {"stiffness": stiffness, "mass_per_length": "30 g/m", **fields}
    return {"segments.0.backbone": {k: v for k, v in whole.items() if v is not None}}


CROSSING = [
    {"angle": "0 deg", "pitch_radius": "20 mm", "turns": 0.25},
    {"angle": "90 deg", "pitch_radius": "20 mm"},
]
RELAXES = of("backbone", relaxation=0.3, second_relaxation=0.2)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        # sections
        (of("backbone", width="3 mm"), "diameter and width: both given"),
        (of("backbone", end_width="3 mm"), "end_width: given with diameter"),
        (of("backbone", inner_diameter="6 mm"), "must be smaller than the diameter"),
        (
            CONE | of("backbone", inner_diameter="4 mm"),
            "end_inner_diameter: got 4 mm; must be smaller than the diameter there, 3.5 mm",
        ),
        (of("backbone", end_diameter="80 mm"), "inside its backbone"),
        ({"segments.0.backbone": {"width": 0.01, **MATERIAL}}, "height: missing"),
        ({"segments.0.backbone": MATERIAL}, "diameter: missing"),
        (
            {"segments.0.backbone": {"width": 0.01, "height": 0.004, **MATERIAL}}
            | of("backbone", yield_strength="500 MPa"),
            "limits are for a round backbone",
        ),
        (of("backbone", strain_limit=0.0), "must be above 0 and at most 10"),
        # routing
        (of("tendons", turns=9.0), "1 of a turn between two disks"),
        (of("tendons", turns=4.4), "passes through the"),
        (ring(angles="10 20 deg"), "got 2 numbers; must have 9, one for each disk"),
        (ring(angles="10 deg", turns=1), "turns and angles: both given"),
        (
            ring(pitch_radii="20 mm", end_pitch_radius="20 mm"),
            "end_pitch_radius and pitch_radii: both given",
        ),
        (
            ring(pitch_radii="29 29 29 29 33 29 29 29 29 mm"),
            "got 33 mm, a hole outside its disk",
        ),
        (ring(end_pitch_radius="2 mm"), "got 2 mm, a hole inside its backbone"),
        (
            ring(end_pitch_radius="0 mm"),
            "got 0 mm, a hole inside its backbone; must be larger than",
        ),
        (
            ring(pitch_radius="2 mm", kind="chamber"),
            "2.5 mm; chambers in a soft body need tendons_in: body",
        ),
        (
            ring(pitch_radius="1.9 mm") | of("backbone", inner_diameter="3 mm"),
            "larger than the backbone's radius, 2.5 mm, or smaller than that of its bore, 1.5 mm",
        ),
        # a tube whose bore narrows: the wall meets the hole of a disk on the way
        (
            ring(pitch_radius="1 mm")
            | of("backbone", inner_diameter="4 mm", end_inner_diameter="1 mm"),
            "got 1 mm, a hole inside its backbone",
        ),
        (
            ring(pitch_radius="3 mm") | {"segments.0.backbone": STRIP},
            "got 3 mm, a hole inside its backbone; must be beside its section, 8 mm by 2 mm",
        ),
        (
            ring(angle="90 deg", pitch_radius="2 mm", angles=[1.57] * 8 + [-1.57])
            | {"segments.0.backbone": STRIP},
            "passes through the backbone on the way to disk 9",
        ),
        (
            ring(angle="90 deg", pitch_radius="2 mm")
            | {"segments.0.backbone": STRIP}
            | of("disks", density=1000.0, hole_diameter="1 mm"),
            "disks.density: the disks' hole for a rectangular backbone is taken as the circle",
        ),
        (ring(turns="nan"), "turns"),
        # in the last disk both have the same place: one hole for two tendons; before they overlap
        (
            {"segments.0.tendons": CROSSING} | of("disks", hole_diameter="3 mm", count=40),
            "they would meet each other",
        ),
        (of("disks", hole_length="-1 mm"), "hole_length"),
        (of("disks", hole_length="72 mm"), "leave no tendon free in the 71.22"),
        # payloads
        (payload(mass="-1 g"), "payloads[0].mass"),
        (payload(centre="0 0 1 mm"), "payloads[0].mass: missing"),
        (payload(mass="1 g", disk=10), "payloads[0].disk: got 10; the robot has 9 disks"),
        (payload(mass="1 g", disk=0), "payloads[0].disk"),
        (payload(mass="1 g", inertia="1 1 3 kg*mm^2"), "at most the sum of the other two"),
        (payload(mass="1 g", centre="0 0 mm"), "payloads[0].centre"),
        (payload(mass="1 g", colour="red"), "colour"),
        ({"payloads": 3}, "must be a list of payloads"),
        # laws
        (of("tendons", backlash="-1 mm"), "backlash"),
        (of("tendons", kind="rod", friction=0.1), "friction: given with kind rod, which pushes"),
        (of("tendons", kind="rod", hole_clearance="0.1 mm"), "hole_clearance: given with kind rod"),
        (of("tendons", kind="rod", area="1 mm^2"), "it is for kind chamber"),
        (of("tendons", kind="chamber", bending_stiffness=1e-6), "it is for kind rod"),
        (of("tendons", kind="belt"), "must be one of tendon, rod, chamber"),
        (of("backbone", hysteresis=1.0), "hysteresis"),
        (of("backbone", hysteresis_play="-1 deg"), "hysteresis_play"),
        (RELAXES | of("backbone", second_relaxation=0.4), "together 0.7 of the bending stiffness"),
        (RELAXES | of("backbone", hysteresis=0.2), "together 0.7 of the bending stiffness"),
        # stiffness matrices
        (matrix((0, 2, 0.01)), "must be symmetric"),
        (matrix((0, 2, 0.06), (2, 0, 0.06)), "not positive definite"),
        (matrix((3, 3, -1.0)), "row 4 on the diagonal"),
        (matrix((3, 3, math.nan)), "not finite"),
        (matrix(stiffness=[[1.0]]), "six rows of six numbers"),
        (matrix((1, 1, "9 GPa")), 'got "9 GPa"'),
        (matrix((1, 1, 10**400)), "six rows of six numbers"),
        (matrix(stiffness=[[1.0] * 6] * 2 + [[1.0] * 5] * 4), "got a list of 5 as row 3"),
        (matrix(E="35 GPa"), "E: given with stiffness"),
        (matrix(nu=0.0), "nu: given with stiffness"),
        (matrix(density="0 kg/m^3"), "density: given with stiffness"),
        (matrix(inner_diameter="0 mm"), "inner_diameter: given with stiffness"),
        (matrix(width_direction="0 deg"), "width_direction: given with stiffness"),
        (matrix(mass_per_length=None), "mass_per_length: missing"),
        (matrix(stiffness=None, mass_per_length=None), "E: missing"),
        (matrix(stiffness=None), "mass_per_length: given without stiffness"),
    ],
)
def test_robots(changes: dict[str, Any], says: str) -> None:
    # with the fields of a matrix several things are wrong at once, each in a line
    with pytest.raises(InputError) as error:
        bs.load_robot("amouri2019", changes)
    assert says in str(error.value)


# -- loads -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"disk": 1.5}, "disk is 1.5, it must be a whole number"),
        ({"force": [1.0, 2.0]}, "force has shape (2,)"),
        ({"force": [np.nan, 0, 0]}, "all must be finite"),
        ({"moment": "x"}, "moment is 'x', it must be 3 numbers"),
        ({"point": ramp([0, 0, 1], 1.0)}, "point is"),
        ({"follower": 1}, "follower is 1, it must be True or False"),
        ({"arc_length": float("nan")}, "arc_length is nan m, it must be a finite number"),
        ({"arc_length": 0.0}, "arc_length is 0 m, it must be positive"),
        ({"arc_length": "x"}, "arc_length is 'x', it must be a finite number"),
        ({"arc_length": 0.1, "disk": 2}, "disk is 2 and arc_length is 0.1 m; give one of them"),
    ],
)
def test_point_loads(given: dict[str, Any], says: str) -> None:
    refused(says, lambda: bs.PointLoad(**given))


CLAMPED = ROBOT.with_(of("disks", clamped_length="4 mm"))
FORCES = np.zeros((9, 3))
NOT_FINITE = np.where(np.arange(9)[:, None] == 2, np.nan, 0.0) + FORCES
TOO_MANY = [bs.PointLoad(arc_length=0.08 + 0.005 * i) for i in range(8)]


@pytest.mark.parametrize(
    ("load", "says"),
    [
        ({"point_loads": [bs.PointLoad(9)]}, "point load 1 acts on disk 10, and the robot has 9"),
        ({"point_loads": [bs.PointLoad(-10)]}, "point load 1 acts on a disk before the base"),
        ({"point_loads": 3.0}, "point_loads is 3.0, it must be a sequence of PointLoad"),
        ({"point_loads": [[1, 2, 3]]}, "it must be a sequence of PointLoad"),
        ({"point_loads": bs.PointLoad(arc_length=0.7)}, "load 1 is 0.7 m; it must be above 0 m"),
        (
            {"point_loads": [bs.PointLoad(), bs.PointLoad(arc_length=0.0705)]},
            "point load 2 is 0.0705 m, where disk 1 clamps the backbone; give the disk",
        ),
        (
            {"point_loads": TOO_MANY},
            "8 sections between disk 1 and disk 2; at most 7 sections between two disks",
        ),
        ({"line_forces": [1.0, 2.0]}, "line_forces has shape (2,), it must have (9, 3)"),
        ({"line_forces": [[0, 0, 1.0]] * 4}, "line_forces has shape (4, 3)"),
        ({"line_forces": [0, 0, np.inf]}, "force per length"),
        ({"line_forces": "x"}, "it must be numbers of shape"),
        ({"disk_forces": FORCES[:4]}, "shape (4, 3), it must have (9, 3)"),
        ({"disk_forces": [1.0, 2.0, 3.0]}, "shape (3,), it must have (9, 3)"),
        ({"disk_forces": "x"}, "'x', it must be numbers of shape"),
        ({"disk_forces": {4: [0, 1, 0]}}, "it must be numbers of shape"),
        ({"disk_forces": np.ones((9, 3), bool)}, "it must be numbers of shape"),
        ({"disk_moments": [[0.0] * 3] * 8 + [[1.0]]}, "it must be numbers of shape"),
        ({"disk_forces": NOT_FINITE}, "dead force of disk 3 is ["),
    ],
)
def test_loads(load: dict[str, Any], says: str) -> None:
    """By every function that takes a load."""
    robot = CLAMPED if "clamps" in says else ROBOT
    designs = Designs(robot, {})
    for call in (
        lambda: bs.solve(robot, TENSIONS, load=bs.Load(**load)),
        lambda: bs.solve(robot, load=bs.Load(displacements=[0.01, 0, 0], **load)),
        lambda: bs.simulate(robot, TENSIONS, 0.1, load=bs.Load(**load)),
        lambda: bs.sweep(robot, [TENSIONS] * 2, load=bs.Load(**load)),
        lambda: bs.solve_batch(robot, [TENSIONS] * 2, load=bs.Load(**load)),
        lambda: sweep_designs(designs, [TENSIONS], load=bs.Load(**load)),
    ):
        refused(says, call)


# -- loads over time ---------------------------------------------------------------------------

POSES = {"positions": [[0, 0, 0], [0, 0, 1]]}
BASE = bs.BaseMotion([0.0, 1.0], **POSES)
DEAD = bs.PointLoad(4, force=[0.0, 0.6, 0.2], moment=[0.02, 0.0, 0.03])
FOLLOWER = bs.PointLoad(force=[0.3, 0.2, -0.5], follower=True)
BETWEEN = bs.PointLoad(arc_length=0.25, force=[0.2, 0.9, -0.3])


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (([0.0], None), "two or more"),
        (([0.1, 1.0], None), "begin at 0 s and increase"),
        (([0.0, 1.0, 1.0], None), "begin at 0 s and increase"),
        (([0.0, 1.0], [[0, 0, 0]]), "positions has shape (1, 3)"),
        (([0.0, 1.0], [[0, 0, 0], [0, 0, np.nan]]), "all must be finite"),
        (([0.0, 1.0], None, [[0, 0, 0], [0, 3.1, 0]]), "turns by 3.1 rad from 0 to 1 s"),
        (("x", None), "times is 'x'"),
        (([0.0, 1.0],), "neither positions nor rotations"),
    ],
)
def test_motions_of_the_base(given: tuple[Any, ...], says: str) -> None:
    refused(says, lambda: bs.BaseMotion(*given))


@pytest.mark.parametrize(
    ("load", "start", "says"),
    [
        ({"disk_forces": ramp([1.0, 2.0], 0.1)}, {}, "has 2 columns, it must have 27"),
        ({"disk_forces": lambda t: [1.0, 2.0]}, {}, "shape (2,) at 0 s, it must be (9, 3)"),
        ({"disk_forces": lambda t: FORCES * np.nan}, {}, "disk_forces"),
        ({"disk_forces": lambda t: "x"}, {}, "it must be numbers of shape (9, 3)"),
        ({}, {"disk_moments": FORCES[:2]}, "shape (2, 3), it must have (9, 3)"),
        ({"point_loads": [DEAD, FOLLOWER]}, {"point_loads": [DEAD]}, "same disks and points"),
        ({"base": BASE}, {}, "moves up to 1 s and the run lasts 2 s"),
        ({"base": "x"}, {}, "it must be a BaseMotion"),
        ({}, {"base": BASE}, "starts at rest on its base"),
        ({}, {"gravity": [0, 0, -9.81]}, "start.load has gravity, which is that of load"),
    ],
)
def test_loads_of_a_motion(load: dict[str, Any], start: dict[str, Any], says: str) -> None:
    given = {"load": bs.Load(**load), "start": bs.Start(bs.Load(**start))}
    refused(says, lambda: bs.simulate(ROBOT, TENSIONS, 2.0, **given))


# -- what does not take a robot or a load ------------------------------------------------------


def robot(*changes: dict[str, Any]) -> bs.Robot:
    together: dict[str, Any] = {}
    for change in changes:
        together |= change
    return bs.load_robot("amouri2019", together)


PRECURVED = robot(of("backbone", rest_bend="50 deg", rest_direction="35 deg"))
FLAT = robot({"segments.0.backbone": MATERIAL | {"E": 35e9, "width": 0.01, "height": 0.004}})
PLANES = robot(of("disks", hole_length="6 mm", clamped_length="3 mm"))
CARRYING = robot(payload(mass="50 g", centre="5 -10 30 mm"))
COUPLED = robot(matrix((0, 5, 1.0), (5, 0, 1.0)))
ROUGH = robot(of("tendons", friction=0.1))
MASSLESS = robot(of("disks", mass=0.0), of("backbone", density=0.0))
CONTINUOUS = bs.RodModel(tendon_path="continuous")
TIP = [0.3, 0.0, 0.53]
HYSTERESIS = robot(of("backbone", hysteresis=0.25, hysteresis_play="12 deg"))
RELAXING = robot(of("backbone", relaxation=0.3))
CREEPING = robot(of("tendons", compliance=2e-5, creep_compliance=3e-5))
RISING = bs.PointLoad(force=ramp([0, 0, 1.0], 1.0))
OF_ARCS = "a map takes gravity and tip force only"
OF_ELEMENTS = "tensions, gravity and a tip force only"
NO_TIME = "which only bowstring.simulate takes"
ONE_ELEMENT = bs.RodModel(elements=1)
COARSE = "needs 2 elements or more"


def load(**given: Any) -> bs.Load:
    return bs.Load(**given)


#: Arguments of calls with loads between disks and one element.
ON_ONE = {"load": load(point_loads=[BETWEEN]), "model": ONE_ELEMENT}


@pytest.mark.parametrize(
    ("call", "says"),
    [
        # loads
        (lambda: bs.solve(ROBOT, TENSIONS, load=load(point_loads=[RISING])), "depends on time"),
        (lambda: bs.solve(ROBOT, TENSIONS, load=load(base=BASE)), NO_TIME),
        (lambda: bs.sweep(ROBOT, [TENSIONS], load=load(base=BASE)), NO_TIME),
        (lambda: modes(ROBOT, TENSIONS, load=load(base=BASE)), NO_TIME),
        (lambda: bs.critical_load(ROBOT, load=load(tensions=TENSIONS, base=BASE)), NO_TIME),
        (lambda: fem.sweep(ROBOT, [TENSIONS], load=load(base=BASE)), OF_ELEMENTS),
        (lambda: fem.sweep(ROBOT, [TENSIONS], load=load(point_loads=[DEAD])), OF_ELEMENTS),
        (lambda: fem.sweep(ROBOT, [TENSIONS], load=load(line_forces=[0, 0, 1])), OF_ELEMENTS),
        (lambda: fem.sweep(ROBOT, [TENSIONS], load=load(disk_forces=FORCES)), OF_ELEMENTS),
        (lambda: bs.validity_map(ROBOT, load=load(point_loads=[DEAD])), OF_ARCS),
        (lambda: bs.validity_map(ROBOT, load=load(line_forces=[0, 0, 1.0])), OF_ARCS),
        (lambda: bs.validity_map(ROBOT, load=load(disk_forces=FORCES)), OF_ARCS),
        (
            lambda: bs.validity_grid(
                ROBOT,
                ["tension=0:80 N:3", "E=30:40 GPa:3"],
                load=load(disk_forces=FORCES),
            ),
            OF_ARCS,
        ),
        (
            lambda: sweep_designs(
                Designs(ROBOT, {"segments.*.backbone.E": [35e9]}),
                [TENSIONS],
                load=load(disk_forces=FORCES[None]),
            ),
            "shape (1, 9, 3), it must have (9, 3)",
        ),
        (lambda: modes(ROBOT, TENSIONS, load=load(point_loads=[DEAD])), "have no potential"),
        (lambda: modes(ROBOT, TENSIONS, load=load(point_loads=[FOLLOWER])), "have no potential"),
        (
            lambda: modes(ROBOT, TENSIONS, load=load(disk_moments=FORCES + 1)),
            "disk_moments has no modes",
        ),
        (
            lambda: bs.simulate(
                ROBOT,
                TENSIONS,
                0.1,
                load=load(disk_moments=FORCES + 0.01),
                integrator=bs.Integrator(modal_damping=0.01),
            ),
            "a moment leaves none",
        ),
        # loads between disks
        (lambda: bs.solve(ROBOT, TENSIONS, **ON_ONE), COARSE),
        (lambda: bs.sweep(ROBOT, [TENSIONS], **ON_ONE), COARSE),
        (lambda: bs.solve_batch(ROBOT, [TENSIONS], **ON_ONE), COARSE),
        (lambda: bs.simulate(ROBOT, TENSIONS, 0.01, **ON_ONE), COARSE),
        (
            lambda: bs.solve(
                ROBOT,
                load=load(displacements=[0.01, 0, 0], point_loads=[BETWEEN]),
                model=ONE_ELEMENT,
            ),
            COARSE,
        ),
        (
            lambda: bs.critical_load(
                ROBOT, load=load(tensions=TENSIONS, point_loads=[BETWEEN]), model=ONE_ELEMENT
            ),
            COARSE,
        ),
        # robots
        (lambda: RobotArcs.from_tensions(PRECURVED, TENSIONS, "arm"), "straight without load"),
        (lambda: bs.validity_chart(PRECURVED), "straight without load"),
        (lambda: bs.solve(FLAT, TENSIONS).to_dataset(), "round backbones only"),
        (
            lambda: RobotArcs.from_tensions(FLAT, TENSIONS, "arm"),
            "with equal bending stiffness about all axes",
        ),
        (lambda: bs.validity_chart(PLANES), "holes in the mid-plane"),
        (
            lambda: fem.ramp(CARRYING, TENSIONS, fem.Motion(0.1)),
            "a motion by finite elements takes no payloads",
        ),
        (
            lambda: bs.validity_chart(CARRYING),
            "the validity chart is for robots without payloads",
        ),
        (lambda: check_round(COUPLED, "a solid"), "shape and material of the section"),
        (
            lambda: bs.solve(COUPLED, TENSIONS, model=CONTINUOUS),
            "straight tendons only",
        ),
        # friction and masses
        (lambda: bs.solve(ROUGH, TENSIONS, model=CONTINUOUS), "need straight spans"),
        (
            lambda: bs.solve(ROUGH, history=bs.solve(ROUGH, TENSIONS).history()),
            "tensions is None, and so are displacements and angles",
        ),
        (lambda: modes(MASSLESS), "no mass"),
        (lambda: modes(ROBOT, count=0), "count"),
        # limits of displacements
        (
            lambda: bs.ActuationLimits(displacement_limits=[0.01, -0.01]).displacements(ROBOT),
            "must be finite, and the least below the largest",
        ),
        (
            lambda: bs.ActuationLimits(displacement_limits=[0.01]).displacements(ROBOT),
            "it must be (2,) or (2, 3)",
        ),
        (
            lambda: bs.inverse_kinematics(
                ROBOT,
                TIP,
                limits=bs.ActuationLimits(displacement_limits=[-1, 1]),
                model="constant_curvature",
            ),
            "are for physics",
        ),
        # laws with a memory
        (
            lambda: bs.sweep(RELAXING, [TENSIONS] * 2),
            "need the time of each row: call bowstring.sweep",
        ),
        (lambda: bs.sweep(CREEPING, [TENSIONS] * 2, times=[0.0]), "one for each of 2 rows"),
        (lambda: bs.sweep(CREEPING, [TENSIONS] * 2, times=[3.0, 1.0]), "row 2 is 1 s"),
        (lambda: bs.sweep(CREEPING, [TENSIONS] * 2, times=[-1.0, 1.0]), "row 1 is -1 s"),
        (lambda: bs.sweep(CREEPING, [TENSIONS] * 2, times=[0.0, math.nan]), "row 2 is nan s"),
        (
            lambda: bs.sweep(CREEPING, [TENSIONS] * 2, times=["0 s", "1 s"]),
            "must be numbers in s",
        ),
        (
            lambda: bs.BaseMotion.of_dict({"times_s": [0, 1], "positions_m": None}),
            "a motion of the base has no rotations_rad",
        ),
    ],
)
def test_calls(call: Callable[[], object], says: str) -> None:
    refused(says, call)


#: Functions that do not know all laws.
UNAWARE: dict[str, Callable[[bs.Robot], object]] = {
    "simulate": lambda robot: bs.simulate(robot, TENSIONS, 0.1),
    "modes": lambda robot: bs.modes(robot, TENSIONS),
    "inverse_kinematics": lambda robot: bs.inverse_kinematics(robot, [[0.05, 0, 0.5]]),
    "compile_robot": bs.compile_robot,
    "jacobians": lambda robot: bs.jacobians(bs.solve(robot, TENSIONS)),
    "displacement_jacobian": lambda robot: bs.displacement_jacobian(bs.solve(robot, TENSIONS)),
}


@pytest.mark.parametrize(
    ("robot", "says", "functions"),
    [
        (ROUGH, "set friction to 0", "jacobians displacement_jacobian"),
        (HYSTERESIS, "set hysteresis to 0", " ".join(UNAWARE)),
        (CREEPING, "have creep", "inverse_kinematics"),
        (RELAXING, "has relaxation", "modes"),
        (
            robot(of("tendons", backlash="0.4 mm")),
            r"backlash.*; set backlash to 0",
            "simulate inverse_kinematics compile_robot displacement_jacobian",
        ),
        *(
            (
                robot(of("tendons", **{field: 1e-5})),
                f"set {field} to 0",
                "simulate inverse_kinematics compile_robot jacobians",
            )
            for field in ("hole_clearance", "mount_compliance")
        ),
        (robot(of("tendons", gain=1.03)), "set gain to 1", "compile_robot"),
        (robot(of("tendons", gain=1.03)), "derivatives do not model", "displacement_jacobian"),
    ],
)
def test_laws(robot: bs.Robot, says: str, functions: str) -> None:
    for name in functions.split():
        refused(says, lambda name=name: UNAWARE[name](robot))  # type: ignore[misc]


# -- histories ---------------------------------------------------------------------------------

LAWS = robot(
    of("backbone", hysteresis=0.2, hysteresis_play="12 deg", relaxation=0.3),
    of("tendons", compliance=2e-5, creep_compliance=3e-5, friction=0.1),
)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("point_loads", [{"disk": 1}]),
        ("disk_forces_N", [[1.0, 0.0, 0.0]]),
        ("plays_per_m", [[0.0, 0.0]]),
        ("lags_per_m", [[1.0, 2.0, 3.0]]),
        ("lags_per_m", [[0.0, 0.0]]),
        ("creep_m", [[[0.0]]]),
        ("creep_m", [[0.0]]),
    ],
)
def test_damaged_histories(name: str, value: Any) -> None:
    first = bs.sweep(LAWS, [TENSIONS], times=[1.0])
    history = {**json.loads(json.dumps(first.history())), name: value}
    refused("damaged", lambda: bs.sweep(LAWS, [TENSIONS], times=[1.0], history=history))


# -- flags of loads ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flag", "text", "says"),
    [
        ("--disk-force", "0,1,0", "must be a disk of amouri2019 from 1 to 9"),
        ("--disk-force", "0:0,1,0", "must be a disk of amouri2019 from 1 to 9"),
        ("--disk-moment", "10:0,1,0", 'got "10:0,1,0"'),
        ("--disk-force", "1.5:0,1,0", "must be a disk"),
        ("--disk-force", f"{'9' * 5000}:0,1,0", "must be a disk"),
        ("--disk-moment", "4:0,1", "got 2 numbers; write x, y and z"),
        ("--disk-force", "4:0,1,x", 'got "x", which is not a number'),
        ("--disk-force", "4:0,1,1 m", "1 m"),
        ("--disk-moment", "4:0,1,1 N", "1 N"),
        ("--disk-force", "4:0,1,0;4:1,0,0", "disk 4 is there twice"),
        ("--disk-moment", "4:0,1,0;4:1,0,0", "disk 4 is there twice"),
        ("--point-force", "9:0,1,0", "a point of the disk must follow the force after an @"),
        ("--point-force", "9:0,1,0", 'in place of the disk, such as "137 mm:0,1,0"'),
        ("--point-force", "10:0,1,0@0,0,0", "must be a disk of amouri2019 from 1 to 9"),
        ("--point-force", "x:0,1,0", "from 1 to 9 or an arc length with its unit and, after"),
        ("--point-force", "9:0,1,0@0,0", "got 2 numbers; write x, y and z"),
        ("--point-force", "-2 mm:0,1,0", "arc_length is -0.002 m, it must be positive"),
        ("--point-force", "2 kg:0,1,0", "kg"),
        ("--follower-force", "9:0,1,0@0,0,20", "20 mm"),
        ("--follower-force", "9:0,x,0", 'got "x", which is not a number'),
        ("--line-force", "0,1", "got 2 numbers"),
        ("--line-force", "0,0,1 N", "1 N"),
    ],
)
def test_flags(shell: Shell, flag: str, text: str, says: str) -> None:
    given = [part for one in text.split(";") for part in (flag, one)]
    motion = ["simulate", "--rise", "0.1", "--hold", "0"]
    for command in (["solve"], motion) if flag.startswith("--disk") else (["solve"],):
        error = shell.error(*command, "amouri2019", "--tension", "1,0,0", *given)
        assert error.startswith(flag) and says in error
