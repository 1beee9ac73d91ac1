"""Laws of tendons, drives and backbones, beyond the elasticity of a rod with ideal tendons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from bowstring.formatting import listed


@dataclass(frozen=True)
class Law:
    """A law, and the fields of the robot file that describe it."""

    key: str
    """Name of the law."""
    owner: str
    """What has the law: "tendons", "drives" or "backbone"."""
    part: Literal["tendons", "backbone"]
    """Part of a segment, in the robot file, that has its fields."""
    terms: tuple[tuple[str, ...], ...]
    """Fields of each term of the law: first its size, which is `none` without the term, then the
    others, such as a time."""
    step: float
    """Natural step of a size in fits, SI."""
    left_out: str
    """What a map says that leaves the law out."""
    memory: bool = True
    """Whether an equilibrium depends on the path to it."""
    timed: bool = False
    """Whether an equilibrium also depends on time."""
    none: float = 0.0
    """Size of a term without an effect."""
    of_commands: bool = False
    """Whether it acts on commands, before all mechanics."""
    moving: bool = False
    """Whether it has no effect on a robot at rest."""
    pushes: bool = True
    """Whether its equation holds for rods and chambers, whose tension may be negative."""

    @property
    def sizes(self) -> tuple[str, ...]:
        """Size of each term; all are `none` without the law."""
        return tuple(term[0] for term in self.terms)

    def refusal(self, robot: str, consequence: str) -> str:
        """Message that a robot of this name has it, with a consequence, and how to do without."""
        have = "has" if self.owner == "backbone" else "have"
        switch = f"set {listed(self.sizes)} to {self.none:g}"
        return f"the {self.owner} of {robot} {have} {self.key}{consequence}; {switch}"


_TOGETHER: Final = "Relaxation of the backbone and creep of the tendons are left out."
_COMMANDS: Final = (
    "Gain and zero of the drives are left out: displacements are those of the tendons themselves."
)
_RELAXATION: Final = (
    ("relaxation", "relaxation_time"),
    ("second_relaxation", "second_relaxation_time"),
)
_CREEP: Final = (
    ("creep_compliance", "creep_time"),
    ("second_creep_compliance", "second_creep_time"),
)
_LAWS: Final = (
    Law(
        "friction",
        "tendons",
        "tendons",
        (("friction",),),
        0.05,
        "The friction of the robot is left out; an axis friction or bend takes it in.",
        pushes=False,  # the logarithm of a tension
    ),
    Law(
        "backlash",
        "drives",
        "tendons",
        (("backlash",),),
        1e-4,
        "The backlash of the drives is left out.",
    ),
    Law(
        "hysteresis",
        "backbone",
        "backbone",
        (("hysteresis", "hysteresis_play"),),
        0.05,
        "The hysteresis of the backbone is left out.",
    ),
    Law("relaxation", "backbone", "backbone", _RELAXATION, 0.05, _TOGETHER, timed=True),
    Law("creep", "tendons", "tendons", _CREEP, 1e-5, _TOGETHER, timed=True),
    Law(
        "clearance",
        "tendons",
        "tendons",
        (("hole_clearance",),),
        1e-4,
        "The clearance of the tendons in their holes is left out.",
        memory=False,
        pushes=False,  # a rod that pushes takes the other side of the hole
    ),
    Law(
        "mount compliance",
        "drives",
        "tendons",
        (("mount_compliance",),),
        1e-6,
        "The compliance of the drives' mount is left out.",
        memory=False,
    ),
    Law(
        "gain",
        "drives",
        "tendons",
        (("gain",),),
        0.02,
        _COMMANDS,
        memory=False,
        none=1.0,
        of_commands=True,
    ),
    Law("zero", "drives", "tendons", (("zero",),), 1e-4, _COMMANDS, memory=False, of_commands=True),
    Law(
        "decoupling",
        "drives",
        "tendons",
        (("decoupling",),),
        0.05,
        "The decoupling of the drives is left out: displacements are those of whole tendons.",
        memory=False,
        of_commands=True,
    ),
    Law(
        "delay",
        "drives",
        "tendons",
        (("delay",),),
        0.05,
        "The delay of the drives has no effect on a robot at rest.",
        memory=False,
        of_commands=True,
        moving=True,
    ),
)
LAWS: Final = {law.key: law for law in _LAWS}
"""The laws by their keys."""
MEMORIES: Final = {key: law for key, law in LAWS.items() if law.memory}
"""The laws with a memory."""
OF_COMMANDS: Final = tuple(key for key, law in LAWS.items() if law.of_commands)
"""Keys of the laws that act on commands."""
OF_MOTION: Final = tuple(key for key, law in LAWS.items() if law.moving)
"""Keys of the laws without an effect at rest."""
OF_DISPLACEMENTS: Final = tuple(key for key in OF_COMMANDS if key not in OF_MOTION)
"""Keys of the laws that act on commanded displacements alone, also at rest."""
