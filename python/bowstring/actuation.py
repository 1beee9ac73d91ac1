"""The error budget of the drive: friction at the holes, elastic tendons, pulled lengths.

Two ways to drive the tendon that the study pulls, each beside itself without the effects:

- by *tension*, from zero to the study's largest and back, with friction at the holes;
- by *pull*: constant curvature says which lengths the tendons must have, and spools command them;
  with inextensible tendons, with elastic ones, and with elastic ones that rub, there and back.

With friction the pose depends on the path, so both ways are followed step by step. A robot file
that gives no friction or no elasticity is studied with a stated assumption, to show what it would
be worth; it is marked as assumed wherever it shows.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from bowstring import arc, rod
from bowstring.comparison import (
    MEANINGS,
    Case,
    Comparison,
    Model,
    known_max,
    known_mean,
    with_tendons,
)
from bowstring.robot import Robot
from bowstring.words import in_mm, in_percent, significant

__all__ = [
    "ASSUMED_FRICTION",
    "ASSUMED_STIFFNESS",
    "COMMANDED",
    "DriveBudget",
    "DriveRow",
    "Loop",
    "drive_budget",
]

Array = NDArray[np.float64]
DrivenBy = Literal["tension", "pull"]

ASSUMED_FRICTION: Final = 0.1
"""Of tendons for which the file gives none: the order of a steel cable in a smooth or greased hole
(dry steel on plastic or steel is above it, a PTFE liner below)."""
ASSUMED_STIFFNESS: Final = 30e3
"""E A in N of tendons for which the file gives neither E A nor a compliance: a stranded steel cable
of 0.8 mm. A bit more than half of its 0.50 mm^2 is metal, and a strand that has settled has about
100 GPa: 0.28 mm^2 times 105 GPa. A solid wire of this diameter would have 100 kN."""
_SURPLUS: Final = 0.01  # of the length: by how much more than needed the other tendons are paid out
_STEPS: Final = 40  # at least so many, up and again down

COMMANDED: Final = "cc_from_commanded_lengths"
"""Constant curvature from the lengths that the spools command, l0 - pull."""


# -- what is computed --------------------------------------------------------------------------


@dataclass(frozen=True)
class DriveRow:
    """One effect of the drive, beside the same commands without it."""

    effect: str
    label: str
    driven_by: DrivenBy
    assumed: tuple[str, ...]
    """What of it the robot file does not give: ``"friction"``, ``"elasticity"``."""
    case: Case
    base: Case
    """The same commands on tendons that neither rub nor stretch."""

    @property
    def short_label(self) -> str:
        """For narrow tables: without what is in brackets."""
        label = re.sub(r" \([^)]*\)", "", self.label)
        return label.replace("elastic tendons,", "elastic,")

    @property
    def moved(self) -> float:
        """How far the effect moves the robot's own tip, mean, m."""
        return known_mean(np.linalg.norm(self.case.tip_position - self.base.tip_position, axis=-1))

    @property
    def exceeds(self) -> bool:
        """Whether it moves the tip by more than constant curvature's own error, in the means.

        That from force for tensions and that from the commanded lengths for pulls, both without it.
        """
        return self.moved > self.base.comparisons[_fed_by(self.driven_by)].mean

    def to_dict(self) -> dict[str, Any]:
        """The row in mm and percent."""
        return {
            "effect": self.effect,
            "label": self.label,
            "driven_by": self.driven_by,
            "assumed": list(self.assumed),
            **self.case.to_dict(self.base),
            "more_than_constant_curvature": self.exceeds,
        }


@dataclass(frozen=True)
class Loop:
    """Up to the largest command and down again: the hysteresis of the tip."""

    driven_by: DrivenBy
    command: Array
    """(n,) tension in N or pull in m of the pulled tendon."""
    free: Array
    """(n, 3) tip without friction and stretch, m."""
    loading: Array
    unloading: Array
    """(n, 3), m, both in the order of `command`."""
    constant_curvature: Array
    """(n, 3), m, from the force or from the commanded lengths."""
    length: float

    @property
    def apart(self) -> Array:
        """Distance of the tips of loading and unloading at equal command (n,), m."""
        return np.asarray(np.linalg.norm(self.loading - self.unloading, axis=-1))

    @property
    def width(self) -> float:
        """The largest of them, m."""
        return known_max(self.apart)

    @property
    def widest_at(self) -> float:
        """The command there, N or m."""
        known = np.isfinite(self.apart)
        return float(self.command[np.nanargmax(self.apart)]) if known.any() else math.nan

    def error(self, way: Array) -> Array:
        """Euclidean error (n,) of constant curvature on one of the ways, m."""
        return np.asarray(np.linalg.norm(self.constant_curvature - way, axis=-1))

    def to_dict(self) -> dict[str, Any]:
        """The loop in N or mm, mm and percent."""
        name, scale = ("tension_N", 1.0) if self.driven_by == "tension" else ("pull_mm", 1e3)
        return {
            "driven_by": self.driven_by,
            "width_mm": self.width * 1e3,
            "width_percent": self.width / self.length * 100.0,
            f"widest_at_{name}": self.widest_at * scale,
            name: (self.command * scale).tolist(),
            "tip_free_mm": (self.free * 1e3).tolist(),
            "tip_loading_mm": (self.loading * 1e3).tolist(),
            "tip_unloading_mm": (self.unloading * 1e3).tolist(),
            "tip_constant_curvature_mm": (self.constant_curvature * 1e3).tolist(),
        }


@dataclass(frozen=True)
class DriveBudget:
    """What friction, elastic tendons and pulled lengths do to constant curvature's error."""

    friction: float
    """Of the pulled tendon."""
    friction_assumed: bool
    axial_stiffness: float
    """E A of the pulled tendon, N; infinite if only its transmission gives way."""
    compliance: float
    """Of its transmission, m/N."""
    free_length: float
    elasticity_assumed: bool
    pull: Array
    """(n,) commanded of the pulled tendon at the loads of the sweep, m."""
    tension_driven: Case
    """Tensions without friction: the main sweep."""
    pull_driven: Case
    """Pulls of tendons that neither stretch nor rub."""
    rows: tuple[DriveRow, ...]
    loops: tuple[Loop, Loop]
    """By tension, by pull."""
    notes: tuple[str, ...]
    text: tuple[str, ...]

    @property
    def assumptions(self) -> tuple[str, ...]:
        """What the file does not give and is assumed here."""
        out = [f"friction {self.friction:g}"] * self.friction_assumed
        return (*out, *[_elasticity(self.axial_stiffness, 0.0)] * self.elasticity_assumed)

    def row(self, effect: str) -> DriveRow:
        """The row of that effect."""
        return next(row for row in self.rows if row.effect == effect)

    def to_dict(self) -> dict[str, Any]:
        """The budget of the drive in mm and percent."""
        return {
            "friction": self.friction,
            "friction_is": _source(self.friction_assumed),
            "axial_stiffness_N": self.axial_stiffness,
            "compliance_m_per_N": self.compliance,
            "free_length_m": self.free_length,
            "elasticity_is": _source(self.elasticity_assumed),
            "commanded_pull_mm": (self.pull * 1e3).tolist(),
            "tension": {"is": "tension, no friction (this sweep)", **self.tension_driven.to_dict()},
            "pull": {"is": "pull, no stretch, no friction", **self.pull_driven.to_dict()},
            "rows": [row.to_dict() for row in self.rows],
            "hysteresis": [loop.to_dict() for loop in self.loops],
            "text": list(self.text),
            "notes": list(self.notes),
        }


# -- running it --------------------------------------------------------------------------------


def drive_budget(model: Model, tension: Array, sweep: Case) -> DriveBudget:
    """What the drive does to the error of constant curvature.

    Parameters
    ----------
    model : Model
    tension : array (n,)
        Loads of the pulled tendon, rising in even steps, N.
    sweep : Case
        The main sweep at these loads.

    Returns
    -------
    DriveBudget
    """
    t = model.tendon
    given = model.driven.tendons
    friction_assumed = not given.friction[t] > 0.0
    elasticity_assumed = math.isinf(given.axial_stiffness_N[t]) and not given.compliance_m_per_N[t]
    rubs = {"friction": ASSUMED_FRICTION} if friction_assumed else {}
    gives = {"axial_stiffness": ASSUMED_STIFFNESS} if elasticity_assumed else {}
    rubbing = with_tendons(model.driven, rubs, missing=True)
    both = with_tendons(rubbing, gives, missing=True)
    elastic = with_tendons(both, {"friction": 0.0})
    rigid = with_tendons(elastic, {"axial_stiffness": None, "compliance": 0.0})

    every = max(1, math.ceil(_STEPS / (len(tension) - 1)))
    there = np.linspace(0.0, tension[-1], every * (len(tension) - 1) + 1)
    and_back = np.concatenate((there, there[-2::-1]))
    commanded = _Commanded(model, there)
    pulls = np.concatenate((commanded.pulls, commanded.pulls[-2::-1]))

    def ways(path: rod.Sweep) -> tuple[_Way, _Way]:
        last = len(there) - 1
        rows = np.arange(0, last + 1, every)
        return _Way(path, np.arange(last + 1), rows), _Way(
            path, np.arange(2 * last, last - 1, -1), rows
        )

    def by_tension(robot: Robot) -> tuple[_Way, _Way]:
        return ways(rod.sweep(robot, model.tensions(and_back), **_physics(model)))

    def by_pull(robot: Robot) -> tuple[_Way, _Way]:
        return ways(rod.sweep(robot, pulls=pulls, **_physics(model)))

    def tension_case(way: _Way) -> Case:
        compared = model.compare(tension, way.tip, way.lengths, MEANINGS)
        return Case(model.main, way.problem, way.tip, compared)

    intended = commanded.tip[::every]

    def pull_case(way: _Way) -> Case:
        compared = Comparison(COMMANDED, "statics", model.length, intended, intended - way.tip)
        return Case(model.main, way.problem, way.tip, {COMMANDED: compared})

    free = model.solve(model.main, there).tip_position
    up, down = by_tension(rubbing)
    stiff, _ = by_pull(rigid)
    stretched, _ = by_pull(elastic)
    pulled, released = by_pull(both)
    base = pull_case(stiff)
    tight = any(commanded.fights(way) for way in (stiff, stretched, pulled, released))

    mu = both.tendons.friction[t]
    stiffness = float(both.tendons.axial_stiffness_N[t])
    compliance = float(both.tendons.compliance_m_per_N[t])
    rub = f"friction {mu:g}{' (assumed)' * friction_assumed}"
    elasticity = _elasticity(stiffness, compliance) + ", assumed" * elasticity_assumed
    give = f"pulled, elastic tendons ({elasticity})"
    not_given = ("friction",) * friction_assumed, ("elasticity",) * elasticity_assumed
    tail = {"loading": ", loading", "unloading": ", unloading"}
    rows = (
        *(
            DriveRow(
                f"friction_{way}",
                rub + tail[way],
                "tension",
                not_given[0],
                tension_case(found),
                sweep,
            )
            for way, found in (("loading", up), ("unloading", down))
        ),
        DriveRow("tendon_elasticity", give, "pull", not_given[1], pull_case(stretched), base),
        *(
            DriveRow(
                f"pull_driven_{way}",
                f"{give}, {rub}{tail[way]}",
                "pull",
                not_given[0] + not_given[1],
                pull_case(found),
                base,
            )
            for way, found in (("loading", pulled), ("unloading", released))
        ),
    )
    law = model.constant_curvature("cc_from_force", there, commanded.lengths)
    length = model.length
    loops = (
        Loop("tension", there, free, up.path_tip, down.path_tip, law, length),
        Loop(
            "pull",
            commanded.pulls[:, t],
            stiff.path_tip,
            pulled.path_tip,
            released.path_tip,
            commanded.tip,
            length,
        ),
    )
    return DriveBudget(
        friction=float(mu),
        friction_assumed=friction_assumed,
        axial_stiffness=stiffness,
        compliance=compliance,
        free_length=float(both.tendons.free_length_m[t]),
        elasticity_assumed=elasticity_assumed,
        pull=commanded.pulls[::every, t],
        tension_driven=sweep,
        pull_driven=base,
        rows=rows,
        loops=loops,
        notes=_notes(model, friction_assumed, elasticity_assumed, len(there) - 1, tight),
        text=_in_words(rows, loops, friction_assumed, elasticity_assumed),
    )


class _Commanded:
    """What the spools are told: the lengths of the arcs that the linear law has at these loads."""

    def __init__(self, model: Model, tension: Array) -> None:
        robot = model.robot
        arcs = arc.robot_from_tensions(robot, model.tensions(tension))
        self.tip = arcs.tip.position
        """(n, 3) that constant curvature means by these lengths, m."""
        self.lengths = arc.robot_lengths(robot, arcs.kappa, arcs.phi, arcs.length)
        straight = robot.disks.station_m[robot.tendons.end_disk]
        # A tendon with pretension is meant to stay tight; one without is given room, so that it
        # hangs and does not fight the pulled one over what the arc gets wrong.
        hangs = robot.tendons.pretension_N == 0.0
        hangs[model.tendon] = False
        self._others = np.flatnonzero(hangs)
        self._nothing = 1e-12 * robot.length
        self.pulls = straight - self.lengths - _SURPLUS * robot.length * hangs

    def fights(self, way: _Way) -> bool:
        """Whether a tendon that should hang is tight somewhere."""
        return bool(np.any(way.slack[:, self._others] <= self._nothing))


class _Way:
    """One way of a path, in the order of rising commands."""

    def __init__(self, path: rod.Sweep, order: NDArray[np.int64], rows: NDArray[np.int64]) -> None:
        self.path_tip = path.tip_position[order]
        here = order[rows]
        self.tip = path.tip_position[here]
        self.lengths = path.tendon_lengths[here]
        self.slack = path.slack_lengths[order]
        bad = [str(path.status[i]) for i in here if not path.converged[i]]
        self.problem: str | None = None
        if bad:
            of = f"{len(bad)} of {len(here)}" if len(bad) < len(here) else "any of the"
            self.problem = f"no equilibrium found at {of} commands ({bad[0]})"
            if len(bad) < len(here):
                self.problem += "; means are over the others"
                if order[-1] < order[0] and not path.converged[order[-1]]:
                    self.problem += ", unloading from the last command that had one"


def _physics(model: Model) -> dict[str, Any]:
    main = model.main
    return {
        "theory": main.theory,
        "gravity": main.gravity,
        "twist": main.twist,
        "disks": False,
    }


# -- in words ----------------------------------------------------------------------------------


def _fed_by(driven_by: DrivenBy) -> str:
    return "cc_from_force" if driven_by == "tension" else COMMANDED


def _source(assumed: bool) -> str:
    return "assumed" if assumed else "file"


def _elasticity(stiffness: float, compliance: float) -> str:
    parts = []
    if math.isfinite(stiffness):
        newtons = f"{stiffness:.4g} N" if stiffness < 1e3 else f"{stiffness / 1e3:.4g} kN"
        parts.append(f"E A {newtons}")
    if compliance:
        parts.append(f"transmission {compliance * 1e3:.4g} mm/N")
    return ", ".join(parts)


def _in_words(
    rows: tuple[DriveRow, ...], loops: tuple[Loop, Loop], friction: bool, elasticity: bool
) -> tuple[str, ...]:
    up, down, stretched, pulled, released = rows
    by_tension, by_pull = loops
    out = []

    def mean(row: DriveRow) -> str:
        return in_mm(row.case.comparisons[_fed_by(row.driven_by)].mean)

    def own(row: DriveRow) -> str:
        return in_mm(row.base.comparisons[_fed_by(row.driven_by)].mean)

    if math.isfinite(up.moved) and math.isfinite(down.moved):
        source = "assumed, the file gives none" if friction else "as in the file"
        than = "more" if up.exceeds or down.exceeds else "less"
        true, *rubbed = (
            case.comparisons["cc_from_lengths"].mean for case in (up.base, up.case, down.case)
        )
        from_lengths = ""
        if all(map(math.isfinite, (true, *rubbed))):
            from_lengths = (
                f"; from true lengths {' and '.join(map(in_mm, rubbed))} instead of {in_mm(true)}"
            )
        mu = up.label.split(",")[0].removesuffix(" (assumed)").removeprefix("friction ")
        out.append(
            f"Driven by tension, friction of {mu} at the holes ({source}) moves the tip by "
            f"{in_mm(up.moved)} in the mean while the load rises and {in_mm(down.moved)} while it "
            f"falls: {than} than constant curvature's own error from force, {own(up)}, which "
            f"becomes {mean(up)} and {mean(down)}{from_lengths}."
        )
    if math.isfinite(stretched.moved):
        source = " (assumed, the file gives none)" if elasticity else " (as in the file)"
        than = "more" if stretched.exceeds else "less"
        give = stretched.label.removeprefix("pulled, elastic tendons (").removesuffix(")")
        text = (
            "Driven by pulled lengths, the stretch of the tendons, "
            f"{give.removesuffix(', assumed')}{source}, moves the tip by {in_mm(stretched.moved)} "
            f"in the mean: {than} than constant curvature's own error from the commanded lengths, "
            f"{own(stretched)}, which becomes {mean(stretched)}"
        )
        if math.isfinite(pulled.moved) and math.isfinite(released.moved):
            text += f"; with friction as well {mean(pulled)} loading, {mean(released)} unloading"
        out.append(text + ".")
    widths = [
        f"{in_mm(loop.width)} ({in_percent(loop.width / loop.length)} of length) at "
        + (
            f"{significant(loop.widest_at)} N"
            if loop.driven_by == "tension"
            else f"a pull of {in_mm(loop.widest_at)}"
        )
        for loop in (by_tension, by_pull)
        if math.isfinite(loop.width)
    ]
    if widths:
        out.append(
            f"Hysteresis: loading and unloading differ by up to {' and '.join(widths)}. A model "
            "that knows the command only, as constant curvature does, is off by at least half of "
            "that on one of the ways."
        )
    return tuple(out)


def _notes(
    model: Model, friction: bool, elasticity: bool, steps: int, tight: bool
) -> tuple[str, ...]:
    out = [
        "How the robot is driven: the physics is that of the main sweep. 'Change' and 'tip moves' "
        "are against the same commands on tendons that neither rub nor stretch.",
        "Loading and unloading are one path, from home to the largest command and back in "
        f"{steps} steps each way: friction remembers it.",
        "Friction can also lower constant curvature's error: while loading it takes bend away, and "
        "a law that bends the robot too little comes nearer by that.",
        "Pulls: the linear law makes an arc of each tension of the sweep, and the inverse of Eq. 5 "
        f"makes tendon lengths of the arc. Tendon {model.tendon + 1} is wound up to its length, "
        "the others are paid out to theirs and "
        f"{_SURPLUS * 100:g} % of the robot's length more, so that they hang and do not fight; one "
        "that the file gives a pretension gets no surplus. Constant curvature's tip is that of the "
        "lengths without the surplus.",
    ]
    if tight:
        out.append("In spite of that another tendon than the pulled one is tight at some commands.")
    if friction:
        out.append(
            f"The file gives no friction: {ASSUMED_FRICTION:g} is assumed, the order of a steel "
            "cable in a smooth hole, not measured. Set friction in the robot file to have yours."
        )
    if elasticity:
        out.append(
            f"The file gives the tendons no elasticity: E A = {ASSUMED_STIFFNESS / 1e3:g} kN is "
            "assumed, about that of a stranded steel cable of 0.8 mm, not measured; of the free "
            "length between motor and base hole only what the file gives stretches. Set "
            "axial_stiffness, free_length and compliance to have yours."
        )
    return tuple(out)
