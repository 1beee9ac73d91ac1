"""Distributions of numbers by path: forms, files, covariance of a calibration, bad input."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.stats
import yaml

import bowstring as bs
from bowstring.calibration import Data
from bowstring.errors import InputError
from bowstring.uncertainty import (
    CorrelatedNormal,
    LogNormal,
    Normal,
    SobolSample,
    Triangular,
    TruncatedNormal,
    Uniform,
    read_distributions,
)
from bowstring.validity.axes import read_axis
from objects import refused

E = "segments.*.backbone.E"
U = np.array([1e-6, 0.01, 0.3, 0.5, 0.9, 1 - 1e-6])


def _sigma(mean: float, sd: float) -> float:
    return math.sqrt(math.log1p((sd / mean) ** 2))


@pytest.mark.parametrize(
    ("ours", "scipys"),
    [
        (Normal(3.0, 0.5), scipy.stats.norm(3.0, 0.5)),
        (
            TruncatedNormal(Normal(0.1, 0.2), 0.0, 0.5),
            scipy.stats.truncnorm(-0.5, 2.0, 0.1, 0.2),
        ),
        (TruncatedNormal(Normal(1.0, 2.0), low=0.0), scipy.stats.truncnorm(-0.5, np.inf, 1, 2)),
        (
            LogNormal(35.0, 10.0),
            scipy.stats.lognorm(
                _sigma(35, 10), scale=35.0 * math.exp(-(_sigma(35, 10) ** 2) / 2.0)
            ),
        ),
        (Uniform(-1.0, 3.0), scipy.stats.uniform(-1.0, 4.0)),
        (Triangular(0.0, 0.1, 0.3), scipy.stats.triang(1 / 3, 0.0, 0.3)),
        (Triangular(0.0, 0.0, 2.0), scipy.stats.triang(0.0, 0.0, 2.0)),
        (Triangular(0.0, 2.0, 2.0), scipy.stats.triang(1.0, 0.0, 2.0)),
    ],
    ids=[
        "normal",
        "truncated",
        "truncated_below",
        "lognormal",
        "uniform",
        "triangular",
        "triangular_left",
        "triangular_right",
    ],
)
def test_distributions_are_those_of_scipy(ours: Any, scipys: Any) -> None:
    np.testing.assert_allclose(ours.ppf(U), scipys.ppf(U), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(ours.cdf(scipys.ppf(U)), U, rtol=1e-7)
    assert ours.mean == pytest.approx(scipys.mean()) and ours.sd == pytest.approx(scipys.std())
    assert ours.support == pytest.approx(scipys.support())


YAML = """
segments.*.backbone.E: {normal: {mean: 35 GPa, sd: 5 %}}
segments.*.backbone.diameter: {normal: {sd: 0.02 mm, from: 4.9 mm}}
segments.*.disks.mass: {lognormal: {mean: 20 g, sd: 1 g}}
segments.*.disks.clamped_length: {uniform: {from: 0 mm, to: 3 mm}}
segments.*.tendons.friction: {triangular: {from: 0, mode: 0.1, to: 0.3}}
segments.0.tendons.pitch_radius: {uniform: {from: 99 %, to: 101 %}}
gravity.2: {normal: {mean: -9.8 m/s^2, sd: 0.1 m/s^2}}
tensions.*: {uniform: {from: 98 %, to: 102 %}}
tip_force.x: {normal: {mean: 0 N, sd: 200 mN}}
"""


def test_a_file_gives_distributions_in_si(robot: bs.Robot, tmp_path: Path) -> None:
    file = tmp_path / "numbers.yaml"
    file.write_text(YAML)
    found = read_distributions(file, robot, {f"tensions.{i}": 50.0 for i in range(3)})
    assert found.independent[0] == Normal(35e9, 1.75e9)
    assert found.independent[1] == TruncatedNormal(Normal(5e-3, 2e-5), low=4.9e-3)
    assert found.independent[2:5] == (
        LogNormal(0.02, 0.001), Uniform(0.0, 0.003), Triangular(0.0, 0.1, 0.3)
    )  # fmt: skip
    assert found.independent[5].support == pytest.approx((0.99 * 0.029, 1.01 * 0.029))
    assert found.independent[7:] == (Uniform(49.0, 51.0), Normal(0.0, 0.2))
    assert found.factors[:2] == ("E", "diameter") and found.factors[-3:] == (
        "gravity.z", "tensions.*", "tip_force.x"
    )  # fmt: skip
    values = found.by_path(found.ppf(np.full((2, 9), 0.5)))
    assert set(values) >= {"segments.0.backbone.E", "tensions.0", "tensions.2", "tip_force.x"}
    np.testing.assert_allclose(values["segments.0.backbone.E"], 35e9)
    again = read_distributions(yaml.safe_load(json.dumps(found.to_dict())), robot)
    assert again.independent == found.independent and again.paths == found.paths


def test_a_star_is_one_number_for_all_segments() -> None:
    two = bs.load_robot(Path(__file__).parents[1] / "examples" / "my_robot.yaml")
    found = read_distributions({"segments.*.length": {"uniform": {"from": 0.1, "to": 0.2}}}, two)
    values = found.by_path(SobolSample(found, 8).block(0, 8))
    assert list(values) == ["segments.0.length", "segments.1.length"]
    np.testing.assert_array_equal(*values.values())


def test_python_takes_objects_and_si(robot: bs.Robot) -> None:
    given = {E: Normal(35e9, 2e9), "tip_force.z": {"uniform": {"from": -1, "to": 0.0}}}
    assert read_distributions(given, robot).independent == (Normal(35e9, 2e9), Uniform(-1.0, 0.0))


def test_the_outermost_samples_are_in_the_range_of_the_robot(robot: bs.Robot) -> None:
    """Points of 30 bits lie within 6.12 standard deviations."""
    friction = "segments.*.tendons.friction"
    read_distributions({friction: Normal(0.613, 0.1)}, robot)
    with pytest.raises(
        InputError, match=r"samples reach -0\.0121, and the robot allows at least 0; take"
    ):
        read_distributions({friction: Normal(0.60, 0.1)}, robot)


# -- covariance of a calibration ------------------------------------------------------------------


def _fit_of(names: list[str], values: list[float], errors: list[Any], rho: float) -> dict[str, Any]:
    units = {"E": "GPa", "friction": "", "x": "mm"}
    rows = [
        {"name": n, "unit": units[n.rpartition(".")[2]], "value": v, "standard_error": e}
        for n, v, e in zip(names, values, errors, strict=True)
    ]
    correlation = np.full((len(rows), len(rows)), rho)
    np.fill_diagonal(correlation, 1.0)
    return {"parameters": rows, "correlation": correlation.tolist(), "converged": True}


FITTED = ["base.x", "segments.0.backbone.E", "segments.0.tendons.friction"]


def test_correlated_samples_reproduce_the_covariance(robot: bs.Robot, tmp_path: Path) -> None:
    fit = _fit_of(FITTED, [1.0, 35.0, 0.2], [0.1, 2.0, 0.02], -0.6)
    (tmp_path / "fit.json").write_text(json.dumps(fit))
    (tmp_path / "u.yaml").write_text(
        "calibration: fit.json\ntip_force.x: {normal: {mean: 0 N, sd: 1 N}}"
    )
    found = read_distributions(tmp_path / "u.yaml", robot)
    assert found.paths == ("tip_force.x", *FITTED[1:])
    assert found.factors == ("tip_force.x", "calibration")
    samples = SobolSample(found, 4096, seed=3).block(0, 4096)
    np.testing.assert_allclose(samples.mean(axis=0), [0.0, 35e9, 0.2], rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(samples.std(axis=0), [1.0, 2e9, 0.02], rtol=0.01)
    rho = np.corrcoef(samples.T)
    np.testing.assert_allclose(rho[0, 1:], 0.0, atol=0.01)
    assert rho[1, 2] == pytest.approx(-0.6, abs=0.01)
    again = read_distributions(found.to_dict(), robot)
    assert again.correlated is not None and found.correlated is not None
    np.testing.assert_array_equal(again.correlated.covariance, found.correlated.covariance)


def test_a_path_of_its_own_replaces_that_of_the_calibration(robot: bs.Robot) -> None:
    fit = _fit_of(FITTED, [1.0, 35.0, 0.05], [0.1, 2.0, 0.02], 0.9)
    with pytest.raises(
        InputError, match=r"friction: samples reach -0\.07\d+.*give it a distribution of its"
    ):
        read_distributions({"calibration": fit}, robot)
    own = {"segments.*.tendons.friction": {"lognormal": {"mean": 0.05, "sd": 0.02}}}
    found = read_distributions({"calibration": fit, **own}, robot)
    assert found.independent == (LogNormal(0.05, 0.02), Normal(35e9, 2e9))  # E is left alone
    assert found.correlated is None


def test_the_result_of_a_fit_is_read(robot: bs.Robot) -> None:
    rng = np.random.default_rng(1)
    tensions = np.column_stack([np.linspace(5, 60, 12), np.zeros(12), np.zeros(12)])
    truth = robot.with_({"segments.0.disks.clamped_length": "2 mm"})
    tips = bs.solve_batch(truth, tensions).tip_position + rng.normal(0.0, 2e-5, (12, 3))
    names = ["segments.0.backbone.E", "segments.0.disks.clamped_length"]
    fit = bs.fit(truth, Data(tips, tensions=tensions), names)
    found = read_distributions({"calibration": fit.to_dict()}, robot)
    assert found.correlated is not None
    np.testing.assert_allclose(found.mean, list(fit.values.values()))
    np.testing.assert_allclose(
        found.sd, [1e9 * fit[names[0]].standard_error, 1e-3 * fit[names[1]].standard_error]
    )
    rho = found.correlated.covariance[0, 1] / np.prod(found.sd)
    assert rho == pytest.approx(fit.correlation[0, 1]) and abs(rho) > 0.5


def test_a_singular_covariance_has_samples() -> None:
    joint = CorrelatedNormal([1.0, 2.0], [[1.0, 2.0], [2.0, 4.0]])
    x, y = joint.ppf(np.random.default_rng(0).random((50, 2))).T
    np.testing.assert_allclose(y - 2.0, 2.0 * (x - 1.0), atol=1e-7)
    with pytest.raises(InputError, match="no negative eigenvalue"):
        CorrelatedNormal([1.0, 2.0], [[1.0, 2.0], [2.0, 1.0]])


# -- bad input ------------------------------------------------------------------------------------


def _yaml(text: str) -> Any:
    return yaml.load(text, Loader=yaml.BaseLoader)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("segments.*.backbone.Young: {normal: {sd: 5 %}}", r"has no number .*did you mean E\\?"),
        ("segments.*.tendon.friction: {normal: {sd: 1}}", r"did you mean segments\.\*\.tendons\.f"),
        ("segments.3.length: {normal: {sd: 5 %}}", r"did you mean segments\.0\.length"),
        ("segments.0.disks.count: {uniform: {from: 3, to: 9}}", "is a whole number or a share"),
        ("tip_force.w: {normal: {sd: 1 N}}", r"did you mean tip_force\.[xyz]"),
        ("tensions.3: {normal: {sd: 1 N}}", r"did you mean tensions\."),
        (f"{E}: {{normal: {{mean: 35, sd: 2 GPa}}}}", 'mean is 35 without a unit, it .*"2 G'),
        (f"{E}: {{normal: {{mean: 35 GPa, sd: 2 mm}}}}", 'sd is "2 mm", but "mm" is not a unit'),
        (f"{E}: {{normal: {{mean: much, sd: 2 GPa}}}}", 'mean is "much", which is not a number'),
        (f"{E}: {{normal: {{mean: 35 GPa, sd: 0 GPa}}}}", "sd is 0 GPa, it must be above zero"),
        (f"{E}: {{normal: {{mean: 35 GPa, sd: -1 %}}}}", r"sd is -350 MPa, it must be above zero"),
        (f"{E}: {{normal: {{mean: 35 GPa, sd: 10 GPa}}}}",
         r"samples reach -26\.2 GPa.*at least 1 Pa \(0\.00023 of them lie beyond\); take"),
        (f"{E}: {{uniform: {{from: -1 GPa, to: 2 GPa}}}}", "samples reach -1 GPa.*give bounds"),
        (f"{E}: {{uniform: {{from: 3 GPa, to: 2 GPa}}}}", "from is 3 GPa and to 2 GPa; from must"),
        (f"{E}: {{uniform: {{from: 2 GPa, to: 2 GPa}}}}", "from must be below to"),
        (f"{E}: {{normal: {{sd: 1 GPa, from: 50 GPa}}}}", "less than 1 % of this normal"),
        (f"{E}: {{triangular: {{from: 1 GPa, mode: 9 GPa, to: 2 GPa}}}}", "mode is 9 GPa, it must"),
        (f"{E}: {{lognormal: {{mean: -1 GPa, sd: 1 GPa}}}}", "lognormal must be above 0"),
        (f"{E}: {{gaussian: {{sd: 1 GPa}}}}", 'no distribution "gaussian"; known are normal, logn'),
        (f"{E}: {{sd: 5 %}}", r'no distribution "sd".*as \{normal: \{mean: .*, sd: 5 %\}\}'),
        (f"{E}: {{normal: {{std: 1 GPa}}}}", 'no field "std"; its fields are mean, from, to a'),
        (f"{E}: {{uniform: {{from: 1 GPa}}}}", "uniform lacks to; its fields are from and to"),
        (f"{E}: {{normal: 5 %}}", 'normal has "5 %"; must have the fields'),
        (f"{E}: 5 %", r'got "5 %"; must be one distribution, as {normal: {mean: 35 GPa, sd: 5 %}}'),
        ("segments.*.disks.clamped_length: {normal: {sd: 5 %}}", "of a nominal value of zero"),
        ("tip_force.x: {normal: {mean: 0 N, sd: 5 %}}", "sd needs a nominal value, and none"),
        ("tip_force.x: {normal: {sd: 1 N}}", "mean needs a nominal value, and none"),
        (f"{E}: {{normal: {{sd: 1 %}}}}\nsegments.0.backbone.E: {{normal: {{sd: 1 %}}}}",
         r"segments\.0\.backbone\.E has two distributions"),
        ("calibration: {a: 1}", "calibration has no parameters with unit"),
        ("calibration: missing.json", r"missing\.json cannot be read: No such file"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(robot: bs.Robot, given: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_distributions(_yaml(given), robot)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"converged": False}, "has not converged"),
        ({"correlation": [[1.0]]}, "has no parameters with unit"),
        ({"parameters": []}, "no parameter of the robot file"),
        (
            {"parameters": _fit_of(FITTED, [1.0, 35.0, 0.2], [0.1, 2.0, None], 0.0)["parameters"]},
            r"does not determine segments\.0\.tendons\.friction",
        ),
    ],
)
def test_a_bad_calibration_is_refused(
    robot: bs.Robot, change: dict[str, Any], message: str
) -> None:
    fit = _fit_of(FITTED, [1.0, 35.0, 0.2], [0.1, 2.0, 0.02], 0.0) | change
    refused(message, lambda: read_distributions({"calibration": fit}, robot))


def test_different_nominal_values_have_no_share() -> None:
    two = bs.load_robot(Path(__file__).parents[1] / "examples" / "my_robot.yaml")
    two = two.with_({"segments.0.backbone.E": 50e9, "segments.1.backbone.E": 60e9})
    with pytest.raises(
        InputError, match=r"nominal values differ \(50 GPa and 60 GPa\); give every"
    ):
        read_distributions({E: {"normal": {"sd": "5 %"}}}, two)


def test_a_file_is_named_in_its_errors(robot: bs.Robot, tmp_path: Path) -> None:
    file = tmp_path / "u.yaml"
    for text, message in (("", "is empty"), ("a: [", "line 2"), ("a: {b: 1}", 'has no number "a"')):
        file.write_text(text)
        with pytest.raises(InputError, match=message) as caught:
            read_distributions(file, robot)
        assert str(caught.value).startswith(str(file))
    refused("cannot be read", lambda: read_distributions(tmp_path / "none.yaml", robot))
    refused("no path", lambda: read_distributions({}, robot))


def test_a_short_path_is_that_of_an_axis_of_a_map(robot: bs.Robot) -> None:
    for short in ("E", "backbone.E", "segments[0].backbone.E", "segments.*.backbone.E"):
        one = read_distributions({short: {"normal": {"sd": "5 %"}}}, robot)
        assert one.paths == ("segments.0.backbone.E",)
        assert read_axis(f"{short}=1:2 GPa", robot).path == one.paths[0]
    for text in ("gravity.z", "gravity.2"):
        one = read_distributions({text: Normal(0.0, 1.0)}, robot)
        assert one.paths == ("gravity.z",) and one.numbers[0].targets == ("gravity.2",)
        assert read_axis(f"{text}=0:1", robot).path == "gravity.z"
    two = bs.load_robot(Path(__file__).parents[1] / "examples" / "my_robot.yaml")
    assert read_distributions({"E": Normal(5e10, 1e9)}, two).paths == ("segments.*.backbone.E",)


@pytest.mark.parametrize(
    ("distribution", "message"),
    [
        (Uniform(20e9, 30e9), r"E is 35 GPa .* above all samples \(up to 30 GPa\)"),
        (Normal(40e9, 1e9), "below almost all samples"),
        (LogNormal(20e9, 1e9), "above almost all samples"),
        (Triangular(36e9, 37e9, 40e9), r"below all samples \(from 36 GPa\)"),
    ],
)
def test_a_distribution_without_the_nominal_value_is_warned_of(
    robot: bs.Robot, distribution: Any, message: str
) -> None:
    (warning,) = read_distributions({"E": distribution}, robot).warnings
    assert re.search(message, warning)


def test_a_distribution_with_the_nominal_value_at_its_end_is_fine(robot: bs.Robot) -> None:
    given = {"clamped_length": Uniform(0.0, 0.003), "E": Normal(36e9, 1e9)}
    assert read_distributions(given, robot).warnings == ()


def test_direct_arguments_are_checked() -> None:
    for make, message in (
        (lambda: Normal(0.0, 0.0), "sd is 0, it must be positive"),
        (lambda: Normal(math.nan, 1.0), "mean is nan, it must be a finite number"),
        (lambda: Uniform(1.0, 1.0), "low is 1 and high 1, it must be less"),
        (lambda: Triangular(0.0, 3.0, 2.0), "mode is 3"),
        (lambda: LogNormal(-1.0, 1.0), "mean is -1, it must be positive"),
        (lambda: TruncatedNormal(Normal(0.0, 1.0), 5.0, 6.0), "only 2.9e-07 of the normal"),
    ):
        refused(message, make)
