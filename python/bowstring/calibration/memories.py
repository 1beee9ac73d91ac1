"""Memories that a comparison adds to the calibrated rod: their parameters and initial values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal

import numpy as np

from bowstring.calibration.parameters import Unknowns
from bowstring.calibration.tip_model import Commands
from bowstring.errors import InputError
from bowstring.robot import laws
from bowstring.robot.model import Robot

Memory = Literal["backlash", "friction", "hysteresis", "creep", "relaxation"]
MEMORIES: Final[tuple[Memory, ...]] = ("backlash", "friction", "hysteresis", "creep", "relaxation")
"""Memories in the order of their number of parameters."""
_SHARE: Final = "segments.*.backbone.hysteresis"
_PLAY: Final = "segments.*.backbone.hysteresis_play"
#: Initial shares and bends (rad) of a hysteresis that the robot file does not have: the error has
#: several minima by the bend.
_SLIDING: Final = ((0.1, 0.05), (0.1, 0.15), (0.1, 0.4))
#: Initial share that relaxes, initial creep over the compliance of a bending robot, and number of
#: initial times.
_RELAXING: Final = 0.1
_CREEPING: Final = 0.1
_TIMES: Final = 3
#: Least time of relaxation and creep in the robot file, s.
_AT_ONCE: Final = 1e-3
#: Value in SI up to which a parameter of a memory has no effect.
_NONE: Final = 1e-7


def parameters_of(memory: Memory) -> list[str]:
    """Parameters of `bowstring.fit` that a memory adds."""
    if memory == "backlash":  # of the commands, not of the robot file
        return ["backlash"]
    law = laws.MEMORIES[memory]
    return [f"segments.*.{law.part}.{leaf}" for leaf in law.terms[0]]


def limit_of(memory: Memory) -> tuple[dict[str, float], str]:
    """Values in SI with which a memory acts at once, as an elasticity, and what that is like.

    Empty for memories without such a limit.
    """
    if memory in ("backlash", "friction"):
        return {}, ""
    if memory == "hysteresis":
        return {_PLAY: 0.0}, "a softer backbone"
    times = [name for name in parameters_of(memory) if name.endswith("_time")]
    what = "a softer backbone" if memory == "relaxation" else "a compliance of the tendons"
    return dict.fromkeys(times, _AT_ONCE), what


def reason_against(memory: Memory, commands: Commands, given: Unknowns) -> str:
    """Reason why a memory cannot be added to the `given` parameters; empty if it can."""
    if memory == "backlash" and not commands.by_displacement.any():
        return "backlash is of displacements, and all tendons are tension-controlled"
    if memory == "creep" and not commands.by_displacement.any():
        return "creep moves no tip, as all tendons are tension-controlled"
    if memory == "backlash" and memory in given.robot.memories:
        return "the robot file has it"
    if laws.MEMORIES[memory].timed:
        try:
            commands.clock(memory)
        except InputError as error:
            return str(error)
        if all(len(rows) < 2 for rows in commands.paths):
            return f"{memory} needs recordings of two rows at least"
    leaves = {item.leaf or item.name.partition(".")[0] for item in given.items}
    if leaves & {name.rpartition(".")[2] for name in parameters_of(memory)}:
        return "it is among the given parameters"
    return ""


def is_zero(robot: Robot, name: str, value: float) -> bool:
    """Whether the size of a memory, in SI, is too small for an effect."""
    scale = _bending_compliance(robot) if name.endswith("creep_compliance") else 1.0
    return value <= _NONE * scale


def starts_of(memory: Memory, robot: Robot, commands: Commands) -> list[dict[str, float]]:
    """Initial values to try of a memory that the robot file does not have, in SI."""
    added = parameters_of(memory)
    if memory in robot.memories:
        return [{}]
    if memory == "hysteresis":
        return [{_SHARE: share, _PLAY: bend} for share, bend in _SLIDING]
    if memory == "relaxation":
        return _over_times(commands, added, _RELAXING)
    if memory == "creep":
        return _over_times(commands, added, _CREEPING * _bending_compliance(robot))
    return [{}]


def _bending_compliance(robot: Robot) -> float:
    """Displacement of a tendon by its tension in the bending robot, about (m/N)."""
    radius = float(robot.tendons.arm_m.max())
    return radius**2 * robot.length / float(robot.bending_stiffness.min())


def _over_times(commands: Commands, added: Sequence[str], size: float) -> list[dict[str, float]]:
    """Initial values with times from that of two rows to that of half of the table."""
    time, paths = commands.clock(), commands.paths
    steps = np.concatenate([np.diff(time[rows]) for rows in paths])
    first = 2.0 * float(np.median(steps))
    last = 0.5 * max(float(np.ptp(time[rows])) for rows in paths)
    return [
        {name: tau if name.endswith("_time") else size for name in added}
        for tau in np.geomspace(first, max(first, last), _TIMES).tolist()
    ]
