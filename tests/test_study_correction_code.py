"""The corrected constant curvature as code: Python and C give what the package gives.

Polynomials give the tip of the rod as nearly as they say.
"""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bowstring as bs
from bowstring.constant_curvature import RobotArcs
from bowstring.errors import InputError
from bowstring.formatting import in_mm
from bowstring.study import correction_polynomial
from bowstring.study.comparison import Model
from bowstring.study.correction_code import correction_code
from bowstring.study.correction_polynomial import TipPolynomial, tip_polynomials
from bowstring.study.study import Study
from bowstring.study.verdict import Verdict
from stages import Stages

EXAMPLES = Path(__file__).parent.parent / "examples"

ROBOTS = {
    "amouri2019": {},
    "clamps and thick disks": {
        "segments.0.disks.clamped_length": "8 mm",
        "segments.0.disks.hole_length": "4 mm",
        "segments.0.disks.thickness": "4 mm",
    },
    "rao2021": {},
    "crl-ftdcr-v4": {},
    "opposite pair": {"segments.0.tendons": {"count": 2, "pitch_radius": "29 mm"}},
}

FITTED = {
    "upright": {"gravity": "0 0 -9.81 m/s^2"},
    "lying": {"gravity": "9.81 0 0 m/s^2"},
    "bent without load": {"segments.0.backbone.rest_bend": "40 deg", "gravity": "0 0 0"},
    "opposite pair in gravity": {
        "segments.0.tendons": {"count": 2, "pitch_radius": "29 mm"},
        "gravity": "0 0 -9.81 m/s^2",
    },
    "one tendon": {"segments.0.tendons.count": 1, "gravity": "0 0 0"},
}

Found = tuple[Study, np.ndarray, np.ndarray]


@pytest.fixture(scope="module", params=ROBOTS)
def found(request: pytest.FixtureRequest, paper: Study) -> Found:
    """A study, random tensions (10, T), and tendon lengths of the rod under them."""
    name = request.param if request.param in bs.robot_names() else "amouri2019"
    robot = bs.load_robot(name, {"gravity": "0 0 0", **ROBOTS[request.param]})
    return _loads(Stages(robot, tendon=1).over(paper))


@pytest.fixture(scope="module", params=FITTED)
def fitted(request: pytest.FixtureRequest, paper: Study) -> Found:
    """The same of robots whose corrected arcs do not serve."""
    stages = Stages(bs.load_robot("amouri2019", FITTED[request.param]), tendon=1)
    return _loads(replace(stages.over(paper), verdict=stages.judged(paper.budget)))


def _loads(study: Study) -> Found:
    robot = study.robot
    rng = np.random.default_rng(4)
    tensions = study.settings.max_tension * rng.uniform(size=(10, len(robot.tendons.segment)))
    tensions *= 0.4 / len(robot.segments)
    tensions[0] = 0.0
    return study, tensions, bs.sweep(robot, tensions).tendon_lengths


def _python(study: Study) -> dict[str, Callable[[list[float]], list[float]]]:
    made: dict[str, Callable[[list[float]], list[float]]] = {}
    exec(compile(correction_code(study, "python"), "correction.py", "exec"), made)
    return made


def _fits(verdict: Verdict) -> list[TipPolynomial | None]:
    """Polynomials from lengths and from tensions."""
    return [m.polynomial for m in verdict.meanings]


def _c(study: Study, folder: Path) -> ctypes.CDLL:
    source = folder / "correction.c"
    source.write_text(correction_code(study, "c"))
    library = folder / "correction.so"
    flags = ["-std=c99", "-O1", "-Wall", "-Werror", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, str(source), "-o", str(library), "-lm"], check=True)
    return ctypes.CDLL(str(library))


def test_python_is_the_package(found: Found) -> None:
    study, tensions, lengths = found
    made = _python(study)
    assert _fits(study.verdict) == [None, None]
    for name, rows, arcs in (
        ("tip_from_tensions", tensions, RobotArcs.from_tensions(study.robot, tensions, "arm")),
        ("tip_from_lengths", lengths, RobotArcs.from_lengths(study.robot, lengths, "chord")),
    ):
        tips = np.array([made[name](row.tolist()) for row in rows])
        np.testing.assert_allclose(tips, arcs.tip.position, atol=1e-12)


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_c_is_the_package(found: Found, tmp_path: Path) -> None:
    study, tensions, lengths = found
    made = _c(study, tmp_path)
    for name, rows, arcs in (
        ("tensions", tensions, RobotArcs.from_tensions(study.robot, tensions, "arm")),
        ("lengths", lengths, RobotArcs.from_lengths(study.robot, lengths, "chord")),
    ):
        for row, tip in zip(rows, arcs.tip.position, strict=True):
            out = (ctypes.c_double * 3)()
            made[f"correction_tip_from_{name}"]((ctypes.c_double * len(row))(*row), out)
            assert list(out) == pytest.approx(tip.tolist(), abs=1e-12)


def test_polynomials_are_as_near_to_the_rod_as_they_say(fitted: Found) -> None:
    study, tensions, lengths = fitted
    rod = bs.sweep(study.robot, tensions).tip_position
    made = _python(study)
    assert "gravity" in made["__doc__"]  # type: ignore[operator]
    for name, rows, fit, meaning in zip(
        ("lengths", "tensions"),
        (lengths, tensions),
        _fits(study.verdict),
        study.verdict.meanings,
        strict=True,
    ):
        tips = np.array([made[f"tip_from_{name}"](row.tolist()) for row in rows])
        np.testing.assert_allclose(tips, fit.tip(rows), atol=1e-12)
        error = np.linalg.norm(tips - rod, axis=1).max()
        assert error < 1.2 * fit.max_error < 0.12 * study.verdict.tolerance_length
        assert meaning.valid_throughout or fit.max_error < 0.1 * meaning.max_error


def test_polynomials_refuse_what_is_outside_their_range(fitted: Found) -> None:
    study, _, lengths = fitted
    made, top = _python(study), study.settings.max_tension
    wrong = [[-0.1], [1.1 * top], [float("nan")]]
    if more := len(lengths[0]) - 1:
        wrong = [each + more * [1.0] for each in wrong] + [[0.5 * top] + more * [0.6 * top / more]]
    for row in wrong:
        with pytest.raises(ValueError, match="outside the range"):
            made["tip_from_tensions"](row)
    with pytest.raises(ValueError, match="outside the range"):
        made["tip_from_lengths"]([*lengths[1][:-1].tolist(), lengths[1][-1] + 0.3])
    assert np.isnan(_fits(study.verdict)[1].tip(np.array(wrong))).all()
    if more:  # no backbone shortens so much; one tendon alone may bend it
        with pytest.raises(ValueError, match="outside the range"):
            made["tip_from_lengths"]((lengths[1] - 0.03 * study.robot.length).tolist())


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
@pytest.mark.parametrize(
    ("changes", "shares"),
    [
        ({}, {1: 1.0, 2: 1.0}),
        ({"kind": "chamber", "area": "1 cm^2"}, {1: -1.0}),
        ({"kind": "rod"}, {1: 1.0, 2: -1.0}),
    ],
)
def test_polynomials_reach_the_end_of_the_sweep(
    paper: Study, changes: dict[str, str], shares: dict[int, float]
) -> None:
    """Of two tendons, of a chamber that pushes, and of rods that do both."""
    tendons = {f"segments.0.tendons.{name}": value for name, value in changes.items()}
    robot = bs.load_robot("amouri2019", {"gravity": "9.81 0 0 m/s^2", **tendons})
    stages = Stages(robot, tendon=shares, max_tension=20.0)
    verdict = stages.judged(paper.budget)
    assert "by a polynomial: yes, up to 20 N" in verdict.meanings[1].answer
    fit, tensions = _fits(verdict)[1], np.outer([0.1, 0.5, 1.0], 20.0 * stages.model.shares)
    rod = bs.sweep(robot, tensions).raise_for_status().tip_position
    assert np.linalg.norm(fit.tip(tensions) - rod, axis=1).max() < 1.5 * fit.max_error


@pytest.mark.parametrize(
    ("turns", "inputs"),
    [((0.0, 0.0, 0.0, 0.0), 3), ((0.1, 0.1, 0.1, 0.1), 3), ((0.0, 0.0, 0.0, 0.2), 4)],
)
def test_tensions_enter_by_their_sum_and_moments(turns: tuple[float, ...], inputs: int) -> None:
    """Of parallel and of helical tendons; not where one of four turns about the others."""
    tendons = [
        {"angle": f"{90 * i} deg", "pitch_radius": "29 mm", "turns": each}
        for i, each in enumerate(turns)
    ]
    changes = {"segments.0.tendons": tendons, "gravity": "0 0 -9.81 m/s^2"}
    robot = bs.load_robot("amouri2019", changes)
    model = Model(robot, 0, "cosserat", (1.0, 0.0, 0.0, 0.0))
    tolerance = 0.01 * robot.length
    _, fit = tip_polynomials(model, 30.0, tolerance)
    assert fit.exponents.any(axis=0).sum() == inputs
    loads = 30.0 * np.random.default_rng(3).dirichlet(np.ones(5), 50)[:, :4]
    error = fit.tip(loads) - bs.sweep(robot, loads).raise_for_status().tip_position
    assert np.linalg.norm(error, axis=1).max() < 1.2 * fit.max_error < 0.12 * tolerance


def test_each_polynomial_has_its_range() -> None:
    """At 16 N the bends still give the tip, the tensions no longer do."""
    robot = bs.load_robot(EXAMPLES / "my_robot.yaml")
    model = Model(robot, 0, "cosserat", (1.0, *[0.0] * 7))
    lengths, tensions = tip_polynomials(model, 16.0, 0.01 * robot.length)
    assert (lengths.top, tensions.top) == (16.0, 8.0)


def test_c_has_the_same_polynomials(fitted: Found, tmp_path: Path) -> None:
    study, tensions, lengths = fitted
    made = _c(study, tmp_path)
    outside = np.full((1, tensions.shape[1]), -1.0)
    for name, rows, fit in zip(
        ("lengths", "tensions"), (lengths, tensions), _fits(study.verdict), strict=True
    ):
        rows = np.concatenate([rows, outside])
        for row, tip in zip(rows, fit.tip(rows), strict=True):
            out = (ctypes.c_double * 3)()
            refused = made[f"correction_tip_from_{name}"]((ctypes.c_double * len(row))(*row), out)
            assert bool(refused) == bool(np.isnan(tip).any())
            np.testing.assert_allclose(list(out), tip, atol=1e-12)


def test_matlab_has_the_same_numbers(found: Found) -> None:
    """MATLAB is not run; its numbers are those of the code that is."""
    _same_numbers(found[0], "SEGMENTS", "function list")


def test_matlab_has_the_same_polynomials(fitted: Found) -> None:
    _same_numbers(fitted[0], "LENGTHS", "function fit")


def _same_numbers(study: Study, begins: str, begins_in_matlab: str) -> None:
    number = re.compile(r"-?\d+\.\d+(?:e-?\d+)?")
    python = set(number.findall(correction_code(study, "python").partition(begins)[2]))
    matlab = correction_code(study, "matlab")
    opened = re.findall(r"^ *(?:classdef|methods|function|for|if)\b", matlab, re.MULTILINE)
    assert len(opened) == len(re.findall(r"^ *end$", matlab, re.MULTILINE))
    _, begin, numbers = matlab.partition(begins_in_matlab)
    listed = set(number.findall(numbers))
    powers = {f"{n}.0" for n in range(9)}
    assert begin and listed <= python | powers and len(listed) > 5


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_each_input_has_its_better_correction(
    paper: Study, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Arcs from lengths, which hold farther than their polynomial; a polynomial from tensions."""
    monkeypatch.setattr(correction_polynomial, "_RANGES", (0.5,))
    stages = Stages(bs.load_robot(EXAMPLES / "small.yaml"), tendon=1, max_tension=10.0)
    study, tensions, lengths = _loads(
        replace(stages.over(paper), verdict=stages.judged(paper.budget))
    )
    tensions *= 0.5
    from_lengths, from_force = study.verdict.meanings
    fit = from_force.polynomial
    assert from_lengths.polynomial is None and fit is not None and fit.top == 5.0
    made, compiled = _python(study), _c(study, tmp_path)
    arcs = RobotArcs.from_lengths(study.robot, lengths, "chord")
    for name, rows, tips in (
        ("lengths", lengths, arcs.tip.position),
        ("tensions", tensions, fit.tip(tensions)),
    ):
        for row, tip in zip(rows, tips, strict=True):
            out = (ctypes.c_double * 3)()
            c_row = (ctypes.c_double * len(row))(*row)
            assert compiled[f"correction_tip_from_{name}"](c_row, out) == 0
            np.testing.assert_allclose(list(out), tip, atol=1e-12)
            np.testing.assert_allclose(made[f"tip_from_{name}"](row.tolist()), tip, atol=1e-12)
    said = " ".join(str(made["__doc__"]).split())
    assert f"up to 10 N (largest error {in_mm(from_lengths.corrected.max_error)})" in said
    assert "5 N, and the lengths that they give. Largest error at random loads" in said
    assert f"(largest error {in_mm(fit.max_error)})" in from_force.answer
    assert in_mm(fit.max_error) in said
    _same_numbers(study, "SEGMENTS", "function list")


def test_answer_and_code_have_the_correction_that_holds_farther(
    paper: Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From force, neither over the whole sweep."""
    monkeypatch.setattr(correction_polynomial, "_RANGES", (0.25,))
    stages = Stages(bs.load_robot(EXAMPLES / "small.yaml"), tendon=1, max_tension=6.0)
    verdict = stages.judged(paper.budget)
    (_, m), end = verdict.meanings, verdict.meanings[1].corrected.valid_to
    assert m.polynomial is None and end is not None and 1.5 < end < 6.0
    assert f"corrected: up to {end:.3g} N" in m.answer
    code = correction_code(replace(stages.over(paper), verdict=verdict), "python")
    said = " ".join(code.split())
    assert re.search(rf"From tensions: constant curvature, corrected: .* up to {end:.3g} N", said)


def test_the_code_says_where_the_uncorrected_arc_holds_farther(
    paper: Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(correction_polynomial, "_RANGES", (0.25,))
    stages = Stages(bs.load_robot(EXAMPLES / "small.yaml"), tendon=1, max_tension=20.0)
    verdict = stages.judged(paper.budget)
    m, _ = verdict.meanings
    assert m.polynomial is None and m.valid_to is not None and m.corrected.valid_to is not None
    assert m.corrected.valid_to < m.valid_to < 20.0
    code = correction_code(replace(stages.over(paper), verdict=verdict), "python")
    said = f"up to {m.corrected.valid_to:.3g} N; without the correction: up to {m.valid_to:.3g} N."
    words = " ".join(code.split())
    assert said in words and words.count("without the correction") == 1


def test_an_input_without_a_correction_has_no_code(paper: Study) -> None:
    stages = Stages(bs.load_robot("amouri2019", FITTED["bent without load"]), tendon=1)
    verdict = stages.judged(paper.budget)
    meanings = (replace(verdict.meanings[0], polynomial=None), verdict.meanings[1])
    made = _python(replace(stages.over(paper), verdict=replace(verdict, meanings=meanings)))
    assert "tip_from_lengths" not in made and "tip_from_tensions" in made
    assert "From lengths: no correction, because its backbone is bent" in str(made["__doc__"])


def test_no_polynomial_within_the_tolerance_is_refused(paper: Study) -> None:
    robot = bs.load_robot("amouri2019", {"segments.0.backbone.rest_bend": "40 deg"})
    study = Stages(robot, tendon=1).over(paper)
    why = (
        "no correction in closed form, because its backbone is bent without load, and no polynomial"
    )
    with pytest.raises(InputError, match=why):
        correction_code(study, "c")


def test_unknown_language_is_refused(paper: Study) -> None:
    with pytest.raises(InputError, match="correction is 'fortran'"):
        correction_code(paper, "fortran")  # type: ignore[arg-type]
