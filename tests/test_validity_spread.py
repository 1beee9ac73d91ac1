"""Validity limits where numbers of the robot are uncertain."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.shell import Shell

import bowstring as bs
from bowstring.constant_curvature import RobotArcs
from bowstring.errors import InputError
from bowstring.uncertainty import SaltelliDesign, read_distributions
from bowstring.validity.loading import Loading
from bowstring.validity.spread import Spread, assumed_distributions, validity_spread
from objects import legend_of

ROBOT = bs.load_robot("amouri2019")
E = "segments.*.backbone.E"
DISTRIBUTIONS = {
    E: {"normal": {"sd": "2 %"}},
    "segments.*.tendons.pitch_radius": {"normal": {"sd": "0.1 mm"}},
    "tip_force.y": {"normal": {"mean": 0.0, "sd": 0.01}},
}


def design(numbers: dict[str, Any], points: int = 64) -> SaltelliDesign:
    return SaltelliDesign(read_distributions(numbers, ROBOT), points)


@pytest.fixture(scope="module")
def found() -> Spread:
    return validity_spread(ROBOT, design(DISTRIBUTIONS, 256))


@pytest.fixture(scope="module")
def held() -> Spread:
    """A model that holds everywhere."""
    by_lengths = {E: {"normal": {"sd": "2 %"}}}
    return validity_spread(ROBOT, design(by_lengths), name="cc_from_lengths")


@pytest.fixture(scope="module")
def wide() -> Spread:
    """Limits beyond the end of the sweep."""
    numbers = {E: {"normal": {"sd": "5 %"}}}
    return validity_spread(ROBOT, design(numbers), loading=Loading(60.0))


def test_the_limit_of_each_sample_is_that_of_its_robot(found: Spread) -> None:
    """Constant curvature keeps the nominal numbers; the crossing is found on 401 loads."""
    samples = SaltelliDesign(found.distributions, 256)
    rows = samples.block(0, len(samples))[samples.rows_of_sample]
    force = np.linspace(0.0, found.max_tension, 401)
    tensions = np.outer(force, [1.0, 0.0, 0.0])
    arcs = RobotArcs.from_tensions(ROBOT, tensions).tip.position
    for i in range(0, 256, 32):
        values = found.distributions.by_path(rows[i : i + 1])
        push = float(values.pop("tip_force.y")[0])
        robot = ROBOT.with_({path: float(v[0]) for path, v in values.items()})
        sweep = bs.sweep(robot, tensions, load=bs.Load(tip_force=[0.0, push, 0.0]), disks=False)
        error = np.linalg.norm(arcs - sweep.tip_position, axis=1)
        over = np.flatnonzero(error > 0.01 * ROBOT.length)
        assert found.error[i] == pytest.approx(error[-1] / ROBOT.length, rel=1e-6)
        if over.size:
            assert found.limit[i] == pytest.approx(force[over[0]], abs=0.3)
        else:
            assert np.isinf(found.limit[i])


def test_a_number_that_does_not_matter_has_no_share(found: Spread) -> None:
    """A force across the bending plane moves the tip in second order of the error only."""
    total = dict(zip(found.error_indices.factors, found.error_indices.total.value, strict=True))
    assert total["E"] > 0.8 and total["tip_force.y"] < 0.05
    assert "E causes " in found.text[0]


def test_a_model_that_holds_everywhere_says_so(held: Spread) -> None:
    assert np.isinf(held.limit).all() and held.limit_indices is None
    assert "up to 80 N in 100 % of the samples" in held.text[0]
    assert held.error_summary.probability is not None
    assert held.error_summary.probability.value == 1.0
    assert "With 64 samples that share is known to 94 to 100 %" in held.text[0]


@pytest.mark.parametrize(
    ("distributions", "message"),
    [
        ({"tensions.0": {"normal": {"mean": 9.0, "sd": 1.0}}}, "cannot vary here"),
        ({"pretension": {"uniform": {"from": 0.0, "to": 9.0}}}, "changes nothing"),
        ({"hole_clearance": {"uniform": {"from": 0.0, "to": 1e-3}}}, "changes nothing"),
        ({"segments.*.backbone.young": {"normal": {"sd": "5 %"}}}, "did you mean"),
        ({E: {"normal": {"mean": 1e9, "sd": 1e9}}}, "log-normal|lognormal"),
        ({"pitch_radius": {"normal": {"sd": "5 %"}}}, "samples reach a robot that is refused"),
    ],
)
def test_bad_distributions_are_refused(distributions: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        validity_spread(ROBOT, distributions)


@pytest.mark.parametrize(
    ("robot", "changes", "varied"),
    [
        ("rao2021", {"segments.0.backbone.E": 60e9}, ["0.backbone.E", "1.backbone.E"]),
        ("rao2021", {"segments.0.tendons.*.pitch_radius": 6e-3}, ["0.tendons.", "1.tendons."]),
        ("amouri2019", {"segments.0.disks.radius": 29.5e-3}, []),  # holes next to the rim
    ],
)
def test_the_assumed_numbers_are_those_that_the_robot_lets_vary(
    robot: str, changes: dict[str, float], varied: list[str]
) -> None:
    changed = bs.load_robot(robot).with_(changes)
    assumed = assumed_distributions(changed)
    assert all(any(part in path for path in assumed.paths) for part in varied)
    assert any(path.endswith(".E") for path in assumed.paths)
    spread = validity_spread(changed, SaltelliDesign(assumed, 32), loading=Loading(points=5))
    assert spread.limit_text


def test_friction_makes_each_sample_a_path() -> None:
    """Constant curvature from force knows no friction, so its limit follows from the path."""
    friction = "segments.*.tendons.friction"
    numbers = {friction: {"uniform": {"from": 0.1999, "to": 0.2001}}}
    found = validity_spread(ROBOT, design(numbers))
    tensions = np.outer(np.linspace(0.0, 60.0, 241), [1.0, 0.0, 0.0])
    path = bs.sweep(ROBOT.with_({"segments.0.tendons.friction": 0.2}), tensions)
    arcs = RobotArcs.from_tensions(ROBOT, tensions[1:]).tip.position
    error = np.linalg.norm(arcs - path.tip_position[1:], axis=-1) / ROBOT.length
    limit = np.interp(found.tolerance, error, tensions[1:, 0])
    assert error[-1] > found.tolerance
    np.testing.assert_allclose(found.limit, limit, rtol=2e-3)


def test_rods_of_another_theory() -> None:
    """Without shear and extension the limit is another one, but not far from it."""
    sure = {E: {"normal": {"sd": "0.001 %"}}}
    limits = [
        validity_spread(ROBOT, design(sure), model=bs.RodModel(theory)).nominal
        for theory in ("cosserat", "kirchhoff")
    ]
    assert limits[0] != limits[1]
    assert limits[0] == pytest.approx(limits[1], rel=0.01)


def test_the_command(shell: Shell, tmp_path: Path) -> None:
    file, figure = tmp_path / "distributions.yaml", tmp_path / "spread.svg"
    file.write_text(f"{E}: {{normal: {{sd: 2 %}}}}\n")
    args = ("uncertainty", "amouri2019", "--distributions", str(file), "--samples", "64")
    content = shell.json(*args, "--out", str(figure))
    assert content["nominal_limit_N"] == pytest.approx(56.09, abs=0.1)
    assert content["error_indices"][0]["factor"] == "E" and figure.exists()
    code, out, _ = shell(*args, "--out", str(figure), "--max-tension", "40 N")
    assert code == 0 and "holds to 1 % of length up to" in out
    assert "--distributions" in shell.error(*args[:2], "--distributions", str(tmp_path / "no.yaml"))


def test_the_figure_has_all_samples_and_the_median(found: Spread) -> None:
    above = found.figure().axes[0]
    held = np.isinf(found.limit).mean()
    assert held > 0.0
    shares = sum(bar.get_height() for bar in above.patches)  # of the histogram and of the end
    assert shares == pytest.approx(100.0)
    assert above.patches[-1].get_height() == pytest.approx(100.0 * held)
    labels = legend_of(above)
    assert f"holds to the end: {100.0 * held:.0f} %" in labels
    median = above.lines[labels.index("median")].get_xdata()
    np.testing.assert_allclose(median, np.quantile(found.limit, 0.5), rtol=0.02)


def test_the_command_warns_of_a_robot_outside_its_distribution(
    shell: Shell, tmp_path: Path
) -> None:
    file = tmp_path / "u.yaml"
    file.write_text("E: {uniform: {from: 20 GPa, to: 30 GPa}}\n")
    args = ("uncertainty", "amouri2019", "--distributions", str(file), "--samples", "64")
    code, _, err = shell(*args, "--out", str(tmp_path / "u.png"))
    assert code == 0 and "Warning: segments.0.backbone.E is 35 GPa" in err
    assert "35 GPa" in shell.json(*args, "--out", str(tmp_path / "u.png"))["warnings"][-1]
    file.write_text("E: {normal: {sd: 5 %}}\n")
    said = shell.error(*args[:-1], "100")
    assert "--samples: got 100" in said and "power of two" in said


def test_loads_may_be_given() -> None:
    load = bs.Load(gravity=[0.0, 0.0, 9.81])
    numbers = design({E: {"normal": {"sd": "1 %"}}})
    found = validity_spread(ROBOT, numbers, load=load, loading=Loading(40.0, 9))
    assert found.max_tension == 40.0 and np.isfinite(found.error).all()


def test_the_interval_has_two_ends_also_beyond_the_sweep(wide: Spread) -> None:
    assert wide.limit_summary.quantiles[0.975].value == np.inf
    assert " N to more than 60 N); E causes about" in wide.text[0]


def test_samples_that_hold_nowhere_are_counted() -> None:
    """A transverse gravity bends the straight robot, which constant curvature does not know."""
    numbers = {"gravity.x": {"normal": {"mean": 0.0, "sd": 3.0}}}
    lost = validity_spread(ROBOT, design(numbers, 256))
    share = (lost.limit == 0.0).mean()
    assert lost.share_exceeded == share and 0.5 < share < 0.9
    assert lost.to_dict()["exceeded_at_first_load_percent"] == pytest.approx(100.0 * share)
    words = f"In {100.0 * share:.0f} % of the samples constant curvature from force exceeds 1 %"
    assert lost.text[0].startswith(words) and "up to 0 N" not in lost.text[0]
    assert lost.limit_text == f"0 N in {100.0 * share:.0f} % of the samples"
    numbers["gravity.x"] = {"normal": {"mean": 0.0, "sd": 0.8}}
    few = validity_spread(ROBOT, design(numbers, 256))
    assert 0.025 < few.share_exceeded < 0.5
    assert f"{100.0 * few.share_exceeded:.0f} % of the samples exceed the tolerance" in few.text[0]


def test_samples_and_their_sampling_error_are_stated(found: Spread) -> None:
    """That of the median: order statistics of a binomial distribution, as in other software."""
    from scipy.stats import binom

    ends = np.sort(found.limit)[binom.ppf([0.025, 0.975], 256, 0.5).astype(int)]
    said = found.text[0]
    assert said.startswith("In the median of 256 samples constant curvature from force holds")
    low, high = said.split("The median is known to ")[1].split(" N.")[0].split(" to ")
    np.testing.assert_allclose([float(low), float(high)], ends, rtol=0.02)


def test_the_legend_names_the_bound_that_is_drawn(wide: Spread) -> None:
    for top, label in (
        (wide, "97.5 % of the samples lie above"),
        (replace(wide, limit_summary=wide.error_summary), "95 % of the samples"),
    ):
        texts = legend_of(top.figure().axes[0])
        assert label in texts and sum("of the samples" in text for text in texts) == 1


def test_samples_that_are_not_solved_to_their_limit_are_counted() -> None:
    """With a tolerance that no arc exceeds, the limit is where the solved loads of a robot end."""
    wide = {E: {"uniform": {"from": 20e9, "to": 60e9}}}
    found = validity_spread(ROBOT, design(wide), loading=Loading(1000.0, 5), tolerance=0.95)
    assert 0.02 < (~found.solved).mean() < 0.9 and found.nominal_solved
    lost = found.limit[~found.solved]
    assert np.isfinite(lost).all() and np.isnan(found.error[~found.solved]).all()
    share = found.to_dict()["not_solved_percent"]
    assert share == pytest.approx(100.0 * (~found.solved).mean())
    assert "% of the samples are not solved to their limit" in found.text[0]
    assert "nominal robot holds up to 1000 N or more" in found.text[0]
    short = replace(found, nominal=875.0, nominal_solved=False)
    assert "holds as far as it is solved, up to 875 N" in short.text[0]
    none = replace(found, nominal=float("nan"), nominal_solved=False)
    assert "The nominal robot has no limit" in none.text[0] and "or more" not in none.text[0]
