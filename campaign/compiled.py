"""Compiled robots as the C library reads and solves them, for `campaign.files`."""

from __future__ import annotations

import ctypes
import json
import math
from pathlib import Path
from random import Random
from typing import Any, Final

ROBOTS: Final[tuple[tuple[str, dict[str, Any]], ...]] = (
    ("amouri2019", {}),
    ("rao2021", {"gravity": "0 0 -9.81 m/s^2"}),
    (
        "amouri2019",
        {
            "gravity": "1 0 -9.81 m/s^2",
            "segments.0.backbone.end_diameter": "4 mm",
            "segments.0.disks.hole_length": "5 mm",
            "payloads": [{"disk": 9, "mass": 0.05, "centre": [0.01, 0.0, 0.02]}],
            "segments.0.tendons.axial_stiffness": 20e3,
            "segments.0.tendons.pretension": 2.0,
        },
    ),
    ("tests/two_tubes.yaml", {}),
    ("examples/tentacle.yaml", {}),
)
INTERNAL: Final = -2  # status of a panic
LONGEST: Final = 600  # letters of a sentence
MOST_TENDONS: Final = 20  # of an inverse, whose work grows by their cube


class Solution(ctypes.Structure):
    _fields_ = [
        ("position_m", ctypes.c_double * 3),
        ("rotation", ctypes.c_double * 9),
        ("residual", ctypes.c_double),
        ("error_estimate_m", ctypes.c_double),
        ("iterations", ctypes.c_int32),
        ("elements", ctypes.c_int32),
        ("stable", ctypes.c_int32),
    ]


class Inverse(ctypes.Structure):
    _fields_ = [
        ("solution", Solution),
        ("distance_m", ctypes.c_double),
        ("nearest_distance_m", ctypes.c_double),
        ("direction_error_rad", ctypes.c_double),
        ("iterations", ctypes.c_int32),
        ("restarted", ctypes.c_int32),
    ]


class Library:
    """The C library; each call is checked as its header promises."""

    def __init__(self, file: Path) -> None:
        self.c = ctypes.CDLL(str(file.resolve()))
        self.c.bowstring_last_error.restype = ctypes.c_char_p
        for name in ("robot_from_text", "solver_new"):
            getattr(self.c, f"bowstring_{name}").restype = ctypes.c_void_p
        self.c.bowstring_robot_tendon_count.restype = ctypes.c_size_t
        self.c.bowstring_robot_length.restype = ctypes.c_double

    def read(self, file: Path) -> None:
        """Read a compiled robot and use all calls of a solver.

        Raises
        ------
        InputError
            With the library's sentence, if it refuses the robot.
        AssertionError
            If an answer is not what the header promises.
        """
        text = file.read_bytes()
        robot = self.c.bowstring_robot_from_text(text, ctypes.c_size_t(len(text)))
        if not robot:
            self._refuse()
        try:
            handle = ctypes.c_void_p(robot)
            count = int(self.c.bowstring_robot_tendon_count(handle))
            length = float(self.c.bowstring_robot_length(handle))
            assert 0.0 < length < math.inf, f"length {length} m"
            solver = self.c.bowstring_solver_new(handle, None)
        finally:
            self.c.bowstring_robot_free(ctypes.c_void_p(robot))
        if not solver:
            self._refuse()
        try:
            self._use(ctypes.c_void_p(solver), count, length, Random(len(text)))
        finally:
            self.c.bowstring_solver_free(ctypes.c_void_p(solver))

    def _refuse(self) -> None:
        from bowstring.errors import InputError

        raise InputError(self._sentence())

    def _sentence(self) -> str:
        said = self.c.bowstring_last_error().decode()
        assert 0 < len(said) <= LONGEST and "\n" not in said, f"{len(said)} letters: {said[:300]!r}"
        assert "please report it" not in said, said
        return str(said)

    def _status(self, status: int) -> bool:
        """Whether a call succeeded; otherwise its sentence is checked."""
        if status != 0:
            assert status != INTERNAL, self._sentence()
            self._sentence()
        return status == 0

    def _use(self, solver: ctypes.c_void_p, count: int, length: float, random: Random) -> None:
        many = ctypes.c_double * count
        size, out, found = ctypes.c_size_t(count), many(), Solution()
        for most in (0.0, 1.0, 30.0):
            tensions = many(*(most * random.random() for _ in range(count)))
            status = self.c.bowstring_solve(solver, tensions, size, None, ctypes.byref(found))
            if not self._status(status):
                assert all(map(math.isnan, found.position_m)), "numbers without a solution"
                continue
            _check(found)
            for call in ("tendon_lengths", "displacements"):
                status = getattr(self.c, f"bowstring_{call}")(solver, out, size)
                assert self._status(status) == all(map(math.isfinite, out)), call
            rows = (ctypes.c_double * (6 * count))()
            status = self.c.bowstring_tip_derivatives(solver, rows, size)
            assert self._status(status) == all(map(math.isfinite, rows)), "derivatives"
        if count > MOST_TENDONS:
            return
        target = (ctypes.c_double * 3)(0.1 * length, 0.05 * length, 0.9 * length)
        inverse = Inverse()
        status = self.c.bowstring_inverse(
            solver, target, None, None, out, size, ctypes.byref(inverse)
        )
        if self._status(status):
            _check(inverse.solution)
            assert all(0.0 <= t < math.inf for t in out), f"tensions {[*out]}"
            assert 0.0 <= inverse.distance_m < 1e-4 * length, f"{inverse.distance_m} m away"


def _check(found: Solution) -> None:
    numbers = [*found.position_m, *found.rotation, found.residual, found.error_estimate_m]
    assert all(map(math.isfinite, numbers)), f"numbers of a solution: {numbers}"


def corpus(root: Path) -> list[bytes]:
    """Texts of intact compiled robots.

    Parameters
    ----------
    root : Path
        The repository.
    """
    import bowstring as bs

    found = []
    for name, changes in ROBOTS:
        robot = bs.load_robot(root / name if "/" in name else name).with_(changes)
        found.append(json.dumps(bs.compile_robot(robot)).encode())
    return found
