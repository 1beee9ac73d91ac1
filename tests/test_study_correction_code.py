"""The corrected constant curvature as code: Python and C give what the package gives."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import bowstring as bs
from bowstring.constant_curvature import RobotArcs
from bowstring.errors import InputError
from bowstring.study.correction_code import check_correction, correction_code
from bowstring.study.study import Study
from stages import Stages

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


@pytest.fixture(scope="module", params=ROBOTS)
def found(request: pytest.FixtureRequest, paper: Study) -> tuple[Study, np.ndarray, np.ndarray]:
    """A study, random tensions (10, T), and tendon lengths of the rod under them."""
    name = request.param if request.param in bs.robot_names() else "amouri2019"
    robot = bs.load_robot(name, {**ROBOTS[request.param], "gravity": "0 0 0"})
    study = Stages(robot, tendon=1).over(paper)
    rng = np.random.default_rng(4)
    tensions = study.settings.max_tension * rng.uniform(size=(10, len(robot.tendons.segment)))
    tensions *= 0.4 / len(robot.segments)
    tensions[0] = 0.0
    return study, tensions, bs.sweep(robot, tensions).tendon_lengths


def test_python_is_the_package(found: tuple[Study, np.ndarray, np.ndarray]) -> None:
    study, tensions, lengths = found
    made: dict[str, object] = {}
    exec(compile(correction_code(study, "python"), "correction.py", "exec"), made)
    for name, rows, arcs in (
        ("tip_from_tensions", tensions, RobotArcs.from_tensions(study.robot, tensions, "arm")),
        ("tip_from_lengths", lengths, RobotArcs.from_lengths(study.robot, lengths, "chord")),
    ):
        tips = np.array([made[name](row.tolist()) for row in rows])  # type: ignore[operator]
        np.testing.assert_allclose(tips, arcs.tip.position, atol=1e-12)


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_c_is_the_package(found: tuple[Study, np.ndarray, np.ndarray], tmp_path: Path) -> None:
    study, tensions, lengths = found
    source = tmp_path / "correction.c"
    source.write_text(correction_code(study, "c"))
    library = tmp_path / "correction.so"
    flags = ["-std=c99", "-O1", "-Wall", "-Werror", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, str(source), "-o", str(library), "-lm"], check=True)
    made = ctypes.CDLL(str(library))
    for name, rows, arcs in (
        ("tensions", tensions, RobotArcs.from_tensions(study.robot, tensions, "arm")),
        ("lengths", lengths, RobotArcs.from_lengths(study.robot, lengths, "chord")),
    ):
        for row, tip in zip(rows, arcs.tip.position, strict=True):
            out = (ctypes.c_double * 3)()
            made[f"correction_tip_from_{name}"]((ctypes.c_double * len(row))(*row), out)
            assert list(out) == pytest.approx(tip.tolist(), abs=1e-12)


def test_matlab_has_the_same_numbers(found: tuple[Study, np.ndarray, np.ndarray]) -> None:
    """MATLAB is not run; its numbers are those of the code that is."""
    study = found[0]
    number = re.compile(r"-?\d+\.\d+(?:e-?\d+)?")
    python = set(number.findall(correction_code(study, "python").partition("SEGMENTS")[2]))
    matlab = correction_code(study, "matlab")
    opened = re.findall(r"^ *(?:classdef|methods|function|for|if)\b", matlab, re.MULTILINE)
    assert len(opened) == len(re.findall(r"^ *end$", matlab, re.MULTILINE))
    listed = set(number.findall(matlab.partition("function list")[2]))
    assert listed <= python and len(listed) > 5


def test_robots_without_a_closed_form() -> None:
    bent = bs.load_robot("amouri2019", {"segments.0.backbone.rest_bend": "20 deg"})
    with pytest.raises(InputError, match=r"no correction in closed form: .* is bent without load"):
        check_correction(bent, "c")
    single = bs.load_robot("amouri2019", {"segments.0.tendons.count": 1})
    with pytest.raises(InputError, match="too few tendons to determine its length and bend"):
        check_correction(single, "python")
    with pytest.raises(InputError, match="correction is 'fortran'"):
        check_correction(bs.load_robot("amouri2019"), "fortran")
