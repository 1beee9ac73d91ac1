"""Branches of equilibria against classical loads and an independent continuation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.errors import InputError, NoSolutionError
from planar_branches import PlanarRod, limit_points
from shell import Shell

ROBOT = bs.load_robot("amouri2019")
LENGTH = ROBOT.length
BENDING = float(ROBOT.bending_stiffness[0])
EULER = np.pi**2 * BENDING / (4 * LENGTH**2)
THIN = bs.RodModel("kirchhoff")


def stable_beside(load: bs.Load, critical: float, **start: Any) -> list[bool | None]:
    """Stability of the straight robot at 0.5 % below and above a critical factor."""
    out = []
    for share in (0.995, 1.005):
        search = bs.BranchSearch(max_factor=share * critical, deflation=False)
        found = bs.branch_diagram(ROBOT, load=load, model=THIN, search=search, **start)
        first = found.branches[0]
        assert first.factor[-1] == pytest.approx(share * critical, rel=1e-9)
        out.append(first.stable[-1])
    return out


def test_euler_buckling() -> None:
    load = bs.Load(tip_force=[0, 0, -1])
    found = bs.critical_load(ROBOT, load=load, model=THIN)
    assert (found.kind, found.multiplicity) == ("bifurcation", 2)
    assert found.factor == pytest.approx(EULER, rel=1e-4)
    assert stable_beside(load, EULER) == [True, False]
    assert "buckles" in found.text and "N at the tip more" in found.text


def test_greenhill_self_buckling() -> None:
    rod = ROBOT.with_({"segments.0.disks.mass": "0 g"})
    per_length = float(rod.mass_per_length[0])
    found = bs.critical_load(rod, load=bs.Load(gravity=[0, 0, -1]), model=THIN)
    assert found.factor is not None
    assert found.factor * per_length * LENGTH**3 / BENDING == pytest.approx(7.8373, rel=1e-4)


def test_margin_of_a_present_load() -> None:
    now = bs.Load(tip_force=[0, 0, -4])
    found = bs.critical_load(ROBOT, load=bs.Load(tip_force=[0, 0, -5]), start=now, model=THIN)
    assert found.factor == pytest.approx(EULER - 4, rel=1e-3)
    assert f"{EULER - 4:.2f}"[:3] in found.text


def test_cables_to_the_base_raise_the_load() -> None:
    """A compressive force that points to the base buckles at four times Euler's load."""
    rod = ROBOT.with_({"segments.0.disks.count": 1, "segments.0.tendons.pitch_radius": "2.6 mm"})
    found = bs.critical_load(rod, [1, 1, 1], model=THIN)
    assert found.factor is not None
    assert 3 * found.factor == pytest.approx(4 * EULER, rel=1e-3)


def test_equal_tensions_buckle_the_modules_behind_a_long_straight_branch() -> None:
    """Steps grow where the robot stays straight; a diagram that runs out of points says so."""
    count = 30
    rod = ROBOT.with_({"segments.0.disks.count": count})
    each = EULER * (2 * count) ** 2 / 3
    found = bs.critical_load(rod, [1, 1, 1], model=THIN, max_factor=1.2 * each)
    assert found.kind == "bifurcation" and found.factor is not None
    assert 0.94 < found.factor / each < 1.0
    few = bs.BranchSearch(max_points=20, deflation=False)
    cut = bs.branch_diagram(rod, [each] * 3, model=THIN, search=few)
    assert not cut.complete and cut.branches[0].end == "points"
    last = cut.branches[0].factor[-1]
    said = f"Branch 1 was followed only up to load factor {last:.6g} ({last * each:.4g} N on tendon"
    assert said in " ".join(cut.text)


@pytest.mark.parametrize("force", [-26, -24.5, -37.3])
def test_a_column_loaded_between_disks(force: float) -> None:
    """Euler's load of the part before it; a family of equal branches is followed once."""
    at = 0.33
    point = bs.PointLoad(arc_length=at, force=[0, 0, force])
    found = bs.branch_diagram(ROBOT, load=bs.Load(point_loads=[point]), model=THIN)
    assert found.complete and not found.deflated
    assert [(b.origin, b.end) for b in found.branches] == [(None, "range"), ((0, 0), "range")]
    (event,) = found.branches[0].events
    assert -event.factor * force == pytest.approx(EULER * (LENGTH / at) ** 2, rel=1e-4)
    assert [b.factor[-1] for b in found.branches] == [1.0, 1.0]
    assert "1 bifurcation" in found.text[0]


def test_a_robot_that_its_weight_has_bent() -> None:
    """A transverse force leaves one stable equilibrium of the family, which leans with it."""
    thin = ROBOT.with_({"segments.0.backbone.diameter": "2 mm", "gravity": "0 0 -9.80665 m/s^2"})
    load = bs.Load([0, 0, 0], tip_force=[0.03, 0.04, 0])
    found = bs.branch_diagram(thin, load=load)
    assert [b.factor[0] for b in found.branches[:2]] == [0.0, 0.0]
    for branch, side in zip(found.branches, (1, -1), strict=False):
        across = branch.tip_position @ [0.6, 0.8, 0]
        assert (
            np.all(across * side > 0) and np.abs(branch.tip_position @ [0.8, -0.6, 0]).max() < 1e-8
        )
    stable = [found.branches[i].stable[k] for i, k in found.equilibria()]
    assert stable.count(True) == 1 and found.branches[0].stable[-1]
    solved = bs.solve(thin, load=load).raise_for_status()
    tip = found.branches[0].tip_position[-1]
    assert np.linalg.norm(solved.disk_positions[-1] - tip) < 1e-5 * LENGTH
    critical = bs.critical_load(thin, load=load, max_factor=1.0)
    assert critical.factor is None and critical.stable_to == 1.0


def planar_case(seed: int) -> tuple[bs.Robot, bs.Load, PlanarRod]:
    draw = np.random.default_rng(seed)
    count = int(draw.integers(2, 5))
    rod = ROBOT.with_({"segments.0.disks.count": count})
    pull = draw.uniform(0, 0.4) * BENDING / (0.029 * LENGTH)
    force = np.array([draw.uniform(0.02, 0.4) * EULER, -draw.uniform(1.2, 4.0) * EULER])
    own = draw.uniform(0, 1, 2) * pull
    tensions = [own[0], own[1], own[1]]
    load = bs.Load(tensions, tip_force=[force[0], 0, force[1]])
    arms = 0.029 * np.array([1.0, -0.5])
    planar = PlanarRod(LENGTH, BENDING, count, arms, np.array([own[0], 2 * own[1]]), force)
    return rod, load, planar


def missing_planar(seed: int) -> int:
    """Compare planar branches; the number of planar equilibria that Bowstring does not find."""
    rod, load, planar = planar_case(seed)
    found = bs.branch_diagram(rod, load=load, model=bs.RodModel("kirchhoff", elements=8))
    flat = [b for b in found.branches if np.abs(b.disk_positions[..., 1]).max() < 1e-7 * LENGTH]
    ours = np.array([b.tip_position[k][[0, 2]] for b in flat for k in b.at(1.0)])
    # the branch from the unloaded robot
    unloaded, factors = planar.branch(np.zeros(planar.size), 0.0, 1.0)
    assert len(limit_points(factors)) == sum(
        e.kind == "limit_point" for e in found.branches[0].events
    )
    last = planar.equilibrium(unloaded[-1], 1.0)
    assert last is not None
    own = found.branches[0].tip_position[found.branches[0].at(1.0)[-1]][[0, 2]]
    assert np.linalg.norm(planar.tip(last) - own) < 1e-5 * LENGTH
    # the others, and the limit points between them; a branch may join two equilibria
    theirs = planar.equilibria(30, seed)
    tips = np.array([planar.tip(q) for q in theirs])
    apart = np.linalg.norm(ours[:, None] - tips[None], axis=2)
    missing = int((apart.min(axis=0) > 2e-5 * LENGTH).sum())
    limits, ends = limit_points(factors), [planar.tip(last)]
    if missing == 0:
        for q, tip in zip(theirs, tips, strict=True):
            if np.linalg.norm(tip - ends, axis=1).min() > 1e-5 * LENGTH:
                points, factors = planar.branch(q, 1.0, -1.0)
                limits += limit_points(factors)
                end = planar.equilibrium(points[-1], 1.0)
                assert end is not None and factors[-1] > 1.0
                ends.append(planar.tip(end))
        got = np.array([e.factor for b in flat for e in b.events if e.kind == "limit_point"])
        assert all(np.abs(got - limit).min() < 1e-4 for limit in limits), (seed, got, limits)
    return missing


@pytest.mark.parametrize("seed", [0, 3, 9])
def test_branches_equal_those_of_an_independent_continuation(seed: int) -> None:
    assert missing_planar(seed) == 0


@pytest.mark.slow
def test_most_branches_of_many_robots_are_found() -> None:
    """The search is not complete: connected branches are all found, of the others most."""
    assert sum(missing_planar(seed) == 0 for seed in range(20)) >= 18


def test_every_point_is_an_equilibrium() -> None:
    load = bs.Load([10, 0, 5], tip_force=[0.3, 0.1, -15])
    found = bs.branch_diagram(ROBOT, load=load)
    assert len(found) > 1
    for branch in found.branches:
        assert branch.residual.max() < 1e-10
        assert np.isfinite(branch.disk_positions).all()
    known = bs.solve(ROBOT, load=load).raise_for_status().disk_positions
    assert known is not None
    tips = [found.branches[i].disk_positions[k] for i, k in found.equilibria()]
    assert min(np.abs(tip - known).max() for tip in tips) < 1e-5 * LENGTH


def test_bad_arguments() -> None:
    for says, arguments in (
        ("are equal", {"tensions": [0, 0, 0]}),
        ("tensions has 2 numbers", {"tensions": [1, 2]}),
        ("displacements or angles", {"load": bs.Load(displacements=[0, 0, 0])}),
        ("-1 N", {"tensions": [1, -1, 0]}),
    ):
        with pytest.raises(InputError, match=says):
            bs.branch_diagram(ROBOT, **arguments)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="friction"):
        bs.critical_load(ROBOT.with_({"segments.0.tendons.friction": 0.1}), [1, 0, 0])
    with pytest.raises(InputError, match="max_factor is -1"):
        bs.BranchSearch(max_factor=-1)
    with pytest.raises(NoSolutionError, match="load factor 0"):
        bs.critical_load(ROBOT, [2e5, 0, 0], start=bs.Load([1e5, 0, 0]))


def test_command(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "branches.svg"
    args = ("branches", "amouri2019", "--tip-force", "0.3,0,-12", "--out", str(file))
    got = shell.json(*args)
    assert [b["end"] for b in got["branches"]] == ["range", "range"]
    assert [e["kind"] for b in got["branches"] for e in b["events"]] == ["limit_point"]
    assert len(got["equilibria"]) == 3
    assert "load factor" in file.read_text()
    code, out, _ = shell(*args[:-1], str(tmp_path / "other.png"))
    assert code == 0 and "3 equilibria" in out and "limit point" in out
    assert "are equal" in shell.error("branches", "amouri2019", "--out", str(tmp_path / "a.png"))
    assert "--tension" in shell.error("branches", "amouri2019", "--tension", "1,x,0")
