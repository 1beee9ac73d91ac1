"""Properties of every robot, load and law: a row for each, a test for each property.

A new feature is a row of `ROBOTS`, `LOADS` or `LAWS`. A row names the properties that it does not
have, and why. Published figures and closed forms are in the test file of their subject.
"""

from __future__ import annotations

import json
import pickle
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.dynamics import ramp
from bowstring.robot.designs import Designs
from bowstring.robot.writer import to_yaml
from bowstring.statics.design_sweeps import sweep_designs
from objects import coupled_stiffness
from shell import Shell

Values = dict[str, Any]

# dead moments and followers: a motion starts where it may not be stable
pytestmark = pytest.mark.filterwarnings("ignore::bowstring.errors.StabilityWarning")

ROOT = Path(__file__).parents[1]
UNIFORM = bs.load_robot("amouri2019")
DEFAULT = bs.RodModel()

# -- robots ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """A robot, the fields that `sweep_designs` varies, and the properties that it lacks.

    Fields that have no effect under tension control are varied `by_displacement`.
    """

    robot: bs.Robot
    design: Mapping[str, Any]
    lacks: Mapping[str, str] = field(default_factory=dict)
    model: bs.RodModel = DEFAULT
    by_displacement: bool = False


def of(part: str, **values: Any) -> Values:
    """Fields of a part of the first segment by their paths."""
    return {f"segments.0.{part}.{name}": value for name, value in values.items()}


def changed(*changes: Values, design: Mapping[str, Any], **more: Any) -> Row:
    """The built-in robot with changes."""
    together: Values = {}
    for change in changes:
        together |= change
    return Row(bs.load_robot("amouri2019", together), design, **more)


def segments(*backbones: Values, tendons: Any) -> bs.Robot:
    """A robot of segments of 0.3 m with these backbones, of disks of 10 g."""
    disks = {"count": 4, "mass": "10 g", "radius": "25 mm", "thickness": "2 mm"}
    each = [
        {"length": "0.3 m", "backbone": backbone, "disks": disks, "tendons": routed}
        for backbone, routed in zip(backbones, tendons, strict=True)
    ]
    return bs.Robot.model_validate(
        {"name": "segments", "gravity": [1.0, 2.0, 9.0], "segments": each}
    )


MATRIX = {"stiffness": coupled_stiffness(7, 0.8).tolist(), "mass_per_length": "30 g/m"}
MATRIX["rotary_inertia"] = "0.05 g*mm"
ROUND = {"diameter": "6 mm", "E": "2 GPa", "nu": 0.3, "density": "1800 kg/m^3"}
RING = {"count": 3, "pitch_radius": "20 mm"}
E = "segments.0.backbone.E"
MASS = {"segments.0.disks.mass": [0.01, 0.03]}
FLAT = {"width": "10 mm", "height": "4 mm", "width_direction": "30 deg", "E": "35 GPa", "nu": 0.3}
CONTINUOUS = {
    "drawing": "continuous tendons have no straight spans",
    "derivatives": "derivatives are those of straight spans",
    "displacements": "displacements need straight spans",
    "batch": "many rows take seconds",
}

ROBOTS: dict[str, Row] = {
    "uniform": changed(
        design={
            "segments.*.backbone.E": [30e9, 40e9],
            "segments.0.backbone.diameter": [4e-3, 5e-3],
            "segments.0.disks.clamped_length": [0.0, 6e-3],
            "segments.0.disks.mass": [0.05, 0.0],
            "pitch_radius": [0.02, 0.03],
            "segments.0.length": [0.8, 0.55],
            "gravity.2": [-9.81, 4.0],
        }
    ),
    "embedded": Row(
        bs.load_robot(ROOT / "examples" / "tentacle.yaml"),
        {E: [5e5, 6e5]},
        lacks=CONTINUOUS
        | {"energy": "work of converging tendons misses 0.4 %, whatever the steps"},
    ),
    "kirchhoff": changed(design={E: [30e9, 40e9]}, model=bs.RodModel("kirchhoff")),
    "continuous": changed(
        design={E: [30e9, 40e9]}, model=bs.RodModel(tendon_path="continuous"), lacks=CONTINUOUS
    ),
    "precurved": changed(
        of("backbone", rest_bend="50 deg", rest_direction="35 deg", rest_twist="40 deg"),
        design={"segments.0.backbone.rest_bend": np.radians([0.0, 20.0, -70.0])},
    ),
    "tapered": changed(
        of("backbone", diameter="6 mm", end_diameter="3.5 mm", inner_diameter="3 mm"),
        of("backbone", end_inner_diameter="1.5 mm"),
        design={"segments.0.backbone.end_diameter": [5e-3, 4e-3]},
    ),
    "rectangular": changed(
        {"segments.0.backbone": FLAT | {"density": "1800 kg/m^3"}},
        design={"segments.0.backbone.width_direction": np.radians([0.0, 20.0, 90.0])},
        lacks={
            "fields": "stresses are those of round backbones",
            "energy": "a file of a motion has the stress of round backbones",
        },
    ),
    "helical": changed(
        of("tendons", turns=0.5, end_pitch_radius=0.015),
        design={"segments.0.tendons.turns": [0.1, 0.3, -0.4]},
    ),
    "payloads": changed(
        {
            "gravity": "0 0 -9.81 m/s^2",
            "payloads": [
                {"mass": "50 g", "centre": "20 10 30 mm", "inertia": "10 10 8 kg*mm^2"},
                {"mass": "30 g", "disk": 5, "centre": "40 0 0 mm"},
            ],
        },
        design={"payloads.0.mass": [0.01, 0.05], "payloads.0.centre.0": [0.0, 0.02]},
    ),
    "coupled": Row(segments(MATRIX, tendons=[RING]), MASS),
    "coupled, then uniform": Row(
        segments(MATRIX, ROUND, tendons=[RING, RING | {"first_angle": "60 deg"}]), MASS
    ),
    "bare tail": Row(
        segments(ROUND, ROUND | {"diameter": "4 mm"}, tendons=[RING, []]),
        {"segments.1.length": [0.2, 0.3]},
    ),
    "hole planes": changed(
        of("disks", hole_length="6 mm", clamped_length="3 mm"),
        design={"segments.*.disks.hole_length": [0.0, 3e-3, 6e-3]},
    ),
    "elastic tendons": changed(
        of("tendons", compliance="0.02 mm/N", pretension="1 N"),
        design={"segments.0.tendons.compliance": [1e-5, 4e-5]},
        by_displacement=True,
    ),
    "rods that push": changed(
        {"name": "rods"}, of("tendons", kind="rod"), design={E: [30e9, 40e9]}
    ),
    "two segments": Row(
        bs.load_robot("rao2021"),
        {"segments.*.backbone.E": [50e9, 70e9], "segments.*.backbone.diameter": [1e-3, 1.2e-3]},
    ),
}

# -- laws of tendons, drives and backbones -----------------------------------------------------

_PATH = {
    "batch": "a polynomial starts equilibria under tensions alone",
    "derivatives": "the equilibrium depends on the path to it",
    "displacements": "the equilibrium depends on the path to it",
    "error": "modules may turn at other loads with more elements",
}
_AT_REST = _PATH | {"motion": "motions do not know the law"}
_SWEPT = _AT_REST | {"designs": "sweep_designs does not follow the law"}
RELAXES = of("backbone", relaxation=0.3, relaxation_time="20 s")
CREEPS = of("tendons", compliance=2e-5, creep_compliance=3e-5, creep_time="20 s")

LAWS: dict[str, Row] = {
    "friction": changed(
        of("tendons", friction=0.1),
        design={"segments.0.tendons.friction": [0.05, 0.2]},
        lacks=_PATH | {"energy": "friction dissipates", "end": "friction holds it before"},
    ),
    "wrap": changed(
        of("tendons", friction=0.1, wrap_angle="400 deg"),
        design={"segments.0.tendons.wrap_angle": [0.5, 2.0]},
        lacks=_PATH | {"energy": "friction dissipates", "end": "friction holds it before"},
    ),
    "backlash": changed(
        of("tendons", backlash="0.4 mm"),
        design={"segments.0.tendons.backlash": [2e-4, 6e-4]},
        lacks=_AT_REST,
        by_displacement=True,
    ),
    "hysteresis": changed(
        of("backbone", hysteresis=0.25, hysteresis_play="12 deg"),
        design={"segments.0.backbone.hysteresis": [0.1, 0.3]},
        lacks=_SWEPT,
    ),
    "relaxation": changed(
        RELAXES, design={"segments.0.backbone.relaxation": [0.1, 0.4]}, lacks=_SWEPT
    ),
    "two relaxations": changed(
        RELAXES,
        of("backbone", second_relaxation=0.2, second_relaxation_time="150 s"),
        design={"segments.0.backbone.second_relaxation": [0.1, 0.3]},
        lacks=_SWEPT,
    ),
    "creep": changed(
        CREEPS,
        design={"segments.0.tendons.creep_compliance": [1e-5, 4e-5]},
        lacks=_SWEPT,
        by_displacement=True,
    ),
    "losses in holes and mount": changed(
        of("tendons", compliance="0.02 mm/N", hole_clearance="0.4 mm", mount_compliance=1e-5),
        design={"segments.0.tendons.hole_clearance": [1e-4, 5e-4]},
        lacks={
            "motion": "motions do not know the law",
            "derivatives": "derivatives do not know the law",
            "displacements": "derivatives do not know the law",
        },
        by_displacement=True,
    ),
    "gain, zero and delay of drives": changed(
        of("tendons", compliance="0.02 mm/N", gain=1.04, zero="0.3 mm", delay="5 ms"),
        design={"segments.0.tendons.gain": [0.97, 1.05]},
        lacks={
            "derivatives": "derivatives do not know the law",
            "displacements": "derivatives do not know the law",
        },
        by_displacement=True,
    ),
    "decoupling of drives": Row(
        bs.load_robot("rao2021", {"segments.1.tendons.decoupling": 1}),
        {E: [50e9, 70e9]},
        lacks={
            "derivatives": "derivatives do not know the law",
            "displacements": "derivatives do not know the law",
        },
    ),
}


# -- loads, in sizes that bend the robot by about half a radian --------------------------------


@dataclass(frozen=True)
class Sizes:
    """Unit force (N) and moment (N m), disks and length of a robot."""

    robot: bs.Robot

    @property
    def moment(self) -> float:
        return float(self.robot.bending_stiffness.min()) / self.robot.length

    @property
    def force(self) -> float:
        return self.moment / self.robot.length

    @property
    def tensions(self) -> Floats:
        """Tensions (4, T) in N that rise and fall."""
        tendons = self.robot.tendons
        moment = float(self.robot.bending_stiffness[0]) / self.robot.length
        largest = 0.5 * moment / np.linalg.norm(tendons.hole_m, axis=1)
        share = np.array([1.0, 0.15, 0.4, 0.3, 0.7, 0.2])[: len(largest)]
        share[1:] *= np.where(tendons.pushes[1:], -1.0, 1.0)
        found: Floats = np.outer([0.3, 1.0, 0.6, 0.2], share * largest)
        return found

    def on(self, disk: int, vector: Any) -> Floats:
        """No vector but this on one disk."""
        out = np.zeros((self.robot.core.disk_count, 3))
        out[disk] = vector
        return out

    def point(self, force: Any, moment: Any, **place: Any) -> bs.PointLoad:
        return bs.PointLoad(
            force=self.force * np.array(force), moment=self.moment * np.array(moment), **place
        )


def _on_disks(unit: Sizes, follower: bool) -> Values:
    arm = (0.02 * unit.robot.length, -0.01 * unit.robot.length, 0.03 * unit.robot.length)
    inner = unit.point([0.3, 0.6, 0.2], [0.1, 0.0, 0.05], disk=1, point=arm, follower=follower)
    outer = unit.point([0.4, -0.3, -0.3], [0.0, 0.1, 0.05], point=arm, follower=follower)
    return {"point_loads": [inner, outer]}


def _on_sections(unit: Sizes, follower: bool) -> Values:
    arm = (0.02 * unit.robot.length, 0.0, 0.01 * unit.robot.length)
    places = [share * unit.robot.length for share in (0.37, 0.78)]
    inner = unit.point([0.5, -0.6, 0.2], [0.1, 0.0, 0.1], arc_length=places[0], follower=follower)
    outer = unit.point([0.4, 0.3, -0.3], [0.0, 0.1, 0.05], arc_length=places[1], point=arm)
    return {"point_loads": [inner, replace(outer, follower=follower)]}


LOADS: dict[str, Callable[[Sizes], Values]] = {
    "gravity": lambda unit: {"gravity": (1.0, 2.0, -9.81)},
    "tip": lambda unit: {
        "tip_force": unit.force * np.array([0.5, -0.8, 0.3]),
        "tip_moment": unit.moment * np.array([0.1, 0.2, -0.1]),
    },
    "disk forces": lambda unit: {
        "disk_forces": unit.force * (unit.on(1, [0.5, 1.0, 0.2]) + unit.on(-2, [-0.5, 0.3, 0.0]))
    },
    "disk moments": lambda unit: {
        "disk_forces": unit.force * unit.on(-1, [0.3, 0.5, 0.2]),
        "disk_moments": unit.moment * unit.on(2, [0.2, 0.0, 0.2]),
    },
    "dead on disks": lambda unit: _on_disks(unit, follower=False),
    "followers on disks": lambda unit: _on_disks(unit, follower=True),
    "line": lambda unit: {
        "line_forces": unit.force / unit.robot.length * np.array([0.6, -1.0, 0.5])
    },
    "dead on sections": lambda unit: _on_sections(unit, follower=False),
    "followers on sections": lambda unit: _on_sections(unit, follower=True),
}

_SLOW = {"batch": "many rows take seconds"}
#: Properties that a load lacks.
LACKS = {
    "dead on disks": {"batch": "as of followers, which take as long"},
    "dead on sections": _SLOW,
    "followers on sections": _SLOW,
}

# -- cases: every load on the uniform robot, two loads on every other --------------------------


@dataclass(frozen=True)
class Case:
    """A robot and its load."""

    row: Row
    load: Values
    lacks: Mapping[str, str]

    @property
    def robot(self) -> bs.Robot:
        return self.row.robot

    @cached_property
    def tensions(self) -> Floats:
        """Tensions (4, T) of a path in N."""
        return Sizes(self.robot).tensions

    def draw(self, count: int) -> Floats:
        """Random tensions (count, T) in N."""
        largest = self.tensions.max(axis=0)
        found: Floats = np.random.default_rng(1).uniform(0.0, 1.0, (count, len(largest))) * largest
        return found

    @property
    def times(self) -> Values:
        """Times of the rows of a path, for laws with a time."""
        timed = {"relaxation", "creep"} & set(self.robot.memories)
        return {"times": [2.0, 9.0, 14.0, 30.0]} if timed else {}

    def loaded(self, tensions: Any = None, **more: Any) -> bs.Load:
        return bs.Load(**{"tensions": tensions, **self.load, **more})

    def solve(self, tensions: Any = None, model: bs.RodModel | None = None) -> bs.Solution:
        tensions = self.tensions[1] if tensions is None else tensions
        model = self.row.model if model is None else model
        return bs.solve(self.robot, load=self.loaded(tensions), model=model).raise_for_status()

    def elements(self, count: int) -> bs.RodModel:
        model = self.row.model
        return bs.RodModel(model.theory, tendon_path=model.tendon_path, elements=count)


def _cases() -> dict[str, Case]:
    """Every load on the uniform robot, and two loads on every other robot and on every law."""
    kinds = list(LOADS)
    pairs = [("uniform", kind) for kind in kinds]
    others = [name for name in ROBOTS if name != "uniform"]
    # two loads further with each row; a row that is added at the end leaves the pairs before it
    for k, name in [*enumerate(others), *enumerate(LAWS, 4)]:
        pairs += [(name, kinds[(2 * k + i) % len(kinds)]) for i in range(2)]
    rows = ROBOTS | LAWS
    return {
        f"{name}, {kind}": Case(
            rows[name],
            LOADS[kind](Sizes(rows[name].robot)),
            {**rows[name].lacks, **LACKS.get(kind, {})},
        )
        for name, kind in pairs
    }


CASES = _cases()
PROPERTIES = {
    "turning", "rows", "batch", "designs", "displacements", "derivatives", "error",
    "motion", "energy", "end", "history", "files", "drawing", "fields",
}  # fmt: skip


def every(*properties: str) -> Any:
    """Run a test on all cases that have these properties."""
    assert set(properties) <= PROPERTIES
    cases = {name: case for name, case in CASES.items() if not set(properties) & set(case.lacks)}
    return pytest.mark.parametrize("case", cases.values(), ids=cases.keys())


def test_rows_lack_known_properties_only() -> None:
    for name, case in CASES.items():
        assert set(case.lacks) <= PROPERTIES, name


def test_every_robot_and_load_has_its_effect() -> None:
    """Otherwise the other tests say nothing of it."""
    for name, case in CASES.items():
        tips = [case.solve().tip.position]
        if case.robot.has_memory:
            path = case.loaded(case.tensions)
            tips = [bs.sweep(case.robot, load=path, **case.times).tip_position[-1]]
        bare = bs.solve(case.robot, case.tensions[1], load=bs.Load(gravity=(0, 0, 0)))
        assert np.abs(tips[0] - bare.tip.position).max() > 1e-3 * case.robot.length, name
        is_change = case.robot.name == UNIFORM.name and case.row is not ROBOTS["uniform"]
        if is_change and not case.row.by_displacement:
            other = replace(case, row=ROBOTS["uniform"])
            plain = bs.sweep(UNIFORM, load=other.loaded(case.tensions)).tip_position
            same = plain[-1] if case.robot.has_memory else plain[1]
            assert np.abs(tips[0] - same).max() > 1e-6 * case.robot.length, name


# -- turning about the axis of the base --------------------------------------------------------

ANGLE = 0.7
TURN = Rotation.from_rotvec([0.0, 0.0, ANGLE]).as_matrix()


def turned_robot(robot: bs.Robot) -> bs.Robot:
    """The robot turned about the axis of its base."""
    changes: Values = {"gravity": (TURN @ np.array(robot.gravity)).tolist()}
    for k, segment in enumerate(robot.segments):
        at, backbone = f"segments.{k}.", segment.backbone
        if isinstance(segment.tendons, tuple):
            for i, tendon in enumerate(segment.tendons):
                changes[f"{at}tendons.{i}.angle"] = tendon.angle + ANGLE
        else:
            changes[f"{at}tendons.first_angle"] = segment.tendons.first_angle + ANGLE
        if backbone.stiffness is not None:
            both = np.kron(np.eye(2), TURN)
            changes[f"{at}backbone.stiffness"] = (both @ backbone.stiffness @ both.T).tolist()
        if backbone.width is not None:
            changes[f"{at}backbone.width_direction"] = backbone.width_direction + ANGLE
        if backbone.rest_bend:
            changes[f"{at}backbone.rest_direction"] = backbone.rest_direction + ANGLE
    for k, body in enumerate(robot.payloads):
        changes[f"payloads.{k}.centre"] = (TURN @ np.array(body.centre)).tolist()
    return robot.with_(changes)


def turned_load(load: Values) -> Values:
    """The load turned: points and followers are in axes of disks, which turn too."""
    out = {
        name: np.asarray(value) @ TURN.T for name, value in load.items() if name != "point_loads"
    }
    if "point_loads" in load:
        out["point_loads"] = [
            replace(
                point,
                **{
                    name: TURN @ np.array(getattr(point, name))
                    for name in ("force", "moment", "point")
                },
            )
            for point in load["point_loads"]
        ]
    return out


@every("turning")
def test_a_turned_robot_under_a_turned_load_has_turned_poses(case: Case) -> None:
    other = replace(
        case,
        row=replace(case.row, robot=turned_robot(case.robot)),
        load=turned_load(case.load),
    )
    here, there = (
        bs.sweep(each.robot, load=each.loaded(case.tensions), model=case.row.model, **case.times)
        for each in (case, other)
    )
    assert here.converged.all()
    size = case.robot.length
    assert np.abs(there.tip_position - here.tip_position @ TURN.T).max() < 1e-9 * size
    assert np.abs(there.tip_rotation - TURN @ here.tip_rotation @ TURN.T).max() < 1e-8
    assert np.abs(there.tendon_lengths - here.tendon_lengths).max() < 1e-9 * size
    assert np.linalg.norm(here.tip_position[1, :2]) > 0.01 * size
    if "motion" in case.lacks:
        return
    runs = [
        bs.simulate(each.robot, ramp(case.tensions[1], 0.05), 0.1, load=each.loaded(),
                    model=case.row.model, integrator=bs.Integrator(dt=2e-3))
        for each in (case, other)
    ]  # fmt: skip
    assert np.abs(runs[1].tip_position - runs[0].tip_position @ TURN.T).max() < 2e-6 * size


# -- one load at a time and many ---------------------------------------------------------------


@every("rows")
def test_rows_equal_single_solves(case: Case) -> None:
    """In a batch; and in sweeps, where no law follows the path."""
    many, model = case.draw(4), case.elements(2)
    given = {"load": case.loaded(many), "model": model}
    found = [bs.solve_batch(case.robot, **given, threads=2)]
    if not case.robot.has_memory:
        found += [bs.sweep(case.robot, **given), bs.sweep(case.robot, **given, warm=False)]
    for row in range(4):
        alone = case.solve(many[row], model).disk_positions
        for each in found:
            assert np.abs(each.disk_positions[row] - alone).max() < 1e-8 * case.robot.length
    shares = np.array([1.0, 0.6, -0.5, 0.2])
    rows = {
        name: np.multiply.outer(shares, np.asarray(value))
        for name, value in case.load.items()
        if name not in ("point_loads", "line_forces")
    }
    scaled = bs.solve_batch(case.robot, load=case.loaded(many, **rows), model=model)
    for row in range(4 if rows else 0):
        load = case.loaded(many[row], **{name: value[row] for name, value in rows.items()})
        alone = bs.solve(case.robot, load=load, model=model).disk_positions
        assert np.abs(scaled.disk_positions[row] - alone).max() < 1e-8 * case.robot.length


@every("batch")
def test_a_long_batch_equals_single_solves(case: Case) -> None:
    """Long enough to start from a polynomial, also of six tensions."""
    many, model = case.draw(500), case.elements(1)
    batch = bs.solve_batch(case.robot, load=case.loaded(many), model=model)
    for row in (0, 250, 499):
        alone = case.solve(many[row], model)
        off = np.linalg.norm(batch.tip_position[row] - alone.tip.position)
        assert off < 1e-8 * case.robot.length


@every("designs")
def test_designs_equal_single_robots(case: Case) -> None:
    designs = Designs(case.robot, case.row.design)
    load = bs.Load(**case.load)
    commands = {"tensions": case.tensions}
    if case.row.by_displacement:
        path = bs.sweep(UNIFORM, load=case.loaded(case.tensions))
        commands = {"displacements": path.displacements()}
    found = sweep_designs(designs, **commands, load=load, model=case.row.model)
    assert found.converged.all()
    for i, tips in enumerate(found.tip_position):
        load = case.loaded().replace(**commands)
        one = bs.sweep(designs.robot_at(i), load=load, model=case.row.model)
        assert np.abs(tips - one.tip_position).max() < 1e-8 * case.robot.length
        away = found.tendon_lengths[i] - one.tendon_lengths
        assert np.abs(away).max() < 1e-8 * case.robot.length
    assert np.abs(found.tip_position[-1] - found.tip_position[0]).max() > 1e-5 * case.robot.length


# -- actuation ---------------------------------------------------------------------------------


@every("displacements")
def test_displacements_command_the_pose_of_the_tensions(case: Case) -> None:
    found = case.solve()
    load = case.loaded().replace(displacements=found.displacements())
    again = bs.solve(case.robot, load=load, model=found.model).raise_for_status()
    assert np.abs(again.disk_positions - found.disk_positions).max() < 1e-8 * case.robot.length
    alone = bs.solve(case.robot, load=load, model=case.row.model)
    history = json.loads(json.dumps(alone.history()))
    kept = bs.solve(case.robot, load=load, model=case.row.model, history=history)
    assert np.abs(kept.disk_positions - alone.disk_positions).max() < 1e-8 * case.robot.length
    rows = load.replace(displacements=np.tile(load.displacements, (2, 1)))
    for many in (bs.sweep, bs.solve_batch):
        pair = many(case.robot, load=rows, model=found.model)
        assert (
            np.abs(pair.disk_positions[1] - again.disk_positions).max() < 1e-8 * case.robot.length
        )
    home = bs.solve(case.robot, case.robot.tendons.pretension_N, load=bs.Load(gravity=(0, 0, 0)))
    assert np.abs(home.displacements()).max() < 1e-12


@every("drawing")
def test_drawn_tendons_have_their_lengths(case: Case) -> None:
    found = case.solve()
    paths = case.robot.tendon_points(found.disk_positions, found.disk_rotations)
    drawn = [np.linalg.norm(np.diff(path, axis=0), axis=1).sum() for path in paths]
    np.testing.assert_allclose(drawn, found.tendon_lengths, atol=1e-12)


# -- derivatives and error ---------------------------------------------------------------------


@every("derivatives")
def test_derivatives_are_those_of_differences(case: Case) -> None:
    """By tensions, tip force and moment, and stiffness of a segment; Richardson's differences."""
    unit, model = Sizes(case.robot), case.elements(2)
    tensions = case.tensions[1]
    scale = {"tension": 0.02 * tensions.max(), "tip_force": 0.02 * unit.force,
             "tip_moment": 0.02 * unit.moment, "stiffness": 0.02}  # fmt: skip

    def solved(by: str, k: int, step: float) -> bs.Solution:
        robot, given = case.robot, case.loaded(tensions)
        if by == "stiffness":
            backbone = robot.segments[k].backbone
            name = "E" if backbone.stiffness is None else "stiffness"
            value = (1.0 + step) * np.array(getattr(backbone, name))
            robot = robot.with_({f"segments.{k}.backbone.{name}": value.tolist()})
        else:
            name = "tensions" if by == "tension" else by
            old = getattr(given, name)
            old = np.zeros(3) if old is None else np.array(old)
            given = given.replace(**{name: old + step * np.eye(len(old))[k]})
        return bs.solve(robot, load=given, model=model).raise_for_status()

    middle = solved("tension", 0, 0.0)
    exact = bs.jacobians(middle)

    def turned(found: bs.Solution) -> Floats:
        """Rotation vector of the tip from the middle, in the base frame."""
        return Rotation.from_matrix(found.tip.rotation @ middle.tip.rotation.T).as_rotvec()

    for by, size in scale.items():
        for k in range(getattr(exact, f"tip_position_by_{by}").shape[1]):
            ends = {h: [solved(by, k, s * h * size) for s in (1, -1)] for h in (1.0, 0.5)}
            for name, get in (
                ("tip_position", lambda x: x.tip.position),
                ("lengths", lambda x: x.tendon_lengths),
                ("tip_rotation", turned),
            ):
                coarse, fine = ((get(a) - get(b)) / (2 * h * size) for h, (a, b) in ends.items())
                expected = (4 * fine - coarse) / 3
                found = getattr(exact, f"{name}_by_{by}")[:, k]
                assert np.abs(found - expected).max() < 1e-5 * np.abs(expected).max(), (by, name, k)


@every("error")
def test_the_stated_error_covers_the_error(case: Case) -> None:
    """Of all disks, against the finest elements."""
    fine = case.solve(model=case.elements(8)).disk_positions
    between = any(p.arc_length is not None for p in case.load.get("point_loads", ()))
    for elements in (2, 4) if between else (1, 2, 4):
        found = case.solve(model=case.elements(elements))
        off = np.linalg.norm(found.disk_positions - fine, axis=1).max()
        assert off <= found.error_estimate.tip + 1e-12 * case.robot.length


# -- motion ------------------------------------------------------------------------------------


def rising(load: Values, duration: float) -> Values:
    """The load, but for gravity, which rises from zero."""
    out = {name: ramp(value, duration) for name, value in load.items() if name != "point_loads"}
    if "gravity" in load:
        out["gravity"] = load["gravity"]
    if "point_loads" in load:
        out["point_loads"] = [
            replace(p, force=ramp(p.force, duration), moment=ramp(p.moment, duration))
            for p in load["point_loads"]
        ]
    return out


def moved(case: Case, load: bs.Load, tensions: Any, duration: float, **steps: float) -> bs.Run:
    return bs.simulate(
        case.robot, tensions, duration, load=load, model=case.row.model,
        integrator=bs.Integrator(**steps), output=bs.Output(every=duration / 50, points=3),
    ).raise_for_status()  # fmt: skip


@every("motion", "energy")
def test_a_motion_keeps_its_energy(case: Case) -> None:
    """Kinetic, elastic and of gravity: they change by the work of tendons and loads."""
    load = bs.Load(**rising(case.load, 0.1))
    run = moved(case, load, ramp(case.tensions[1], 0.1), 0.3, spectral_radius=1.0, dt=1e-3)
    data = run.to_dataset()
    left = data.kinetic_energy + data.elastic_energy + data.gravity_energy - data.work
    scale = float(np.abs(data.work).max())
    assert float(np.abs(left - left[0]).max()) < 1e-3 * scale


@every("motion", "end")
def test_a_motion_starts_and_ends_in_equilibrium(case: Case) -> None:
    size, tensions = case.robot.length, case.tensions[1]
    still = moved(case, case.loaded(), tensions, 0.1)
    elements = still.settings["elements"]
    rest = case.solve(model=case.elements(elements)).tip.position
    assert np.ptp(still.tip_position, axis=0).max() < 1e-6 * size
    assert np.abs(still.tip_position[0] - rest).max() < 3e-5 * size
    if "fields" not in case.lacks:
        data = still.to_dataset()
        there = case.solve(model=case.elements(elements))
        np.testing.assert_allclose(data.tendon_length[-1], there.tendon_lengths, atol=1e-5 * size)
    load = bs.Load(**rising(case.load, 0.2))
    run = moved(case, load, ramp(tensions, 0.2), 4.0, mass_damping=8.0, material_damping=1e-3)
    assert np.linalg.norm(run.tip_position[-1] - rest) < 1e-4 * size
    assert np.linalg.norm(run.tip_position[1] - rest) > 0.01 * size


# -- histories and files -----------------------------------------------------------------------


@every("history")
@pytest.mark.parametrize("control", ["tensions", "displacements"])
def test_a_history_continues(case: Case, control: str) -> None:
    """Through JSON, after two of four loads; then with one load at a time."""
    model, size = case.elements(2), case.robot.length
    path = case.loaded(case.tensions)
    if control == "displacements":
        if model.tendon_path == "continuous" or case.robot.is_embedded:
            pytest.skip("displacements need straight spans")
        elastic = bs.sweep(case.robot, load=path, model=model, **case.times)
        path = case.loaded().replace(displacements=elastic.displacements())
    values = getattr(path, control)

    def follow(rows: slice, times: Any, history: Any = None) -> bs.Sweep:
        load = path.replace(**{control: values[rows]})
        given = {} if times is None else {"times": times}
        found = bs.sweep(case.robot, load=load, model=model, history=history, **given)
        assert found.converged.all()
        return found

    times = case.times.get("times")
    whole = follow(slice(4), times)
    first = follow(slice(2), times and times[:2])
    stored = json.loads(json.dumps(first.history()))
    rest = follow(slice(2, 4), times and [t - times[1] for t in times[2:]], stored)
    assert np.abs(rest.tip_position - whole.tip_position[2:]).max() < 1e-8 * size
    assert np.abs(rest.tensions - whole.tensions[2:]).max() < 1e-5 * whole.tensions.max()
    if times is None:
        load = path.replace(**{control: values[2]})
        one = bs.solve(case.robot, load=load, model=model, history=stored).raise_for_status()
        assert np.abs(one.tip.position - whole.tip_position[2]).max() < 1e-8 * size


#: Units of loads in a history.
UNITS = {
    **{"gravity": "m_per_s2", "tip_force": "N", "tip_moment": "Nm"},
    **{"disk_forces": "N", "disk_moments": "Nm", "line_forces": "N_per_m"},
}


@every("files")
def test_robot_load_and_solution_go_through_files(case: Case, tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(to_yaml(case.robot))
    again = bs.load_robot(path)
    assert again == case.robot and again.hash == case.robot.hash
    assert bs.Robot.model_validate_json(case.robot.definition).hash == case.robot.hash
    found = case.solve()
    if case.row.model.tendon_path == "straight" and not case.robot.is_embedded:
        history = json.loads(json.dumps(found.history()))
        for name, unit in UNITS.items():
            if name in case.load:
                stored = np.array(history[f"{name}_{unit}"])
                np.testing.assert_array_equal(
                    np.broadcast_to(case.load[name], stored.shape), stored
                )
        kept = bs.solve(case.robot, load=found.load, model=found.model, history=history)
        assert np.abs(kept.disk_positions - found.disk_positions).max() < 1e-8
    copied = pickle.loads(pickle.dumps(found))
    assert np.abs(copied.disk_positions - found.disk_positions).max() < 1e-9
    same = bs.solve(case.robot, load=found.load, model=case.row.model)
    assert np.abs(same.disk_positions - found.disk_positions).max() < 1e-12
    if "fields" in case.lacks:
        return
    settings = json.loads(found.to_dataset().attrs["settings"])
    for name, value in case.load.items():
        stored = settings[name]
        if name == "point_loads":
            stored = [bs.PointLoad.of_dict(each) for each in stored]
            assert stored == [each.on(case.robot.core.disk_count) for each in value]
        else:
            np.testing.assert_array_equal(np.broadcast_to(value, np.shape(stored)), stored)


# -- flags --------------------------------------------------------------------------------------


FORCES = np.zeros((9, 3))
FORCES[3], FORCES[6] = [0.0, 1.0, 0.2], [-0.5, 0.0, 0.0]
MOMENTS = np.zeros((9, 3))
MOMENTS[2] = [0.02, 0.0, 0.05]
BESIDE = bs.PointLoad(4, [0.0, 0.6, 0.2], point=[0.02, 0.0, 0.05])
BETWEEN = bs.PointLoad(arc_length=0.25, force=[0.2, 0.9, -0.3])
JET = bs.PointLoad(8, [0.3, 0.2, -0.5], point=[0.0, 0.03, 0.01], follower=True)
JET_BETWEEN = bs.PointLoad(-1, [0.5, 0, 0], (0, 0, 0), [0, 0.01, 0], True, 0.47)


@pytest.mark.parametrize(
    ("flags", "load"),
    [
        ("--disk-force 4:0,1,0.2 --disk-force 7:-500mN,0,0", {"disk_forces": FORCES}),
        ("--disk-moment '3:0.02,0,50 N*mm'", {"disk_moments": MOMENTS}),
        ("--point-force 5:0,0.6,0.2@20mm,0,0.05", {"point_loads": [BESIDE]}),
        ("--point-force 250mm:0.2,0.9,-0.3", {"point_loads": [BETWEEN]}),
        ("--follower-force 9:0.3,0.2,-500mN@0,30mm,0.01", {"point_loads": [JET]}),
        ("--follower-force 0.47m:0.5,0,0@0,10mm,0", {"point_loads": [JET_BETWEEN]}),
        ("--line-force 0.3,-0.8,0.5", {"line_forces": [0.3, -0.8, 0.5]}),
    ],
)
def test_flags_are_the_loads_of_python(shell: Shell, flags: str, load: Values) -> None:
    exact = bs.solve(UNIFORM, [40, 0, 10], load=bs.Load(**load))
    found = shell.json("solve", "amouri2019", "--tension", "40,0,10", *shlex.split(flags))
    np.testing.assert_allclose(found["tip"]["position_m"], exact.tip.position, atol=1e-12)
    points = [each.to_dict() for each in load.get("point_loads", ())]
    assert (found["provenance"]["settings"]["point_loads"] or []) == points


def test_flags_of_motions_and_modes_are_the_loads_of_python(shell: Shell) -> None:
    given = ["amouri2019", "--tension", "40,0,10", "--point-force", "250mm:0.2,0.9,-0.3"]
    given += ["--disk-force", "4:0,1,0.2", "--disk-force", "7:-0.5,0,0"]
    given += ["--line-force", "0.3,-0.8,0.5"]
    load = bs.Load(disk_forces=FORCES, point_loads=[BETWEEN], line_forces=[0.3, -0.8, 0.5])
    frequency = bs.modes(UNIFORM, [40, 0, 10], load=load, count=1).frequency_hz
    found = shell.json("modes", *given, "--count", "1")["modes"][0]["frequency_hz"]
    assert found == pytest.approx(frequency[0])
    given += ["--disk-moment", "3:0.02,0,0.05", "--follower-force", "9:0.3,0.2,-0.5@0,0.03,0.01"]
    load = load.replace(disk_moments=MOMENTS, point_loads=[BETWEEN, JET])
    rest = bs.solve(UNIFORM, [40, 0, 10], load=load).tip.position
    run = ["--from", "40,0,10", "--rise", "0", "--hold", "0.02"]
    moved = shell.json("simulate", *given, *run)["tip_position_m"]
    assert np.abs(np.array(moved) - rest).max() < 2e-5
