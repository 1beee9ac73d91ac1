"""The study: how good is constant curvature for a robot, and where does it stop being so?

`run` repeats what Amouri 2019 did with one cable, for any robot:

1. its geometric sweep, constant curvature alone (Eq. 5, Fig. 6 and 7);
2. a sweep of one tendon from zero, solved by straight-span statics;
3. constant curvature beside that physics in its two meanings: fed with the *lengths* that physics
   gives (Eq. 2-5), and fed with the *force* through the linear law; each plain and corrected;
4. an error budget: physical effects one by one, added to the plainest physics and removed from the
   fullest;
5. a verdict at a stated tolerance.

There are only numbers here: `bowstring.report` writes them, `bowstring.plots` draws them. Inside
all is SI and radians; `Study.to_dict` is for people and files, in mm, degrees and percent.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from bowstring import _core, arc, rod
from bowstring.errors import BowstringError, InputError, NoSolutionError
from bowstring.robot import Robot, load_robot

__all__ = [
    "FIGURES",
    "Budget",
    "BudgetRow",
    "Case",
    "Comparison",
    "Figure",
    "GeometricSweep",
    "Meaning",
    "Physics",
    "PublishedClaim",
    "Settings",
    "Statics",
    "Study",
    "Verdict",
    "run",
]

Array = NDArray[np.float64]
Theory = Literal["cosserat", "kirchhoff"]
Progress = Callable[[str, float], None]

SCHEMA_VERSION: Final = 1
GRAVITY: Final = 9.81
"""m/s^2, in every gravity case of the budget."""

COMPARISONS: Final = {
    "cc_from_lengths": "from lengths (Eq. 5)",
    "cc_from_force": "from force (linear law)",
    "cc_from_lengths_chord": "from lengths, chords",
    "cc_from_force_arm": "from force, mean arm",
}
"""Names of the comparisons and what people call them."""

_MEANINGS: Final = ("cc_from_lengths", "cc_from_force")
_ROUND: Final = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
_FINE_POINTS: Final = 401  # of the sweep that the verdict searches; crossings are bisected
_BISECTIONS: Final = 40
_WORTH_NAMING: Final = 0.1  # share of the error below which no effect is called its cause
_MAX_BEND: Final = math.radians(80.0)
_MAX_SIDEWAYS: Final = 0.13  # of the length: what 1 N across the tip of the study's robot does


@dataclass(frozen=True)
class Figure:
    """A figure of the report: its file name without ending, its title, and what it shows."""

    stem: str
    title: str
    caption: str


FIGURES: Final = (
    Figure(
        "fig05_tip_against_force",
        "Tip against force",
        "Tip coordinates while one tendon is pulled, as Fig. 5 of the study, by statics. Lines: "
        "physics. Crosses: constant curvature from force.",
    ),
    Figure(
        "pull_against_force",
        "Pull against force",
        "How far the pulled tendon has shortened: physics beside the linear law that the study "
        "assumes, and the difference of the two.",
    ),
    Figure(
        "fig06_tip_against_pull",
        "Tip against pull",
        "The study's geometric sweep, as its Fig. 6: tip coordinates by constant curvature alone "
        "while one tendon is shortened and the others follow.",
    ),
    Figure(
        "fig07_configurations",
        "Configurations",
        "Configurations of the geometric sweep with disks and tendons, as Fig. 7 of the study.",
    ),
    Figure(
        "fig10_overlay",
        "Constant curvature over physics",
        "Path of the tip in the bending plane, as Fig. 10 of the study: physics, and constant "
        "curvature from lengths and from force at the same loads.",
    ),
    Figure(
        "fig11_errors",
        "Errors by axis",
        "Difference of the tip by constant curvature from physics along each axis, as Fig. 11 of "
        "the study, with the Euclidean error and the tolerance.",
    ),
    Figure(
        "error_budget",
        "Error budget",
        "Mean error of constant curvature with each effect added alone to the plainest physics, "
        "and removed alone from the fullest (dashed: the fullest). The upper scale is logarithmic.",
    ),
)


# -- what is computed --------------------------------------------------------------------------


@dataclass(frozen=True)
class Settings:
    """What was asked of the study."""

    tolerance: float
    """Tolerated tip error as a share of the length."""
    max_tension: float
    """End of the sweep, N."""
    points: int
    theory: Theory
    tendon: int
    """Index of the pulled tendon, from 0."""
    range_chosen: bool
    """Whether the program chose `max_tension`."""


@dataclass(frozen=True)
class Physics:
    """One set of physical assumptions; the defaults are the plainest."""

    tendon: Literal["straight", "continuous"] = "continuous"
    theory: Theory = "kirchhoff"
    twist: bool = False
    clamped: Literal["none", "file", "budget"] = "none"
    """Backbone held by the disks: none, as the file says, or as the budget assumes."""
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tip_force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    stiffness: float = 1.0
    """Factor on Young's modulus."""


@dataclass(frozen=True)
class GeometricSweep:
    """The study's own sweep: constant curvature alone, no physics."""

    pull: Array
    """(n,) shortening of the pulled tendon, m."""
    tendon_lengths: Array
    """(n, T), m."""
    theta: Array
    """(n, S), rad."""
    tip_position: Array
    """(n, 3), m."""
    disk_positions: Array
    """(n, N, 3), m."""
    disk_rotations: Array
    """(n, N, 3, 3)."""
    backbone: Array
    """(n, P, 3), points along the backbone from the base, m."""


@dataclass(frozen=True)
class Statics:
    """The sweep of one tendon by straight-span statics."""

    tension: Array
    """(n,) of the pulled tendon, N; all others are zero."""
    status: tuple[str, ...]
    converged: NDArray[np.bool_]
    tip_position: Array
    """(n, 3), m; NaN where not converged."""
    disk_positions: Array
    """(n, N, 3), m."""
    tendon_lengths: Array
    """(n, T), m."""
    pull: Array
    """(n,) l0 - l of the pulled tendon, l0 with the backbone straight, m."""
    linear_pull: Array
    """(n,) what the linear law says it is, m."""


@dataclass(frozen=True)
class Comparison:
    """Tips of constant curvature against tips of physics."""

    name: str
    against: str
    length: float
    tip_position: Array
    """(n, 3) by constant curvature, m; NaN where there is none."""
    difference: Array
    """(n, 3) constant curvature minus physics, m."""

    @cached_property
    def error(self) -> Array:
        """Euclidean tip error (n,), m."""
        return np.asarray(np.linalg.norm(self.difference, axis=-1))

    @property
    def n(self) -> int:
        """Number of points that both sides have."""
        return int(np.isfinite(self.error).sum())

    def _over_points(self, statistic: Callable[[Array], Any], values: Array) -> Any:
        return statistic(values[np.isfinite(self.error)]) if self.n else math.nan

    @property
    def mean(self) -> float:
        """Mean error, m."""
        return float(self._over_points(np.mean, self.error))

    @property
    def maximum(self) -> float:
        """Largest error, m."""
        return float(self._over_points(np.max, self.error))

    @property
    def rms(self) -> float:
        """Root mean square over points (never over coordinates), m."""
        return float(np.sqrt(self._over_points(np.mean, self.error**2)))

    @property
    def mean_by_axis(self) -> Array:
        """Mean absolute error along x, y and z, m."""
        rows = np.abs(self.difference[np.isfinite(self.error)])
        return np.asarray(rows.mean(axis=0) if len(rows) else np.full(3, math.nan))

    def to_dict(self) -> dict[str, Any]:
        """The comparison in mm and percent."""
        return {
            "name": self.name,
            "against": self.against,
            "n": self.n,
            "mean_mm": self.mean * 1e3,
            "max_mm": self.maximum * 1e3,
            "rms_mm": self.rms * 1e3,
            "mean_percent": self.mean / self.length * 100.0,
            "mean_by_axis_mm": (self.mean_by_axis * 1e3).tolist(),
        }


@dataclass(frozen=True)
class Case:
    """One set of physics, and what it makes of constant curvature's error."""

    physics: Physics
    problem: str | None
    """Why it has no numbers, or not at all loads."""
    tip_position: Array
    """(n, 3), m."""
    comparisons: dict[str, Comparison]

    def error(self, meaning: str) -> Array:
        """Euclidean tip error (n,) of constant curvature in this physics, m."""
        return self.comparisons[meaning].error

    def to_dict(self, base: Case | None = None) -> dict[str, Any]:
        """The case in mm and percent; with `base`, also the change from it at common points."""
        out: dict[str, Any] = {"problem": self.problem}
        for name, comparison in self.comparisons.items():
            entry = comparison.to_dict()
            out[name] = {k: entry[k] for k in ("n", "mean_mm", "max_mm", "mean_percent")}
            if base is not None:
                change = self.error(name) - base.error(name)
                out[name]["change_of_mean_mm"] = _mean(change) * 1e3
                out[name]["change_of_mean_percent"] = _mean(change) / comparison.length * 100.0
        if base is not None:
            moved = np.linalg.norm(self.tip_position - base.tip_position, axis=-1)
            out["tip_moved_mean_mm"] = _mean(moved) * 1e3
            out["tip_moved_max_mm"] = _max(moved) * 1e3
        return out


@dataclass(frozen=True)
class BudgetRow:
    """One effect: added alone to the plainest physics, removed alone from the fullest.

    And, since both are far from the sweep that the verdict is about, changed alone in that sweep.
    """

    effect: str
    label: str
    added: Case
    full: Case
    """The fullest physics in which the effect acts (of alternatives, with this one)."""
    removed: Case
    in_sweep: Case
    """The main sweep with only this effect changed: removed if it acts there, else added."""
    acts_in_sweep: bool

    def worth(self, meaning: str) -> float:
        """What the effect adds to the mean error when all others act too, m; may be negative."""
        return _mean(self.full.error(meaning) - self.removed.error(meaning))

    def to_dict(self, plainest: Case, sweep: Case) -> dict[str, Any]:
        """The row in mm and percent."""
        return {
            "effect": self.effect,
            "label": self.label,
            "added": self.added.to_dict(plainest),
            "full": self.full.to_dict(),
            "removed": self.removed.to_dict(self.full),
            "in_sweep": {
                "how": "removed" if self.acts_in_sweep else "added",
                **self.in_sweep.to_dict(sweep),
            },
        }


@dataclass(frozen=True)
class Budget:
    """The error budget."""

    plainest: Case
    fullest: Case
    sweep: Case
    """The physics of the main sweep."""
    rows: tuple[BudgetRow, ...]
    plainest_is: str
    fullest_is: str
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The budget in mm and percent."""
        return {
            "plainest": {"is": self.plainest_is, **self.plainest.to_dict()},
            "fullest": {"is": self.fullest_is, **self.fullest.to_dict()},
            "sweep": self.sweep.to_dict(),
            "rows": [row.to_dict(self.plainest, self.sweep) for row in self.rows],
            "notes": list(self.notes),
        }


@dataclass(frozen=True)
class Share:
    """What one effect has in constant curvature's error at one load of the main sweep."""

    effect: str
    label: str
    error_without: float
    """Error with this effect removed and nothing else changed, m."""
    share: float
    """(error - error_without) / error; shares interact and need not add up to one."""


@dataclass(frozen=True)
class Meaning:
    """The verdict on one meaning of constant curvature."""

    name: str
    holds_throughout: bool
    holds_to: float | None
    """First crossing of the tolerance, or the last load solved, N; None if it never holds."""
    fails: tuple[tuple[float, float], ...]
    """Every range of tension in which the error is above the tolerance, N."""
    undecided: tuple[tuple[float, float], ...]
    """Ranges of tension without physics or without an arc, N."""
    error_at_end: float
    max_error: float
    max_at: float
    blamed_at: float
    """Tension at which the shares are taken: the first crossing, else that of the largest error."""
    shares: tuple[Share, ...]
    """Largest first; empty if physics and constant curvature agree there."""
    text: str

    @property
    def ended_by(self) -> Share | None:
        """The effect with the largest share, if that is large enough to be called the cause."""
        largest = self.shares[:1]
        return largest[0] if largest and largest[0].share >= _WORTH_NAMING else None


@dataclass(frozen=True)
class Verdict:
    """The answer in plain words, and the numbers it is made of."""

    tolerance: float
    tolerance_length: float
    meanings: tuple[Meaning, ...]
    fine_tension: Array
    fine_error: dict[str, Array]
    """Errors on the fine sweep that was searched, m."""
    text: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The verdict in mm, N and percent."""
        return {
            "tolerance_percent": self.tolerance * 100.0,
            "tolerance_mm": self.tolerance_length * 1e3,
            "text": list(self.text),
            "meanings": [
                {
                    "name": m.name,
                    "holds_throughout": m.holds_throughout,
                    "holds_to_N": m.holds_to,
                    "fails_N": [list(r) for r in m.fails],
                    "undecided_N": [list(r) for r in m.undecided],
                    "max_error_mm": m.max_error * 1e3,
                    "max_error_at_N": m.max_at,
                    "ended_by": m.ended_by.effect if m.ended_by and m.fails else None,
                    "shares_at_N": m.blamed_at,
                    "shares": [
                        {
                            "effect": s.effect,
                            "label": s.label,
                            "error_without_mm": s.error_without * 1e3,
                            "share_percent": s.share * 100.0,
                        }
                        for s in m.shares
                    ],
                    "text": m.text,
                }
                for m in self.meanings
            ],
        }


@dataclass(frozen=True)
class PublishedClaim:
    """What the source study printed, set beside our number; no measurement of it is available."""

    mean_mm: float
    mean_percent: float
    ours: str
    """Name of our comparison that stands beside it."""
    text: str


@dataclass(frozen=True)
class Study:
    """All numbers of a study."""

    robot: Robot
    settings: Settings
    geometry: GeometricSweep
    statics: Statics
    comparisons: tuple[Comparison, ...]
    budget: Budget
    verdict: Verdict
    claim: PublishedClaim | None
    notes: tuple[str, ...] = field(default=())

    @property
    def length(self) -> float:
        """Length of the robot, m."""
        return self.robot.length

    def comparison(self, name: str) -> Comparison:
        """The comparison of that name."""
        return next(c for c in self.comparisons if c.name == name)

    def to_dict(self) -> dict[str, Any]:
        """The study as JSON values only; what is not a number is None."""
        s, g = self.statics, self.geometry
        out = {
            "robot": self.robot.name,
            "length_m": self.length,
            "comparisons": [c.to_dict() for c in self.comparisons],
            "verdict": self.verdict.to_dict(),
            "budget": self.budget.to_dict(),
            "figures": [
                {
                    "title": f.title,
                    "caption": f.caption,
                    "png": f"figures/{f.stem}.png",
                    "pdf": f"figures/{f.stem}.pdf",
                }
                for f in FIGURES
            ],
            "published_claim": None
            if self.claim is None
            else {
                "source": "Amouri 2019",
                "what": "mean of constant curvature against finite elements",
                "smaller_than_mm": self.claim.mean_mm,
                "smaller_than_percent": self.claim.mean_percent,
                "beside": self.claim.ours,
            },
            "data": "simulated",
            "registered": False,
            "notes": list(self.notes),
            "warnings": list(self.robot.warnings),
            "sweep": {
                "pulled_tendon": self.settings.tendon + 1,
                "tension_N": s.tension.tolist(),
                "status": list(s.status),
                "tip_position_mm": (s.tip_position * 1e3).tolist(),
                "tendon_lengths_mm": (s.tendon_lengths * 1e3).tolist(),
                "pull_mm": (s.pull * 1e3).tolist(),
                "linear_pull_mm": (s.linear_pull * 1e3).tolist(),
                "errors_mm": {c.name: (c.error * 1e3).tolist() for c in self.comparisons},
            },
            "geometric_sweep": {
                "pull_mm": (g.pull * 1e3).tolist(),
                "tip_position_mm": (g.tip_position * 1e3).tolist(),
                "theta_deg": np.degrees(g.theta).tolist(),
            },
            "provenance": {
                "schema_version": SCHEMA_VERSION,
                "bowstring_version": str(_core.__version__),
                "robot_hash": self.robot.hash,
                "robot": self.robot.model_dump(mode="json", exclude_none=True),
                "settings": {
                    "tolerance_percent": self.settings.tolerance * 100.0,
                    "max_tension_N": self.settings.max_tension,
                    "points": self.settings.points,
                    "theory": self.settings.theory,
                    "gravity_m_per_s2": list(self.robot.gravity),
                },
            },
        }
        plain: dict[str, Any] = _plain(out)
        return plain


# -- running it --------------------------------------------------------------------------------


def run(
    robot: Robot,
    *,
    tolerance: float = 0.01,
    max_tension: float | None = None,
    points: int = 17,
    theory: Theory = "cosserat",
    progress: Progress | None = None,
) -> Study:
    """Study how good constant curvature is for a robot.

    The first tendon of the outermost segment is pulled from zero, in equal steps, all others are
    slack.

    Parameters
    ----------
    robot : Robot
    tolerance : float
        Tolerated tip error as a share of the robot's length.
    max_tension : float, optional
        End of the sweep, N. If not given, the largest round load (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6
        or 8 times a power of ten) that bends the whole robot by at most 80 degrees by the linear
        law: 80 N for the study's robot, as in the study.
    points : int
        Number of loads, zero included.
    theory : {"cosserat", "kirchhoff"}
        Of the main sweep. The budget uses both.
    progress : callable, optional
        Is told what is being done and the share that is done, from 0 to 1.

    Returns
    -------
    Study

    Raises
    ------
    InputError
        If a setting is out of its range.
    NoSolutionError
        If no load of the sweep has an equilibrium.
    """
    tell = progress or (lambda what, share: None)
    settings = _settings(robot, tolerance, max_tension, points, theory)
    model = _Model(robot, settings)

    tell("geometric sweep", 0.0)
    geometry = _geometric_sweep(model)

    tell("statics", 0.05)
    statics = _statics(model)
    comparisons = model.compare(
        statics.tension, statics.tip_position, statics.tendon_lengths, tuple(COMPARISONS)
    )

    tell("error budget", 0.2)
    budget = _budget(model, statics.tension, lambda share: tell("error budget", 0.2 + 0.6 * share))

    tell("verdict", 0.8)
    verdict = _verdict(model, comparisons, budget)
    tell("done", 1.0)
    return Study(
        robot=robot,
        settings=settings,
        geometry=geometry,
        statics=statics,
        comparisons=tuple(comparisons.values()),
        budget=budget,
        verdict=verdict,
        claim=_claim(model, comparisons),
        notes=_notes(model, statics, comparisons),
    )


def _settings(
    robot: Robot, tolerance: float, max_tension: float | None, points: int, theory: Theory
) -> Settings:
    if not (math.isfinite(tolerance) and 0.0 < tolerance < 1.0):
        raise InputError(
            f"tolerance is a share of the length and must lie between 0 and 1, got {tolerance}"
        )
    if max_tension is not None and not (math.isfinite(max_tension) and max_tension > 0.0):
        raise InputError(f"the largest tension must be positive and finite, got {max_tension} N")
    if not 2 <= points <= 1000:
        raise InputError(f"the number of loads must be from 2 to 1000, got {points}")
    if theory not in ("cosserat", "kirchhoff"):
        raise InputError(f"theory must be cosserat or kirchhoff, got {theory!r:.60}")
    tendon = int(np.flatnonzero(robot.tendons.segment == len(robot.segments) - 1)[0])
    limit = max_tension
    if limit is None:
        limit = _round_down(_MAX_BEND / sum(_linear_bend(robot, tendon)))
    return Settings(tolerance, limit, points, theory, tendon, max_tension is None)


def _linear_bend(robot: Robot, tendon: int) -> list[float]:
    """Bend of each segment by 1 N in the tendon, by the linear law, rad/N."""
    r = float(robot.tendons.pitch_radius_m[tendon])
    last = int(robot.tendons.segment[tendon])
    return [
        r * segment.length / float(stiffness) if k <= last else 0.0
        for k, (segment, stiffness) in enumerate(
            zip(robot.segments, robot.bending_stiffness, strict=True)
        )
    ]


def _round_down(value: float) -> float:
    """Largest of 1, 1.2, 1.5, ... times a power of ten that is not above the value."""
    power = math.floor(math.log10(value))
    # through decimal text: 8 * 10.0**-3 is not the float 0.008
    candidates = (float(f"{m}e{p}") for p in (power - 1, power) for m in _ROUND)
    return max(c for c in candidates if c <= value * (1 + 1e-12))


class _Model:
    """Robot and settings, and what all parts of the study ask of them."""

    def __init__(self, robot: Robot, settings: Settings) -> None:
        self.robot = robot
        self.settings = settings
        self.length = robot.length
        angle = float(robot.tendons.angle_rad[settings.tendon])
        self.towards = (math.cos(angle), math.sin(angle), 0.0)
        """The way the pulled tendon bends the robot."""
        self.across = (-math.sin(angle), math.cos(angle), 0.0)
        self.main = Physics(
            tendon="straight",
            theory=settings.theory,
            twist=True,
            clamped="file",
            gravity=robot.gravity,
        )
        self._variants: dict[tuple[str, float], Robot] = {}

    def tensions(self, tension: Array) -> Array:
        """Tensions of all tendons (n, T), N."""
        out = np.zeros((len(tension), len(self.robot.tendons.segment)))
        out[:, self.settings.tendon] = tension
        return out

    @cached_property
    def budget_clamps(self) -> list[float]:
        """Clamped length that the budget assumes in each segment, m."""
        return [s.disks.clamped_length or s.disks.thickness or 3e-3 for s in self.robot.segments]

    def variant(self, physics: Physics) -> Robot:
        """The robot with the clamps and the stiffness of this physics."""
        key = (physics.clamped, physics.stiffness)
        if key not in self._variants:
            changes: dict[str, float] = {}
            for k, segment in enumerate(self.robot.segments):
                clamps = {
                    "none": 0.0,
                    "file": segment.disks.clamped_length,
                    "budget": self.budget_clamps[k],
                }[physics.clamped]
                if clamps != segment.disks.clamped_length:
                    changes[f"segments.{k}.disks.clamped_length"] = clamps
                if physics.stiffness != 1.0:
                    changes[f"segments.{k}.backbone.E"] = segment.backbone.E * physics.stiffness
            self._variants[key] = self.robot.with_(changes) if changes else self.robot
        return self._variants[key]

    def solve(self, physics: Physics, tension: Array, disks: bool = False) -> rod.Sweep:
        """Equilibria of this physics along the sweep."""
        return rod.sweep(
            self.variant(physics),
            self.tensions(tension),
            theory=physics.theory,
            gravity=physics.gravity,
            tip_force=physics.tip_force,
            tendon=physics.tendon,
            twist=physics.twist,
            disks=disks,
        )

    def constant_curvature(self, name: str, tension: Array, lengths: Array) -> Array:
        """Tips (n, 3) by constant curvature of the nominal robot, m; NaN where it has none."""
        if name == "cc_from_force":
            return self._rows(self.tensions(tension), self._from_force)
        if name == "cc_from_force_arm":
            return self._rows(self.tensions(tension), self._from_force_arm)
        if name == "cc_from_lengths":
            return self._rows(lengths, self._from_lengths)
        return self._rows(lengths, self._from_lengths_chord)

    def _from_force(self, tensions: Array) -> Array:
        return arc.robot_from_tensions(self.robot, tensions, law="linear").tip.position

    def _from_force_arm(self, tensions: Array) -> Array:
        return arc.robot_from_tensions(self.robot, tensions, law="arm").tip.position

    def _from_lengths(self, lengths: Array) -> Array:
        return arc.robot_fk(self.robot, lengths).tip.position

    def _from_lengths_chord(self, lengths: Array) -> Array:
        return arc.robot_fk(self.robot, lengths, correction="chord").tip.position

    @staticmethod
    def _rows(values: Array, function: Callable[[Array], Array]) -> Array:
        """The function at all rows at once, or one by one where some have no arc."""
        out = np.full((len(values), 3), math.nan)
        good = np.flatnonzero(np.all(np.isfinite(values), axis=-1))
        try:
            out[good] = function(values[good])
        except BowstringError:
            for i in good:
                try:
                    out[i] = function(values[i])
                except BowstringError:
                    continue
        return out

    def compare(
        self, tension: Array, tip: Array, lengths: Array, names: Sequence[str]
    ) -> dict[str, Comparison]:
        """Constant curvature against the tips and tendon lengths of some physics."""
        out = {}
        for name in names:
            ours = self.constant_curvature(name, tension, lengths)
            out[name] = Comparison(name, "statics", self.length, ours, ours - tip)
        return out

    def case(self, physics: Physics, tension: Array) -> Case:
        """One set of physics beside constant curvature in its two meanings."""
        try:
            sweep = self.solve(physics, tension)
        except BowstringError as error:
            gap = np.full((len(tension), 3), math.nan)
            lengths = np.full((len(tension), len(self.robot.tendons.segment)), math.nan)
            return Case(physics, str(error), gap, self.compare(tension, gap, lengths, _MEANINGS))
        bad = np.flatnonzero(~np.asarray(sweep.converged))
        problem = None
        if len(bad) == len(tension):
            problem = f"no stable equilibrium found at any load ({sweep.status[bad[0]]})"
        elif len(bad):
            problem = (
                f"no stable equilibrium found at {len(bad)} of {len(tension)} loads "
                f"({sweep.status[bad[0]]} at {tension[bad[0]]:.4g} N); means are over the others"
            )
        tip = sweep.tip_position
        comparisons = self.compare(tension, tip, sweep.tendon_lengths, _MEANINGS)
        return Case(physics, problem, tip, comparisons)


def _geometric_sweep(model: _Model) -> GeometricSweep:
    """Shorten the pulled tendon as the linear law would, the others follow at constant length."""
    robot, settings = model.robot, model.settings
    tension = np.linspace(0.0, settings.max_tension, settings.points)
    arcs = arc.robot_from_tensions(robot, model.tensions(tension))
    try:
        lengths = arc.robot_lengths(robot, arcs.kappa, arcs.phi, arcs.length)
    except BowstringError:
        turns = settings.max_tension * sum(_linear_bend(robot, settings.tendon)) / math.tau
        raise InputError(
            f"by the linear law {settings.max_tension:g} N winds {robot.name} up by "
            f"{_figures(turns)} turns, tighter than its tendons' distance from the backbone lets "
            "them; check its stiffness or give a smaller largest tension"
        ) from None
    # Eq. 5 proper: from the lengths. It needs three tendons a segment and lengths that some arc
    # has; a robot without them keeps the arcs the lengths came from, which are the same ones.
    with suppress(InputError):
        arcs = arc.robot_fk(robot, lengths)
    straight = robot.disks.station_m[robot.tendons.end_disk[settings.tendon]]
    return GeometricSweep(
        pull=straight - lengths[:, settings.tendon],
        tendon_lengths=lengths,
        theta=arcs.kappa * arcs.length,
        tip_position=arcs.tip.position,
        disk_positions=arcs.disk_positions,
        disk_rotations=arcs.disk_rotations,
        backbone=_backbone(arcs),
    )


def _backbone(arcs: arc.RobotArcs, per_segment: int = 24) -> Array:
    """Points along the arcs (n, P, 3), the base first, m."""
    n, segments = arcs.kappa.shape
    start, turn = np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3))
    parts = [start[:, None]]
    share = np.arange(1, per_segment + 1) / per_segment
    for k in range(segments):
        kappa, phi, length = (v[:, k, None] for v in (arcs.kappa, arcs.phi, arcs.length))
        pose = arc.pose(kappa, phi, length, length * share)
        points = start[:, None] + np.einsum("nij,npj->npi", turn, pose.position)
        parts.append(points)
        start, turn = points[:, -1], turn @ pose.rotation[:, -1]
    return np.concatenate(parts, axis=1)


def _statics(model: _Model) -> Statics:
    robot, settings = model.robot, model.settings
    tension = np.linspace(0.0, settings.max_tension, settings.points)
    sweep = model.solve(model.main, tension, disks=True)
    if not np.any(sweep.converged):
        raise NoSolutionError(
            f"no load from 0 to {tension[-1]:g} N has a stable equilibrium that the solver could "
            f"find ({sweep.message(0).rstrip('.')}); check stiffness, gravity and largest tension"
        )
    assert sweep.disk_positions is not None
    straight = robot.disks.station_m[robot.tendons.end_disk[settings.tendon]]
    r = float(robot.tendons.pitch_radius_m[settings.tendon])
    return Statics(
        tension=tension,
        status=tuple(sweep.status),
        converged=np.asarray(sweep.converged, dtype=bool),
        tip_position=sweep.tip_position,
        disk_positions=sweep.disk_positions,
        tendon_lengths=sweep.tendon_lengths,
        pull=straight - sweep.tendon_lengths[:, settings.tendon],
        linear_pull=r * sum(_linear_bend(robot, settings.tendon)) * tension,
    )


# -- error budget ------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Effect:
    key: str
    label: str
    on: dict[str, Any]
    """Fields of `Physics` that make the effect act."""
    alternative: bool = False
    """Another value of a field that the fullest physics sets otherwise."""


def _times(vector: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    # + 0.0: no negative zeros
    x, y, z = (v * factor + 0.0 for v in vector)
    return (x, y, z)


def _effects(model: _Model) -> list[_Effect]:
    robot = model.robot
    clamps = sorted({f"{c * 1e3:.4g}" for c in model.budget_clamps})
    force = _tip_force(robot)
    return [
        _Effect(
            "straight_spans", "straight spans, not a continuous tendon", {"tendon": "straight"}
        ),
        _Effect("clamps", f"disks clamp {' / '.join(clamps)} mm", {"clamped": "budget"}),
        _Effect("shear_extension", "shear and extension", {"theory": "cosserat"}),
        _Effect("torsion", "torsion (the backbone may twist)", {"twist": True}),
        _Effect("gravity_upright", "gravity, upright", {"gravity": (0.0, 0.0, -GRAVITY)}),
        _Effect("gravity_hanging", "gravity, hanging", {"gravity": (0.0, 0.0, GRAVITY)}, True),
        _Effect(
            "gravity_horizontal",
            "gravity, horizontal",
            {"gravity": _times(model.towards, -GRAVITY)},
            True,
        ),
        _Effect(
            "tip_force", f"{force:g} N across the tip", {"tip_force": _times(model.across, force)}
        ),
        _Effect("E_minus_10", "E 10 % lower", {"stiffness": 0.9}),
        _Effect("E_plus_10", "E 10 % higher", {"stiffness": 1.1}, True),
    ]


def _tip_force(robot: Robot) -> float:
    """1 N for the study's robot; for another the round force that moves its tip as much, N."""
    compliance, beyond = 0.0, robot.length
    for segment, stiffness in zip(robot.segments, robot.bending_stiffness, strict=True):
        inner = beyond - segment.length
        compliance += (beyond**3 - inner**3) / (3.0 * float(stiffness))
        beyond = inner
    return _round_down(_MAX_SIDEWAYS * robot.length / compliance)


def _without(physics: Physics, effect: _Effect) -> Physics:
    plain = Physics()
    return replace(physics, **{name: getattr(plain, name) for name in effect.on})


def _acts(model: _Model, effect: _Effect) -> bool:
    """Whether the main sweep has the effect (of gravity: exactly this one)."""
    if effect.key == "clamps":
        return any(s.disks.clamped_length for s in model.robot.segments)
    return all(getattr(model.main, name) == value for name, value in effect.on.items())


def _changed(model: _Model, effect: _Effect) -> Physics:
    """The physics of the main sweep with only this effect changed."""
    if _acts(model, effect):
        return _without(model.main, effect)
    return replace(model.main, **effect.on)


def _budget(model: _Model, tension: Array, tell: Callable[[float], None]) -> Budget:
    effects = _effects(model)
    plain = Physics()
    cases: dict[Physics, Case] = {}

    def case(physics: Physics) -> Case:
        if physics not in cases:
            cases[physics] = model.case(physics, tension)
        return cases[physics]

    full = plain
    for effect in effects:
        if not effect.alternative:
            full = replace(full, **effect.on)
    posture = "upright"
    if case(full).problem:
        # A backbone that cannot stand under its own weight can still hang.
        hanging = replace(full, gravity=(0.0, 0.0, GRAVITY))
        if not case(hanging).problem:
            full, posture = hanging, "hanging"

    rows = []
    for i, effect in enumerate(effects):
        whole = replace(full, **effect.on)
        rows.append(
            BudgetRow(
                effect.key,
                effect.label,
                added=case(replace(plain, **effect.on)),
                full=case(whole),
                removed=case(_without(whole, effect)),
                in_sweep=case(_changed(model, effect)),
                acts_in_sweep=_acts(model, effect),
            )
        )
        tell((i + 1) / len(effects))

    clamps = (
        "the file's clamps"
        if any(s.disks.clamped_length for s in model.robot.segments)
        else "each disk clamps as much backbone as it is thick (3 mm if its thickness is zero)"
    )
    x, y, _ = model.towards
    return Budget(
        plainest=case(plain),
        fullest=case(full),
        sweep=case(model.main),
        rows=tuple(rows),
        plainest_is="continuous tendon, no clamps, no shear or extension, no twist, no gravity, no "
        "tip force, E as in the file",
        fullest_is=f"straight spans, clamps, shear and extension, twist, gravity ({posture}), tip "
        "force, E 10 % lower",
        notes=(
            "Effects interact and can cancel: neither the column 'added' nor the column 'removed' "
            "adds up to the whole, and one effect can lower the error that another one makes.",
            "'From force' always uses the file's own E and length, as a user would, also where "
            "the physics is stiffer, softer or clamped.",
            "'In this sweep' changes the effect alone in the physics of the main sweep: taken out "
            "if it acts there, added if not (gravity takes the place of the file's).",
            "'Removed' takes the effect out of the fullest physics. The alternatives (gravity in "
            "the other orientations, E 10 % higher) are compared with a fullest physics that has "
            "them in place of its own.",
            f"Gravity is {GRAVITY} m/s2: upright along -z (base below), hanging along +z, "
            f"horizontal along ({_zero(-x):.3g}, {_zero(-y):.3g}, 0), in the bending plane and "
            "against the pulled tendon, which lies on top.",
            "The force across the tip is dead and perpendicular to the bending plane. It is the "
            "largest round force that moves the straight robot's tip by at most 13 % of the "
            "length by linear theory: 1 N for the study's robot.",
            f"Clamps: {clamps}.",
        ),
    )


# -- verdict -----------------------------------------------------------------------------------


def _verdict(model: _Model, comparisons: dict[str, Comparison], budget: Budget) -> Verdict:
    settings = model.settings
    limit = settings.tolerance * model.length
    fine = np.linspace(0.0, settings.max_tension, _FINE_POINTS)
    case = model.case(model.main, fine)
    meanings = tuple(_meaning(model, name, case, fine, limit) for name in _MEANINGS)
    return Verdict(
        tolerance=settings.tolerance,
        tolerance_length=limit,
        meanings=meanings,
        fine_tension=fine,
        fine_error={name: case.error(name) for name in _MEANINGS},
        text=(
            *(m.text for m in meanings),
            *_on_corrections(comparisons),
            *_on_left_out(budget),
        ),
    )


def _meaning(model: _Model, name: str, case: Case, tension: Array, limit: float) -> Meaning:
    error = case.error(name)
    known = np.isfinite(error)
    above = known & (np.nan_to_num(error) > limit)

    def error_at(value: float, physics: Physics = model.main) -> float:
        return float(model.case(physics, np.array([value])).error(name)[0])

    def crossing(i: int, j: int) -> float:
        """Between the loads i (not above) and j (above), which are neighbours."""
        low, high = float(tension[i]), float(tension[j])
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            value = error_at(middle)
            if not math.isfinite(value):
                break
            low, high = (low, middle) if value > limit else (middle, high)
        return high

    fails = []
    for i, j in _runs(above):
        start = crossing(i - 1, i) if i > 0 and known[i - 1] else float(tension[i])
        more = j + 1 < len(tension) and known[j + 1]
        fails.append((start, crossing(j + 1, j) if more else float(tension[j])))
    undecided = tuple((float(tension[i]), float(tension[j])) for i, j in _runs(~known))

    holds_to: float | None = None
    if known[0] and not above[0]:
        gaps = [a for a, _ in fails] + [float(tension[i - 1]) for i, _ in _runs(~known) if i]
        holds_to = min([*gaps, float(tension[-1])])
    peak = int(np.argmax(np.where(known, error, -1.0)))
    blamed_at = fails[0][0] if fails else float(tension[peak])
    shares: tuple[Share, ...] = ()
    if np.any(known):
        shares = _shares(model, error_at, blamed_at, 1e-9 * model.length)
    meaning = Meaning(
        name=name,
        holds_throughout=not fails and not undecided,
        holds_to=holds_to,
        fails=tuple(fails),
        undecided=undecided,
        error_at_end=float(error[-1]),
        max_error=_max(error),
        max_at=float(tension[peak]),
        blamed_at=blamed_at,
        shares=shares,
        text="",
    )
    solved = np.all(np.isfinite(case.tip_position), axis=-1)
    reasons = (
        (~known & ~solved, "no stable equilibrium was found"),
        (~known & solved, "constant curvature has no arc there"),
    )
    without = []
    for where, why in reasons:
        if ranges := [_range(float(tension[i]), float(tension[j])) for i, j in _runs(where)]:
            without.append(f"{_listed(ranges)} ({why})")
    return replace(meaning, text=_in_words(model, meaning, limit, without))


def _shares(
    model: _Model, error_at: Callable[[float, Physics], float], tension: float, nothing: float
) -> tuple[Share, ...]:
    """Remove each effect that acts in the main sweep, one at a time, at one load."""
    whole = error_at(tension, model.main)
    if not whole > nothing:
        return ()
    plain, robot = Physics(), model.robot
    clamped = any(s.disks.clamped_length for s in robot.segments)
    acting = {
        "straight_spans": ("straight spans between the disks", "tendon", True),
        "clamps": ("the backbone that the disks clamp", "clamped", clamped),
        "shear_extension": ("shear and extension", "theory", model.main.theory == "cosserat"),
        "torsion": ("torsion", "twist", True),
        "gravity": ("gravity as in the file", "gravity", any(robot.gravity)),
    }
    out = []
    for key, (label, name, acts) in acting.items():
        if acts:
            rest = error_at(tension, replace(model.main, **{name: getattr(plain, name)}))
            if math.isfinite(rest):
                out.append(Share(key, label, rest, (whole - rest) / whole))
    return tuple(sorted(out, key=lambda s: -s.share))


def _in_words(model: _Model, m: Meaning, limit: float, without: Sequence[str]) -> str:
    percent = f"{model.settings.tolerance * 100:.3g} % of length ({_mm(limit)})"
    top = f"{model.settings.max_tension:.4g} N"
    source = {
        "cc_from_lengths": "From tendon lengths (Eq. 5)",
        "cc_from_force": "From force through the linear law",
    }[m.name]
    if not math.isfinite(m.max_error):
        return (
            f"{source}, constant curvature gives no tip at any load: it needs three tendons in "
            "each segment and lengths that an arc can have."
        )
    largest = (
        f"{_mm(m.max_error)} ({_percent(m.max_error / model.length)} of length) "
        f"at {_figures(m.max_at)} N"
    )
    if m.holds_throughout:
        words = f"{source}, constant curvature holds to {percent} over the whole sweep to {top}"
    elif not m.fails:
        words = f"{source}, constant curvature holds to {percent} wherever it could be compared"
    elif m.holds_to is None or m.holds_to == 0.0:
        words = f"{source}, constant curvature is off by more than {percent} from the first load"
    else:
        words = f"{source}, constant curvature holds to {percent} up to {_figures(m.holds_to)} N"
    words += f"; its largest error is {largest}."
    if m.fails:
        ranges = _listed([f"{_figures(a)} to {_figures(b)} N" for a, b in m.fails])
        words += f" It does not hold from {ranges}."
    if m.undecided:
        words += f" No comparison is possible at {_listed(without)}."
    words += _blame(m)
    return words


def _blame(m: Meaning) -> str:
    where = f"at {_figures(m.blamed_at)} N"
    if not m.shares:
        return " Here the two agree."
    worst = m.shares[0]
    if worst.share <= 0.0:
        return (
            f" No effect of this sweep is to blame alone {where}: removing any one "
            "of them leaves the error as large or larger."
        )
    if worst.share < _WORTH_NAMING:
        return (
            f" No single effect of this sweep explains it {where}: without {worst.label}, which "
            f"has the largest share, the error would still be {_mm(worst.error_without)}."
        )
    if m.fails:
        verb = "What ends it"
    else:
        verb = "Most of that" if worst.share > 0.5 else "The largest part of that"
    rest = f"without that alone the error {where} would be {_mm(worst.error_without)}"
    words = f" {verb}: {worst.label}; {rest}."
    rivals = [s.label for s in m.shares[1:] if s.share > 0.5 * worst.share]
    if rivals:
        words += f" Nearly as much: {_listed(rivals)} (effects interact, shares need not add up)."
    return words


def _on_corrections(comparisons: dict[str, Comparison]) -> list[str]:
    chord, arm = comparisons["cc_from_lengths_chord"], comparisons["cc_from_force_arm"]
    plain, force = comparisons["cc_from_lengths"], comparisons["cc_from_force"]
    parts = []
    for what, source, before, after in (
        ("chords instead of arcs", "from lengths", plain, chord),
        ("the mean lever arm", "from force", force, arm),
    ):
        was, now = _mm(before.mean), _mm(after.mean)
        if not math.isfinite(after.mean):
            continue
        if was == now:
            parts.append(f"{what}, {source}: the mean error stays at {now}")
        else:
            change = "better" if after.mean < before.mean else "worse"
            parts.append(f"{what}, {source}: {change}, mean error {now} instead of {was}")
    return [f"Corrections in closed form: {'; '.join(parts)}."] if parts else []


def _on_left_out(budget: Budget) -> list[str]:
    """Which effect that the main sweep lacks would cost most."""
    out = []
    partly = []
    for meaning, words in zip(_MEANINGS, ("from lengths", "from force"), strict=True):
        needed = np.isfinite(budget.sweep.error(meaning))
        rows, missing = [], []
        for row in budget.rows:
            if row.acts_in_sweep:
                continue
            if not needed.any() or np.any(needed & ~np.isfinite(row.in_sweep.error(meaning))):
                missing.append(row.label)
            else:
                rows.append((row.in_sweep.comparisons[meaning].mean, row))
        if rows:
            mean, row = max(rows, key=lambda pair: pair[0])
            out.append(f"{words} a mean error of {_mm(mean)} ({row.label})")
        if missing:
            partly.append(f"{words}: {'; '.join(missing)}")
    if not out:
        return []
    text = (
        "A real robot has effects that this sweep leaves out. Of those in the budget, each added "
        f"alone to this sweep, the costliest makes {' and '.join(out)}."
    )
    if partly:
        text += (
            " Not compared, because they have numbers at some of the loads only or at none: "
            f"{' / '.join(partly)}."
        )
    return [text]


def _claim(model: _Model, comparisons: dict[str, Comparison]) -> PublishedClaim | None:
    """The study's printed mean, for its own robot and load range only."""
    if model.robot.name != "amouri2019" or model.settings.max_tension != 80.0:
        return None
    ours = comparisons["cc_from_force"]
    x, _, z = ours.mean_by_axis
    text = (
        "Amouri 2019 prints, for constant curvature against its finite-element run, a mean error "
        "smaller than 4.95 mm (0.77 % of length), and speaks of errors along each axis. This is "
        f"the study's published mean; ours, from force and against statics, is {_mm(ours.mean)} "
        f"({_percent(ours.mean / model.length)}; {_mm(x)} in x, {_mm(z)} in z). How the study "
        "turned force into cable length is our reading of its section 4.1 (the linear law). No "
        "measured data of the study are available, so nothing here is its measurement."
    )
    if model.robot.hash != load_robot("amouri2019").hash:
        text += " The robot studied here differs from the built-in one in some of its numbers."
    return PublishedClaim(4.95, 0.77, ours.name, text)


def _notes(model: _Model, statics: Statics, comparisons: dict[str, Comparison]) -> tuple[str, ...]:
    robot, settings = model.robot, model.settings
    out = [
        "All data are simulated: constant curvature is compared with the statics of this program, "
        "not with a measurement. Both share the base frame, so nothing was registered.",
        "Errors are Euclidean at the tip unless an axis is named; means and RMS are over loads "
        "(zero load included), never over coordinates.",
        f"Physics of the main sweep: {settings.theory.capitalize()} rod, frictionless tendons "
        "straight from disk to disk, dead loads, "
        + (
            f"gravity ({', '.join(f'{g:g}' for g in robot.gravity)}) m/s2 as in the robot file."
            if any(robot.gravity)
            else "no gravity (the robot file has none)."
        ),
    ]
    if settings.range_chosen:
        out.append(
            f"The load range to {settings.max_tension:g} N was chosen by the program: the largest "
            "round load that bends the robot by at most 80 degrees by the linear law."
        )
    failed = np.flatnonzero(~statics.converged)
    if failed.size:
        out.append(
            f"{failed.size} of {len(statics.tension)} loads have no stable equilibrium that the "
            f"solver found (first at {statics.tension[failed[0]]:.4g} N: "
            f"{statics.status[failed[0]]}); they count in no mean."
        )
    for name, comparison in comparisons.items():
        missing = int(statics.converged.sum()) - comparison.n
        if missing:
            out.append(
                f"Constant curvature {COMPARISONS[name]} has no arc at {missing} of the loads that "
                f"statics solved; its numbers are over the other {comparison.n}."
            )
    return tuple(out)


# -- small helpers -----------------------------------------------------------------------------


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan


def _max(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else math.nan


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _zero(value: float) -> float:
    return 0.0 if abs(value) < 1e-12 else value


def _figures(value: float, digits: int = 3) -> str:
    """A few significant digits, large numbers without an exponent."""
    return f"{value:.0f}" if abs(value) >= 10.0**digits else f"{value:.{digits}g}"


def _mm(metres: float) -> str:
    """Three significant digits of mm, nothing finer than a micrometre."""
    mm = metres * 1e3
    if not math.isfinite(mm):
        return "no number"
    if abs(mm) < 1e-3:
        return "under 0.001 mm"
    return f"{_figures(mm)} mm" if abs(mm) >= 0.1 else f"{mm:.3f} mm"


def _percent(share: float) -> str:
    return f"{_figures(share * 100.0, 2)} %"


def _range(a: float, b: float) -> str:
    return f"{_figures(a)} N" if a == b else f"{_figures(a)} to {_figures(b)} N"


def _listed(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else ", ".join(parts[:-1]) + " and " + parts[-1]


def _plain(value: Any) -> Any:
    """JSON values only: NaN and infinities become None."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, (bool, str, int)) or value is None:
        return value
    number = float(value)
    return number if math.isfinite(number) else None
