"""Robots for tests of finite elements, and a skip where CalculiX is missing."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest

from bowstring.fem import Settings
from bowstring.fem.mesh import Fineness
from bowstring.robot.model import Robot
from bowstring.robot.reader import load_robot

COARSE = Settings(Fineness(2, 4, 1))

Test = TypeVar("Test", bound=Callable[..., object])


def needs_ccx(test: Test) -> Test:
    """A test by finite elements, skipped where CalculiX is missing."""
    skip = pytest.mark.skipif(
        shutil.which("ccx") is None, reason="needs CalculiX (the program ccx) on the search path"
    )
    return pytest.mark.fem(skip(test))


def small_robot(**changes: object) -> Robot:
    """Two modules of the study's robot, with clamping disks."""
    return load_robot(
        "amouri2019",
        {
            "segments.0.disks.clamped_length": "3 mm",
            "segments.0.disks.count": 2,
            "segments.0.length": "140 mm",
            **changes,
        },
    )


def two_segments() -> Robot:
    """A tube in two segments, the outer one thinner, with gravity and tendons at odd angles."""
    return load_robot(Path(__file__).with_name("two_tubes.yaml"))
