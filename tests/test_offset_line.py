"""A plain robot in another description, whose sections are coupled: the same robot.

The reference line of the second robot is parallel to the backbone's axis, so that its stiffness
matrix has couplings. Holes, masses and loads are where they were. The first robot is solved by the
equations of plain sections.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.dynamics import modes, ramp

LENGTH, DISKS, DIAMETER, YOUNG, POISSON = 0.4, 4, 0.001, 1.25e12, 0.3
AREA, SECOND = np.pi / 4 * DIAMETER**2, np.pi / 64 * DIAMETER**4
SHEAR = YOUNG / (2 * (1 + POISSON))
BENDING = YOUNG * SECOND
STIFFNESS = np.diag([BENDING] * 2 + [2 * SHEAR * SECOND] + [SHEAR * AREA] * 2 + [YOUNG * AREA])
ANGLES = np.radians([0.0, 120.0, 240.0])
HOLES = 0.02 * np.stack([np.cos(ANGLES), np.sin(ANGLES), np.zeros(3)], axis=-1)
CENTRE = np.array([0.003, 0.002, 0.004])
GRAVITY = [1.0, 2.0, -9.0]
TENSIONS = [6.0, 1.0, 3.0]
#: Distance of all disks in m up to which the two robots are the same: shear and extension of an
#: element are integrated by other rules.
SAME = 1e-8


def _robot(offset: Floats, backbone: dict[str, Any], **tendons: Any) -> bs.Robot:
    holes = HOLES - offset
    each = [
        {
            "angle": float(np.arctan2(y, x)),
            "pitch_radius": float(np.hypot(x, y)),
            "compliance": "0.02 mm/N",
            **tendons,
        }
        for x, y, _ in holes
    ]
    body = {"mass": "15 g", "centre": (CENTRE - offset).tolist(), "inertia": "3 4 5 kg*mm^2"}
    segment = {
        "length": LENGTH,
        "backbone": backbone,
        "disks": {"count": DISKS, "mass": "0 g", "radius": "30 mm", "thickness": "0 mm"},
        "tendons": each,
    }
    payloads = [{**body, "disk": k + 1} for k in range(DISKS)]
    return bs.Robot.model_validate({"name": "rod", "segments": [segment], "payloads": payloads})


@dataclass(frozen=True)
class Pair:
    """A robot, and the same by a line with an offset from its axis."""

    plain: bs.Robot
    other: bs.Robot
    offset: Floats

    @classmethod
    def of(cls, offset: Any, **tendons: Any) -> Pair:
        round_ = {"diameter": DIAMETER, "E": YOUNG, "nu": POISSON, "density": 0.0}
        x, y, z = offset = np.array(offset)
        # strains of the axis by those of the line: v = v' - u x offset
        back = np.eye(6)
        back[3:, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
        stiffness = back.T @ STIFFNESS @ back
        # no effect, but without couplings the core would take it for the plain section
        stiffness[3, 3] *= 1.0 + 1e-12
        coupled = {"stiffness": stiffness.tolist(), "mass_per_length": 0.0, "diameter": DIAMETER}
        plain = _robot(np.zeros(3), round_, **tendons)
        return cls(plain, _robot(offset, coupled, **tendons), offset)

    def axis(self, position: Any, rotation: Any) -> Floats:
        """Positions on the axis of the second robot, in the base frame of the first."""
        moved: Floats = np.asarray(position) + self.offset - np.asarray(rotation) @ self.offset
        return moved

    def load(self, **given: Any) -> tuple[bs.Load, bs.Load]:
        """Load of both; point loads are given by points from the axis."""
        points = given.pop("point_loads", [])
        moved = [replace(p, point=tuple(np.array(p.point) - self.offset)) for p in points]
        both = [{**given, "point_loads": loads} if loads else given for loads in (points, moved)]
        return bs.Load(**both[0]), bs.Load(**both[1])

    def are_same(self, a: bs.Solution, b: bs.Solution, within: float = SAME) -> None:
        """Hold two solutions to the same tensions and disks."""
        assert a.converged and b.converged
        assert np.abs(a.tensions - b.tensions).max() < 1e4 * within
        assert np.abs(a.disk_rotations - b.disk_rotations).max() < within / 0.02
        on_axis = self.axis(b.disk_positions, b.disk_rotations)
        assert np.abs(a.disk_positions - on_axis).max() < within


DEAD = bs.PointLoad(1, force=[0.3, -0.5, 0.2], moment=[0.01, 0.0, 0.02], point=[0.01, 0.0, 0.02])
FOLLOWER = bs.PointLoad(
    force=[0.2, 0.3, -0.4], moment=[0.0, 0.02, 0.01], point=[0.0, 0.01, 0.0], follower=True
)
ON_SECTION = bs.PointLoad(
    arc_length=0.153, force=[0.2, 0.4, -0.3], moment=[0.0, 0.03, 0.02], point=[0.01, 0.0, 0.0]
)
TURNING = bs.PointLoad(
    arc_length=0.371, force=[-0.3, 0.1, -0.2], moment=[0.02, 0.0, 0.01], follower=True
)
FINE = bs.RodModel(elements=4)
SECTIONS = pytest.mark.parametrize(
    "sections", [[], [ON_SECTION, TURNING]], ids=["disks", "sections"]
)


@pytest.fixture(params=[[0.004, -0.003, 0.0], [0.0, 0.0, 0.0]], ids=["beside", "axis"])
def pair(request: pytest.FixtureRequest) -> Pair:
    return Pair.of(request.param)


def test_the_other_description_is_coupled(pair: Pair) -> None:
    assert pair.other.is_coupled and not pair.plain.is_coupled


@pytest.mark.parametrize(
    "points",
    [
        [],
        [DEAD],
        [FOLLOWER],
        [DEAD, FOLLOWER],
        [ON_SECTION],
        [TURNING],
        [replace(ON_SECTION, arc_length=0.11), ON_SECTION, TURNING, FOLLOWER],
    ],
)
def test_dead_loads_and_followers(pair: Pair, points: list[bs.PointLoad]) -> None:
    here, there = pair.load(tensions=TENSIONS, gravity=GRAVITY, point_loads=points)
    found = [bs.solve(r, load=x, model=FINE) for r, x in ((pair.plain, here), (pair.other, there))]
    pair.are_same(*found)
    assert found[0].stable is found[1].stable
    assert points or found[0].stable is True
    # without the loads the disks are elsewhere
    bare = bs.solve(pair.plain, [0, 0, 0], model=FINE).disk_positions
    assert np.abs(bare - found[0].disk_positions).max() > 0.02


@SECTIONS
def test_friction_along_a_path(pair: Pair, sections: list[bs.PointLoad]) -> None:
    """Loading and unloading by displacements, then by tensions: each hysteresis is the same."""
    rough = Pair.of(pair.offset, friction=0.15)
    up = np.linspace(0.0, 0.015, 4)
    by_displacement = [[x, -x / 2, -x / 2] for x in (*up, *up[-2::-1], 0.005)]
    by_tension = [[x, 2.0, 1.0] for x in (2.0, 5.0, 8.0, 5.0, 2.0)]
    for name, rows in (("displacements", by_displacement), ("tensions", by_tension)):
        loads = rough.load(**{name: rows}, gravity=GRAVITY, point_loads=[FOLLOWER, *sections])
        a, b = (
            bs.sweep(r, load=x, model=FINE)
            for r, x in zip((rough.plain, rough.other), loads, strict=True)
        )
        assert a.converged.all() and b.converged.all()
        on_axis = rough.axis(b.disk_positions, b.disk_rotations)
        assert np.abs(a.disk_positions - on_axis).max() < 10 * SAME
        assert np.abs(a.tensions - b.tensions).max() < 1e-4
        # on the way back the robot is elsewhere
        there, back = (1, 5) if name == "displacements" else (1, 3)
        assert np.linalg.norm(a.tip_position[there] - a.tip_position[back]) > 1e-4


@pytest.mark.parametrize("at", [{"disk": 1}, {"arc_length": 0.153}])
def test_natural_frequencies(pair: Pair, at: dict[str, Any]) -> None:
    dead = bs.PointLoad(**at, force=DEAD.force, point=DEAD.point)
    here, there = pair.load(tensions=TENSIONS, gravity=GRAVITY, point_loads=[dead])
    a = modes(pair.plain, load=here, model=FINE, count=20)
    b = modes(pair.other, load=there, model=FINE, count=20)
    assert a.frequency_hz[0] > 0.5 and a.kind == b.kind and set(a.kind) == {"bending", "torsion"}
    np.testing.assert_allclose(b.frequency_hz, a.frequency_hz, rtol=1e-6)


@pytest.mark.parametrize(
    "damping",
    [{}, {"mass_damping": 3.0}, {"material_damping": 0.004}, {"modal_damping": 0.05}],
    ids=["none", "mass", "material", "modal"],
)
@SECTIONS
def test_motions_without_and_with_damping(
    pair: Pair, damping: dict[str, float], sections: list[bs.PointLoad]
) -> None:
    """Under tensions, dead loads and followers that rise, until the robot swings back."""

    def rising(load: bs.PointLoad) -> bs.PointLoad:
        force, moment = ramp(np.array(load.force), 0.05), ramp(np.array(load.moment), 0.05)
        return replace(load, force=force, moment=moment)

    points = [rising(load) for load in (DEAD, FOLLOWER, *sections)]
    loads = pair.load(gravity=[0.0, 0.0, -5.0], point_loads=points)
    steps = bs.Integrator(dt=2e-3, spectral_radius=1.0, **damping)
    model = bs.RodModel(elements=2) if sections else bs.RodModel()
    a, b = (
        bs.simulate(r, ramp(TENSIONS, 0.05), 0.3, load=x, model=model, integrator=steps)
        for r, x in zip((pair.plain, pair.other), loads, strict=True)
    )
    first, second = a.raise_for_status().to_dataset(), b.raise_for_status().to_dataset()
    tip = second["disk_position"][:, -1].to_numpy(), second["disk_rotation"][:, -1].to_numpy()
    assert np.abs(pair.axis(*tip) - a.tip_position).max() < 5e-7
    scale = float(np.abs(first["work"]).max())
    for name in ("kinetic_energy", "elastic_energy", "gravity_energy", "work", "dissipated_energy"):
        assert np.abs(first[name] - second[name]).max() < 1e-5 * scale, name
    assert np.abs(second["energy_balance"]).max() < 1e-4 * scale
    lost = float(second["dissipated_energy"][-1])
    assert lost > 0.01 * scale if damping else lost == 0.0


@pytest.mark.parametrize("at", [{}, {"arc_length": 0.37}])
def test_a_branch_diagram(pair: Pair, at: dict[str, float]) -> None:
    """Buckling under a dead force, with a small transverse one: all equilibria are the same."""
    euler = np.pi**2 / 4 * BENDING / at.get("arc_length", LENGTH) ** 2
    push = bs.PointLoad(**at, force=[0.02 * euler, 0.01 * euler, -1.5 * euler])
    loads = pair.load(tensions=[0, 0, 0], point_loads=[push])
    a, b = (
        bs.branch_diagram(r, load=x, model=FINE)
        for r, x in zip((pair.plain, pair.other), loads, strict=True)
    )
    assert len(a.equilibria()) == 3

    def tips(found: bs.BranchDiagram, of: Pair | None) -> list[tuple[float, ...]]:
        out = []
        for i, k in found.equilibria():
            branch = found.branches[i]
            tip = branch.disk_positions[k, -1]
            if of is not None:
                tip = of.axis(tip, branch.disk_rotations[k, -1])
            out.append((*tip, float(branch.stable[k] is True)))
        return sorted(out)

    np.testing.assert_allclose(tips(b, pair), tips(a, None), atol=100 * SAME)
    events = [sorted((e.kind, e.factor) for _, e in found.events) for found in (a, b)]
    assert [kind for kind, _ in events[0]] == [kind for kind, _ in events[1]] == ["limit_point"]
    assert events[1][0][1] == pytest.approx(events[0][0][1], rel=1e-5)
