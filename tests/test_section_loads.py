"""Loads on a section of the backbone between two disks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipk

import bowstring as bs
from bowstring.errors import InputError
from shooting import Shooting

ROBOT = bs.load_robot("amouri2019")
TENSIONS = [40.0, 5.0, 10.0]
UP = (0.0, 0.0, -9.81)
DEAD = bs.PointLoad(
    arc_length=0.25, force=[0.2, 0.9, -0.3], moment=[0.03, 0.01, -0.02], point=[0.01, 0.02, 0.01]
)
FOLLOWER = bs.PointLoad(
    arc_length=0.47, force=[0.5, -0.3, 0.4], moment=[0.0, 0.02, 0.03], follower=True
)


@pytest.mark.parametrize("theory", ["kirchhoff", "cosserat"])
def test_a_rod_without_tension_is_that_of_shooting(theory: str) -> None:
    """The estimate covers the error; bending converges with the fourth power of the elements."""
    loads, errors = [DEAD, FOLLOWER], {}
    for elements in (2, 4, 8, None):
        model = bs.RodModel(theory, elements=elements)
        load = bs.Load(gravity=UP, point_loads=loads)
        found = bs.solve(ROBOT, [0, 0, 0], load=load, model=model).raise_for_status()
        exact = Shooting(ROBOT, found, loads).solve()[0]
        errors[elements] = np.linalg.norm(exact - found.disk_positions, axis=1).max()
        assert errors[elements] <= found.error_estimate.tip
    if theory == "kirchhoff":
        assert errors[2] / errors[4] > 14 and errors[4] / errors[8] > 14
    assert errors[8] < (1e-11 if theory == "kirchhoff" else 5e-9)


@pytest.mark.parametrize("theory", ["kirchhoff", "cosserat"])
def test_a_rod_with_tension_is_that_of_shooting(theory: str) -> None:
    """At the forces of the spans of the finest elements. Held constant, these leave the rod about
    35 times softer than the robot. The estimates of fewer elements cover their distance."""
    loads, disks = [DEAD, FOLLOWER], []
    for elements in (8, 4, 2, None):
        model = bs.RodModel(theory, elements=elements)
        load = bs.Load(gravity=UP, point_loads=loads)
        found = bs.solve(ROBOT, TENSIONS, load=load, model=model).raise_for_status()
        assert found.stable
        disks.append(found.disk_positions)
        if elements == 8:
            exact = Shooting(ROBOT, found, loads).solve()[0]
            off = np.linalg.norm(exact - found.disk_positions, axis=1).max()
            assert off < 35 * found.error_estimate.tip
            assert off < (5e-9 if theory == "kirchhoff" else 3e-7)
        error = np.linalg.norm(disks[-1] - disks[0], axis=1).max()
        assert error <= found.error_estimate.tip < 1e-5 * ROBOT.length


def test_a_solver_takes_other_sections_after_each_other() -> None:
    """The robot keeps its solvers; each load divides its modules anew."""
    first = bs.solve(ROBOT, TENSIONS, load=bs.Load(point_loads=[DEAD])).tip.position
    plain = bs.solve(ROBOT, TENSIONS, model=bs.RodModel(elements=2)).tip.position
    for at in (0.25, 0.23, 0.6):
        other = bs.PointLoad(arc_length=at, force=[0, 0.5, 0])
        bs.solve(ROBOT, TENSIONS, load=bs.Load(point_loads=[other]))
        again = bs.solve(ROBOT, TENSIONS, load=bs.Load(point_loads=[DEAD])).tip.position
        assert np.abs(again - first).max() < 1e-13
    alone = bs.solve(ROBOT, TENSIONS, model=bs.RodModel(elements=2)).tip.position
    assert np.abs(alone - plain).max() < 1e-13


@pytest.mark.parametrize("theory", ["kirchhoff", "cosserat"])
def test_sections_between_the_same_disks(theory: str) -> None:
    """Without tension, against shooting; and the elements that they need."""
    draw = np.random.default_rng(5)
    for count, least in ((2, 4), (3, 4), (5, 8), (7, 8)):
        loads = [
            bs.PointLoad(
                arc_length=0.22 + 0.06 * i / count,
                force=draw.uniform(-0.3, 0.3, 3),
                moment=draw.uniform(-0.02, 0.02, 3),
                follower=bool(i % 2),
            )
            for i in range(count)
        ]
        given = bs.Load(gravity=UP, point_loads=[*loads, FOLLOWER])
        found = bs.solve(ROBOT, [0, 0, 0], load=given, model=bs.RodModel(theory))
        assert found.converged and found.model.elements == least
        exact = Shooting(ROBOT, found, [*loads, FOLLOWER]).solve()[0]
        off = np.linalg.norm(exact - found.disk_positions, axis=1).max()
        assert off <= found.error_estimate.tip + 1e-12 < 1e-7
        run = bs.simulate(ROBOT, [0, 0, 0], 0.01, load=given, model=bs.RodModel(theory))
        assert run.converged and run.settings["elements"] == least
        with pytest.raises(InputError, match=f"loads on {count} sections between two disks need"):
            bs.solve(ROBOT, [0, 0, 0], load=given, model=bs.RodModel(theory, elements=least // 2))


def test_a_path_moves_a_load_along_the_backbone() -> None:
    """The load of each step is on another section than that of the step before."""
    history = None
    for at in (0.30, 0.305, 0.35, 0.1, 0.2):
        touch = bs.PointLoad(arc_length=at, force=[0, 0.5, 0])
        load = bs.Load(displacements=[0.03, -0.01, -0.01], point_loads=[touch])
        found = bs.solve(ROBOT, load=load, history=history).raise_for_status()
        alone = bs.solve(ROBOT, load=load).raise_for_status()
        assert np.abs(found.disk_positions - alone.disk_positions).max() < 1e-9
        assert np.abs(found.centerline(7) - alone.centerline(7)).max() < 1e-9
        history = found.history()


def test_fields_jump_at_the_section() -> None:
    """Force and moment along the backbone, against statics and against shooting."""
    touch = bs.PointLoad(
        arc_length=0.255, force=[0.3, 0.8, -0.2], moment=[0.02, -0.01, 0.03], point=[0.01, 0, 0]
    )
    model = bs.RodModel(elements=8)
    found = bs.solve(ROBOT, TENSIONS, load=bs.Load(gravity=UP, point_loads=[touch]), model=model)
    data = found.to_dataset(41)
    at = data["arc_length"].to_numpy()
    inside = np.flatnonzero((at > ROBOT.disks.station_m[2]) & (at < ROBOT.disks.station_m[3]))
    turn = data["rotation"].to_numpy()[0][inside]
    force = np.einsum("pij,pj->pi", turn, data["force"].to_numpy()[0][inside])
    moment = np.einsum("pij,pj->pi", turn, data["moment"].to_numpy()[0][inside])
    place = data["position"].to_numpy()[0][inside]
    # moment about the origin, which is constant but for the weight
    about = moment + np.cross(place, force)
    k = int(np.flatnonzero(np.diff(at[inside] > 0.255))[0])
    step = at[inside][1] - at[inside][0]
    weight = float(ROBOT.mass_per_length[0]) * 9.81 * step
    jump = force[k] - force[k + 1]
    assert np.abs(jump - touch.force).max() < 2 * weight
    node = found.centerline(1000)
    s = 1000 * (0.255 / ROBOT.disks.station_m[0])
    node = node[round(s)]
    arm = node + turn[k] @ np.array(touch.point)
    own = np.cross(arm, touch.force) + touch.moment
    assert np.abs(about[k] - about[k + 1] - own).max() < 5e-4 * np.abs(own).max()
    # the curvature that belongs to the moment is that of the shape
    assert np.abs(np.diff(force[: k + 1], axis=0)).max() < 1.001 * weight
    assert np.abs(np.diff(about[: k + 1], axis=0)).max() < 1.5 * weight


def test_critical_load_of_a_column() -> None:
    """Euler's column that ends at the section: 0.1 % of pi^2 EI / (4 s^2)."""
    at = 0.6
    light = ROBOT.with_({"segments.0.disks.mass": "0 g"})
    euler = np.pi**2 * float(light.bending_stiffness[0]) / (4 * at**2)
    push = bs.PointLoad(arc_length=at, force=[0, 0, -2 * euler])
    found = bs.critical_load(
        light,
        load=bs.Load([0, 0, 0], gravity=(0, 0, 0), point_loads=[push]),
        model=bs.RodModel("kirchhoff"),
    )
    assert found.kind == "bifurcation" and found.factor == pytest.approx(0.5, rel=1e-3)
    # of the elastica P = K(m)^2 EI / s^2, with the place of its end and its angle 2 asin(sqrt(m))
    m = brentq(lambda m: ellipk(m) - np.pi / 2 * np.sqrt(1.005), 1e-6, 0.5)
    bent = 2 * np.sqrt(m) * (at / ellipk(m) + (light.length - at) * np.sqrt(1 - m))
    for share, across in ((0.995, 0.0), (1.005, bent)):
        below = bs.PointLoad(arc_length=at, force=[0, 0, -share * euler])
        found = bs.solve(
            light,
            [0, 0, 0],
            load=bs.Load(gravity=(0, 0, 0), point_loads=[below]),
            model=bs.RodModel("kirchhoff"),
        )
        assert found.converged and found.stable is True
        assert np.linalg.norm(found.tip.position[:2]) == pytest.approx(across, rel=1e-4, abs=1e-6)


def test_becks_column_ends_at_the_section() -> None:
    """A follower along the axis of a free column: flutter at 20.05 EI / s^2."""
    light = bs.load_robot(
        "amouri2019", {"segments.0.disks.mass": "1 mg", "segments.0.disks.count": 16}
    )
    at = float(light.disks.station_m[-1]) - 0.001
    beck = 20.05 * float(light.bending_stiffness[0]) / light.length**2
    for share, stable in ((0.98, True), (1.1, None), (1.5, False)):
        push = bs.PointLoad(arc_length=at, force=[0, 0, -share * beck], follower=True)
        found = bs.solve(
            light,
            [0, 0, 0],
            load=bs.Load(gravity=(0, 0, 0), point_loads=[push]),
            model=bs.RodModel("kirchhoff"),
        )
        # the straight equilibrium exists at every load
        assert found.converged and np.abs(found.tip.position[:2]).max() < 1e-9
        assert found.stable is stable


def test_one_element_takes_a_load_on_a_station() -> None:
    """It acts on the disk there."""
    model = bs.RodModel(elements=1)
    at = bs.PointLoad(arc_length=float(ROBOT.disks.station_m[3]), force=[0, 1, 0])
    found = bs.solve(ROBOT, TENSIONS, load=bs.Load(point_loads=[at]), model=model)
    same = bs.solve(
        ROBOT, TENSIONS, load=bs.Load(point_loads=[bs.PointLoad(3, [0, 1, 0])]), model=model
    )
    assert np.abs(found.disk_positions - same.disk_positions).max() < 1e-12
