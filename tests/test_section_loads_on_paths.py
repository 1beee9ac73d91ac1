"""Loads between two disks in contact and motion, against a disk without mass at their section."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bowstring as bs

BACKBONE = {"diameter": "5 mm", "E": "2 GPa", "nu": 0.3}
BOUND = {
    "length": "0.2 m",
    "backbone": BACKBONE | {"density": "1800 kg/m^3"},
    "disks": {"count": 3, "mass": "12 g", "radius": "25 mm", "thickness": "2 mm"},
    "tendons": {"count": 3, "pitch_radius": "20 mm"},
}
#: Length of the segment beyond, without tendons and mass, and of its part before the section.
FREE, BEFORE = 0.2, 0.13
TENSIONS = [6.0, 1.0, 2.0]
UP = [0.0, 0.0, -9.81]


def _beyond(length: float, mass: float) -> dict[str, Any]:
    disks = {"count": 1, "mass": mass, "radius": "25 mm", "thickness": 2e-3 if mass else 0.0}
    backbone = BACKBONE | {"density": 0.0}
    return {"length": length, "backbone": backbone, "disks": disks, "tendons": []}


#: The section of the loads is between the last two disks.
ROBOT = bs.Robot.model_validate({"name": "between", "segments": [BOUND, _beyond(FREE, 0.02)]})
#: The same with a disk without mass at the section, which no tendon passes.
WITH_DISK = bs.Robot.model_validate(
    {"name": "disk", "segments": [BOUND, _beyond(BEFORE, 0.0), _beyond(FREE - BEFORE, 0.02)]}
)
#: Without numerical damping, the release of a part without mass has no end.
HEAVY = ROBOT.with_({"segments.1.backbone.density": "1800 kg/m^3"})
#: Disks that both have.
BOTH = [0, 1, 2, 4]

DEAD: dict[str, Any] = {
    "force": [0.15, 0.1, -0.1],
    "moment": [0.01, -0.02, 0.01],
    "point": [0.01, 0.005, 0.02],
}
FOLLOWER: dict[str, Any] = {
    "force": [-0.1, 0.15, 0.1],
    "moment": [0.0, 0.01, -0.01],
    "follower": True,
}


def _loads(disk: bool, *given: dict[str, Any]) -> list[bs.PointLoad]:
    place: dict[str, Any] = {"disk": 3} if disk else {"arc_length": 0.2 + BEFORE}
    return [bs.PointLoad(**place, **each) for each in given]


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_contact_with_a_plane(friction: float) -> None:
    """A path of tensions, as with a disk there, and a rest that is that without the plane."""
    rows = [[x, 1.0, 2.0] for x in (3.0, 6.0, 9.0, 7.0)]
    model = bs.RodModel(elements=8)
    free = bs.sweep(
        ROBOT, rows, load=bs.Load(gravity=UP, point_loads=_loads(False, DEAD, FOLLOWER))
    ).tip_position
    plane = bs.Plane(free[1], [-1.0, 0.2, 0.1], friction)
    paths = [
        bs.sweep_contact(
            robot, rows, load=bs.Load(gravity=UP, point_loads=points), plane=plane, model=model
        )
        for robot, points in (
            (ROBOT, _loads(False, DEAD, FOLLOWER)),
            (WITH_DISK, _loads(True, DEAD, FOLLOWER)),
        )
    ]
    states = [found.state for found in paths[0]]
    assert states[0] == "separated" and states[2] != "separated"
    for a, b in zip(*paths, strict=True):
        assert a.converged and b.converged and a.state == b.state
        assert a.solution is not None and b.solution is not None
        assert np.abs(a.force - b.force).max() < 1e-6
        off = a.solution.disk_positions - b.solution.disk_positions[BOTH]
        assert np.abs(off).max() < 1e-7
    pushed = paths[0][2]
    assert pushed.normal_force > 0.01


def _none(load: dict[str, Any]) -> dict[str, Any]:
    return load | {"force": [0.0] * 3, "moment": [0.0] * 3}


# a start under a moment or a follower, not damped, is not known to be stable
@pytest.mark.filterwarnings("ignore::bowstring.errors.StabilityWarning")
@pytest.mark.parametrize("points", [[DEAD], [FOLLOWER], [DEAD, FOLLOWER]])
def test_a_released_robot_swings_with_the_energy_of_its_start(points: list[dict[str, Any]]) -> None:
    """Loads between disks hold it at the start only: its energy is that of their equilibrium, and
    changes by the work of the tensions alone. Damped, it ends in the rest without those loads."""
    model = bs.RodModel(elements=2)
    held = bs.Load(TENSIONS, point_loads=_loads(False, *points))
    load = bs.Load(gravity=UP, point_loads=_loads(False, *map(_none, points)))
    begin = bs.solve(HEAVY, load=held.replace(gravity=UP), model=model)
    assert begin.converged

    def moving(duration: float, **steps: float) -> bs.Run:
        return bs.simulate(
            HEAVY,
            TENSIONS,
            duration,
            load=load,
            start=bs.Start(held),
            model=model,
            integrator=bs.Integrator(**steps),
        ).raise_for_status()

    run = moving(0.3, dt=1e-3, spectral_radius=1.0)
    # the weight of the backbone is lumped by another rule in motion
    assert np.abs(run.tip_position[0] - begin.tip.position).max() < 3e-6
    data = run.to_dataset()
    elastic = float(begin.to_dataset()["elastic_energy"][0])
    assert float(data["elastic_energy"][0]) == pytest.approx(elastic, rel=1e-4)
    total = data["kinetic_energy"] + data["elastic_energy"] + data["gravity_energy"]
    lengths = data["tendon_length"].to_numpy()
    work = -(lengths - lengths[0]) @ np.array(TENSIONS)
    scale = float(data["kinetic_energy"].max())
    assert scale > 1e-3 and np.ptp(run.tip_position, axis=0).max() > 0.02
    assert np.abs(data["work"] - data["work"][0] - work).max() < 1e-9 * scale
    assert np.abs(total - total[0] - work).max() < 1e-4 * scale
    rest = bs.solve(HEAVY, TENSIONS, load=bs.Load(gravity=UP), model=model).raise_for_status()
    end = moving(3.0, mass_damping=20.0).tip_position[-1]
    assert np.linalg.norm(end - rest.tip.position) < 1e-6


def test_modes_under_a_force_between_disks() -> None:
    """They are those of the robot with a disk there."""
    dead = {"force": [0.0, 0.0, -0.1], "point": [0.0, 0.0, 0.02]}
    both = [
        bs.modes(
            robot,
            TENSIONS,
            load=bs.Load(gravity=UP, point_loads=_loads(disk, dead)),
            model=bs.RodModel(elements=8),
        ).frequency_hz
        for robot, disk in ((ROBOT, False), (WITH_DISK, True))
    ]
    np.testing.assert_allclose(both[0], both[1], rtol=1e-6)
    bare = bs.modes(ROBOT, TENSIONS, load=bs.Load(gravity=UP)).frequency_hz
    assert np.abs(both[0][:2] / bare[:2] - 1.0).max() > 1e-2
