"""Error budget of actuation: friction at the holes, elastic tendons, displacement control.

Two kinds of control of the actuated tendon, each compared with itself without the effects:

- *tension control*, from zero to the study's largest tension and back, with friction at the holes;
- *displacement control*: constant curvature gives the tendon lengths, and spools command them; with
  inextensible tendons, with elastic ones, and with elastic ones and friction, loading and
  unloading.

A memory that the robot file gives adds rows: hysteresis and backlash in loading and unloading,
relaxation and creep for loads that are held until the robot rests.

With friction the pose depends on the path, so both are solved step by step. Calibrated friction
takes precedence over that of the robot file. If the file gives no friction or no elasticity, a
stated value is assumed to show its effect; it is marked as assumed in all output. The assumed
elasticity follows from the diameter and the material of the tendon, or from the size of the robot;
if that gives no realistic tendon, the row is left out.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final, Literal, cast

import numpy as np

from bowstring.aliases import Floats, Ints
from bowstring.constant_curvature import RobotArcs
from bowstring.data.tip_errors import Comparison, known_max, known_mean
from bowstring.display import short_repr
from bowstring.formatting import in_mm, in_percent, listed, significant
from bowstring.results import Key, Result
from bowstring.robot.model import Robot, with_tendons, without_laws
from bowstring.robot.parts import TENDON_MATERIALS, TendonRing
from bowstring.statics import rod
from bowstring.statics.load import Load
from bowstring.statics.solution import Sweep
from bowstring.study.comparison import MEANINGS, Case, Model

if TYPE_CHECKING:
    from bowstring.study import budget_rows as schema

Control = Literal["tension", "displacement"]
Source = Literal["file", "calibrated", "assumed", "left_out"]

ASSUMED_FRICTION: Final = 0.1
"""Assumed friction coefficient: typical of a steel cable in a smooth or greased hole (dry steel on
plastic or steel is above it, a PTFE liner below)."""
_SLENDER: Final = 48.0  # pitch radius over assumed tendon diameter: 0.6 mm for the study's robot
_THINNEST, _THICKEST = 2e-5, 5e-3  # m; range of realistic tendon diameters
_MATERIAL: Final = "steel"  # default of the robot file
_SURPLUS: Final = 0.01  # slack of the other tendons over length
_STEPS: Final = 40  # least number of steps for loading, and for unloading

_HELD: Final = 1e6  # time of each load over that of the memory, for rest to within a millionth

COMMANDED: Final = "cc_from_commanded_lengths"
"""Comparison: constant curvature from the commanded lengths, l0 - displacement."""


# -- what is computed --------------------------------------------------------------------------


@short_repr
@dataclass(frozen=True)
class ActuationRow:
    """One effect of actuation, compared with the same commands without it."""

    effect: str
    """Key, such as ``"friction_loading"``."""
    label: str
    """Effect in words with its value."""
    control: Control
    """Controlled quantity of the actuated tendons."""
    assumed: tuple[str, ...]
    """Assumed properties: ``"friction"``, ``"elasticity"``."""
    case: Case
    """Case with the effect."""
    base: Case
    """Case with the same commands on inextensible tendons without friction."""

    @property
    def short_label(self) -> str:
        """Label for narrow tables, without the control and text in brackets."""
        label = re.sub(r" \([^)]*\)", "", self.label).removeprefix("displacement control, ")
        return label.replace("elastic tendons,", "elastic,")

    @property
    def moved(self) -> float:
        """Mean displacement of the robot's tip by the effect, m."""
        return known_mean(np.linalg.norm(self.case.tip_position - self.base.tip_position, axis=-1))

    @property
    def moved_n(self) -> int:
        """Number of loads over which `moved` is the mean."""
        both = np.isfinite(self.case.tip_position) & np.isfinite(self.base.tip_position)
        return int(both.all(axis=-1).sum())

    def mean_error(self, case: Case) -> float:
        """Mean error of constant curvature, from force or from the commanded lengths, m."""
        return case.comparisons["cc_from_force" if self.control == "tension" else COMMANDED].mean

    @property
    def exceeds(self) -> bool:
        """Whether the mean displacement exceeds the mean error of constant curvature."""
        return self.moved > self.mean_error(self.base)

    def to_dict(self) -> schema.ActuationRow:
        """Return plain values in mm and percent."""
        found = {
            "effect": self.effect,
            "label": self.label,
            "control": self.control,
            "assumed": list(self.assumed),
            **self.case.to_dict(self.base),
            "more_than_constant_curvature": self.exceeds,
        }
        return cast("schema.ActuationRow", found)


@short_repr
@dataclass(frozen=True)
class Loop(Result):
    """Loading to the largest command and unloading: the hysteresis of the tip."""

    control: Control
    """Controlled quantity of the actuated tendons."""
    command: Floats
    """Tension (N) or displacement (m) of the actuated tendon (n,)."""
    free: Annotated[Floats, Key("tip_free_mm")]
    """Tip without friction and tendon elasticity (n, 3), m; NaN without an equilibrium."""
    loading: Annotated[Floats, Key("tip_loading_mm")]
    """Tip in loading (n, 3), m; NaN without an equilibrium."""
    unloading: Annotated[Floats, Key("tip_unloading_mm")]
    """Tip in unloading (n, 3), m, in the order of the commands; NaN without an equilibrium."""
    constant_curvature: Annotated[Floats, Key("tip_constant_curvature_mm")]
    """Tip by constant curvature from force or from the commanded lengths (n, 3), m; NaN without an
    arc."""
    length: float
    """Length of the robot, m."""

    @property
    def apart(self) -> Floats:
        """Distance of the tips of loading and unloading at equal command (n,), m."""
        return np.asarray(np.linalg.norm(self.loading - self.unloading, axis=-1))

    @property
    def width(self) -> Annotated[float, Key("width_mm")]:
        """Largest distance between loading and unloading at equal command, m; NaN without one."""
        return known_max(self.apart)

    @property
    def width_share(self) -> Annotated[float, Key("width_percent")]:
        """Largest distance as a share of the length; NaN without one."""
        return self.width / self.length

    @property
    def widest_at(self) -> float:
        """Command of the largest distance, N or m."""
        known = np.isfinite(self.apart)
        return float(self.command[np.nanargmax(self.apart)]) if known.any() else math.nan


@short_repr
@dataclass(frozen=True)
class TensionLoop(Loop):
    """Hysteresis under tension control."""

    control: Annotated[Literal["tension"], Key()]
    """Actuation."""

    @property
    def tension(self) -> Annotated[Floats, Key("tension_N")]:
        """Commands (n,), N."""
        return self.command

    @property
    def widest_at_tension(self) -> Annotated[float, Key("widest_at_tension_N")]:
        """Command of the largest distance, N; NaN without one."""
        return self.widest_at


@short_repr
@dataclass(frozen=True)
class DisplacementLoop(Loop):
    """Hysteresis under displacement control."""

    control: Annotated[Literal["displacement"], Key()]
    """Actuation."""

    @property
    def displacement(self) -> Annotated[Floats, Key("displacement_mm")]:
        """Commands (n,), m; NaN without an equilibrium."""
        return self.command

    @property
    def widest_at_displacement(self) -> Annotated[float, Key("widest_at_displacement_mm")]:
        """Command of the largest distance, m; NaN without one."""
        return self.widest_at


@short_repr
@dataclass(frozen=True)
class ActuationBudget(Result):
    """Effects of friction, elastic tendons and displacement control on constant curvature."""

    friction: Annotated[float, Key()]
    """Friction coefficient of the actuated tendon."""
    friction_origin: Annotated[Source, Key()]
    """Source of the friction: robot file, calibration, or assumption."""
    axial_stiffness: Annotated[float, Key("axial_stiffness_N")]
    """E A of the actuated tendon, N; infinite if only its transmission is compliant."""
    compliance: Annotated[float, Key("compliance_m_per_N")]
    """Compliance of its transmission, m/N."""
    free_length: Annotated[float, Key("free_length_m")]
    """Free length of the actuated tendon, from base hole to actuator, m."""
    elasticity_origin: Annotated[Source, Key()]
    """Source of the elasticity; ``"left_out"`` without any value of E A."""
    elasticity_by: Annotated[str, Key()]
    """Basis of an assumed E A, or reason why there is none."""
    displacement: Annotated[Floats, Key("commanded_displacement_mm")]
    """Commanded displacement of the actuated tendon at the loads of the sweep (n,), m; NaN without
    an equilibrium."""
    tension_controlled: Case
    """Case of tension control without friction: the main sweep."""
    displacement_controlled: Case
    """Case of displacement control with inextensible tendons without friction."""
    rows: tuple[ActuationRow, ...]
    """Effects: tension control before displacement control."""
    loops: Annotated[tuple[TensionLoop, DisplacementLoop], Key("hysteresis")]
    """Loops of tension control and displacement control."""
    notes: Annotated[tuple[str, ...], Key()]
    """Assumed values, paths and commands in sentences."""
    text: Annotated[tuple[str, ...], Key()]
    """Results in sentences."""

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumed properties in words."""
        out = [f"friction {self.friction:g}"] * self.friction_assumed
        stretch = f"{_elasticity(self.axial_stiffness, 0.0)} ({self.elasticity_by})"
        return (*out, *[stretch] * self.elasticity_assumed)

    @property
    def friction_assumed(self) -> bool:
        """Whether friction is assumed, given neither by the file nor by measurements."""
        return self.friction_origin == "assumed"

    @property
    def elasticity_assumed(self) -> bool:
        """Whether elasticity is assumed because the file gives none."""
        return self.elasticity_origin == "assumed"

    @property
    def origins(self) -> tuple[str, ...]:
        """Sources of values outside the robot file, in sentences without a full stop."""
        out = []
        if self.friction_origin == "calibrated":
            out.append(f"calibrated to the data: friction {self.friction:.4g}")
        if self.assumptions:
            out.append(f"assumed, the robot file gives none: {'; '.join(self.assumptions)}")
        if self.elasticity_origin == "left_out":
            out.append(f"left out: tendon elasticity, {self.elasticity_by}")
        return tuple(out)

    def row(self, effect: str) -> ActuationRow:
        """Return the row of an effect."""
        return next(row for row in self.rows if row.effect == effect)

    @property
    def under_tension(self) -> Annotated[schema.DescribedCase, Key("tension")]:
        """Tension control without friction and elasticity: the sweep."""
        words = "tension control, no friction (this sweep)"
        return cast("schema.DescribedCase", self.tension_controlled.described(words))

    @property
    def under_displacement(self) -> Annotated[schema.CommandedCase, Key("displacement")]:
        """Displacement control without friction and elasticity."""
        words = "displacement control, inextensible tendons, no friction"
        return cast("schema.CommandedCase", self.displacement_controlled.described(words))

    @property
    def effects(self) -> Annotated[list[schema.ActuationRow], Key("rows")]:
        """Effects: tension control before displacement control."""
        return [row.to_dict() for row in self.rows]


# -- running it --------------------------------------------------------------------------------


def actuation_budget(
    model: Model, tension: Floats, sweep: Case, calibrated: Robot | None = None
) -> ActuationBudget:
    """Compute the error budget of actuation.

    Parameters
    ----------
    model : Model
    tension : array (n,)
        Loads of the actuated tendon, increasing in equal steps, N.
    sweep : Case
        Main sweep at these loads.
    calibrated : Robot, optional
        Robot with calibrated friction.
    """
    t = model.tendon
    given = model.given_robot.tendons
    with_friction, friction_origin = _with_friction(model, calibrated)
    with_friction = without_laws(with_friction, "friction")
    stiff_of: float | None = None
    elasticity_origin: Source = "file"
    elasticity_by = "as in the file"
    if math.isinf(given.axial_stiffness_N[t]) and not given.compliance_m_per_N[t]:
        stiff_of, elasticity_by = assumed_stiffness(model.given_robot, t)
        elasticity_origin = "left_out" if stiff_of is None else "assumed"
    elastic_too = elasticity_origin != "left_out"
    gives = {} if stiff_of is None else {"axial_stiffness": stiff_of}
    both = with_tendons(with_friction, gives, missing=True)
    elastic = with_tendons(both, {"friction": 0.0})
    inextensible = {"axial_stiffness": None, "compliance": 0.0}
    rigid = with_tendons(elastic, inextensible)

    every = max(1, math.ceil(_STEPS / (len(tension) - 1)))
    there = np.linspace(0.0, tension[-1], every * (len(tension) - 1) + 1)
    and_back = np.concatenate((there, there[-2::-1]))
    commanded = _Commanded(model, there)
    displacements = np.concatenate((commanded.displacements, commanded.displacements[-2::-1]))

    def solved(robot: Robot, load: Load, *, held: bool = False) -> tuple[_Branch, _Branch]:
        """Solve loading and unloading, both in the order of increasing commands.

        With `held` each load is held until the robot rests.
        """
        load = load.replace(gravity=model.main.load.gravity)
        times = None
        if held:
            slowest = max(robot.relaxation[..., 1].max(), robot.tendons.creep[..., 1].max())
            times = _HELD * slowest * np.arange(2.0 * len(there) - 1.0)
        path = rod.sweep(robot, load=load, model=model.main.model, disks=False, times=times)
        up = np.arange(len(there))
        return _Branch(path, up, every), _Branch(path, len(path.status) - 1 - up, every)

    def by_displacement(robot: Robot) -> tuple[_Branch, _Branch]:
        return solved(robot, Load(displacements=displacements))

    intended = commanded.tip[::every]

    def case(branch: _Branch, control: Control) -> Case:
        if control == "tension":
            compared = model.compare(tension, branch.tip, branch.lengths, MEANINGS)
        else:
            off = intended - branch.tip
            compared = {COMMANDED: Comparison(COMMANDED, "statics", model.length, intended, off)}
        return Case(model.main, branch.problem, branch.tip, compared)

    free = model.solve(model.main, there).tip_position
    up, down = solved(with_friction, Load(model.tensions(and_back)))
    stiff, _ = by_displacement(rigid)
    stretched, _ = by_displacement(elastic)
    loaded, released = by_displacement(both)
    base = case(stiff, "displacement")
    taut = any(commanded.conflicts(branch) for branch in (stiff, stretched, loaded, released))

    mu = both.tendons.friction[t]
    stiffness = float(both.tendons.axial_stiffness_N[t])
    compliance = float(both.tendons.compliance_m_per_N[t])
    friction = f"friction {mu:.4g}" + ("" if friction_origin == "file" else f" ({friction_origin})")
    elasticity = _elasticity(stiffness, compliance) + ", assumed" * (elasticity_origin == "assumed")
    give = (
        f"displacement control, elastic tendons ({elasticity})"
        if elastic_too
        else "displacement control"
    )
    friction_assumed = ("friction",) * (friction_origin == "assumed")
    elasticity_assumed = ("elasticity",) * (elasticity_origin == "assumed")

    def row(effect: str, label: str, assumed: tuple[str, ...], branch: _Branch) -> ActuationRow:
        on_tension = effect.startswith(("friction", "hysteresis", "relaxation"))
        by: Control = "tension" if on_tension else "displacement"
        beside = sweep if by == "tension" else base
        return ActuationRow(effect, label, by, assumed, case(branch, by), beside)

    def both_ways(
        effect: str, label: str, branches: tuple[_Branch, _Branch]
    ) -> tuple[ActuationRow, ...]:
        ways = zip(("loading", "unloading"), branches, strict=True)
        return tuple(row(f"{effect}_{way}", f"{label}, {way}", (), each) for way, each in ways)

    rows = (
        row("friction_loading", f"{friction}, loading", friction_assumed, up),
        row("friction_unloading", f"{friction}, unloading", friction_assumed, down),
        *[row("tendon_elasticity", give, elasticity_assumed, stretched)] * elastic_too,
        row(
            "displacement_controlled_loading",
            f"{give}, {friction}, loading",
            friction_assumed + elasticity_assumed,
            loaded,
        ),
        row(
            "displacement_controlled_unloading",
            f"{give}, {friction}, unloading",
            friction_assumed + elasticity_assumed,
            released,
        ),
    )
    sets: tuple[ActuationRow, ...] = ()
    if "hysteresis" in model.given_robot.memories:
        set_only = without_laws(model.given_robot, "hysteresis")
        share = float(set_only.hysteresis[:, 0].max())
        label = f"hysteresis of the backbone ({in_percent(share)})"
        branches = solved(set_only, Load(model.tensions(and_back)))
        sets = both_ways("hysteresis", label, branches)
    drives: tuple[ActuationRow, ...] = ()
    if "backlash" in model.given_robot.memories:
        half = {"backlash": float(given.backlash_m[t])}
        label = f"displacement control, backlash ({in_mm(half['backlash'])} each way)"
        drives = both_ways("backlash", label, by_displacement(with_tendons(rigid, half)))
    held: tuple[ActuationRow, ...] = ()
    if (share := float(model.given_robot.relaxation[..., 0].sum(axis=-1).max())) > 0.0:
        soft = without_laws(model.given_robot, "relaxation")
        label = f"relaxation of the backbone ({in_percent(share)}), load held"
        rested, _ = solved(soft, Load(model.tensions(and_back)), held=True)
        held += (row("relaxation", label, (), rested),)
    if (creep := float(given.creep[t, :, 0].sum())) > 0.0:
        flows = with_tendons(without_laws(model.given_robot, "creep"), inextensible)
        crept, _ = solved(flows, Load(displacements=displacements), held=True)
        label = f"displacement control, creep of the tendons ({1e3 * creep:.4g} mm/N), load held"
        held += (row("creep", label, (), crept),)
    law = model.constant_curvature("cc_from_force", there, commanded.lengths)
    tips = stiff.path_tip, loaded.path_tip, released.path_tip, commanded.tip
    loops = (
        TensionLoop("tension", there, free, up.path_tip, down.path_tip, law, model.length),
        DisplacementLoop("displacement", commanded.displacements[:, t], *tips, model.length),
    )
    return ActuationBudget(
        friction=float(mu),
        friction_origin=friction_origin,
        axial_stiffness=stiffness,
        compliance=compliance,
        free_length=float(both.tendons.free_length_m[t]),
        elasticity_origin=elasticity_origin,
        elasticity_by=elasticity_by,
        displacement=commanded.displacements[::every, t],
        tension_controlled=sweep,
        displacement_controlled=base,
        rows=rows + sets + drives + held,
        loops=loops,
        notes=_notes(model, friction_origin, elasticity_origin, elasticity_by, stiffness)
        + _path_notes(model, len(there) - 1, taut),
        text=_in_words(rows, loops, friction_origin, elasticity_origin)
        + _of_memory(sets)
        + _of_memory(drives)
        + _when_held(held),
    )


def _with_friction(model: Model, calibrated: Robot | None) -> tuple[Robot, Source]:
    """Robot with friction for the budget, and the source of the friction."""
    robot = model.given_robot
    if calibrated is not None:
        changes = {}
        for k, segment in enumerate(calibrated.segments):
            ring = isinstance(segment.tendons, TendonRing)
            for i, tendon in enumerate(segment.tendon_list[:1] if ring else segment.tendon_list):
                where = f"segments.{k}.tendons" if ring else f"segments.{k}.tendons.{i}"
                changes[f"{where}.friction"] = tendon.friction
        return robot.with_(changes), "calibrated"
    if robot.tendons.friction[model.tendon] > 0.0 or robot.tendons.pushes.any():
        return robot, "file"  # friction is of tendons that only pull
    return with_tendons(robot, {"friction": ASSUMED_FRICTION}, missing=True), "assumed"


def assumed_stiffness(robot: Robot, tendon: int) -> tuple[float | None, str]:
    """Assumed axial stiffness of a tendon, and its source.

    Parameters
    ----------
    robot : Robot
    tendon : int
        Index from 0.

    Returns
    -------
    stiffness : float or None
        E A in N, to two digits: from diameter and material of the tendon, else of a steel tendon
        with a diameter derived from the robot's size. None if that diameter is not realistic.
    by : str
        Source of the value, or reason why there is none.
    """
    material = [t for s in robot.segments for t in s.tendon_list][tendon].material
    diameter = float(robot.tendons.diameter_m[tendon])
    by = "diameter as in the file"
    if math.isnan(diameter):
        diameter = float(robot.tendons.arm_m[tendon]) / _SLENDER
        by = "by the robot's size"
        if not _THINNEST <= diameter <= _THICKEST:
            return None, (
                f"for the file gives neither E A nor diameter, and the robot's size would make it "
                f"{1e3 * diameter:.2g} mm thick, which no tendon is"
            )
    stiffness = TENDON_MATERIALS[material or _MATERIAL] * math.pi / 4.0 * diameter**2
    return float(f"{stiffness:.2g}"), f"{material or _MATERIAL}, {1e3 * diameter:.2g} mm, {by}"


class _Commanded:
    """Commanded tendon lengths: those of the arcs of the linear law at the loads of the sweep.

    In gravity, where the linear law bends far more than the robot, they end at about the robot's
    own bend.
    """

    def __init__(self, model: Model, tension: Floats) -> None:
        robot = model.robot
        arcs = RobotArcs.from_tensions(robot, model.tensions(model.arc_scale * tension))
        self.tip = arcs.tip.position
        """Tip by constant curvature from these lengths (n, 3), m."""
        self.lengths = arcs.lengths()
        straight = robot.disks.station_m[robot.tendons.end_disk]
        # A tendon with pretension should stay taut. One without gets a surplus length, so that it
        # stays slack and does not act against the actuated one where the arc is inaccurate.
        slack = robot.tendons.pretension_N == 0.0
        slack[(model.shares != 0.0) | model.robot.tendons.pushes] = False
        self._others = np.flatnonzero(slack)
        self._nothing = 1e-12 * robot.length
        self.displacements = straight - self.lengths - _SURPLUS * robot.length * slack

    def conflicts(self, branch: _Branch) -> bool:
        """Whether a tendon that should be slack is taut at any command."""
        return bool(np.any(branch.slack[:, self._others] <= self._nothing))


class _Branch:
    """Loading or unloading of a path, in the order of increasing commands, every k-th step."""

    def __init__(self, path: Sweep, order: Ints, every: int) -> None:
        self.path_tip = path.tip_position[order]
        here = order[::every]
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


# -- in words ----------------------------------------------------------------------------------

_SAID: Final[dict[Source, str]] = {
    "file": "as in the file",
    "calibrated": "calibrated to the data",
    "assumed": "assumed, the file gives none",
}


def _elasticity(stiffness: float, compliance: float) -> str:
    parts = []
    if math.isfinite(stiffness):
        newtons = f"{stiffness:.4g} N" if stiffness < 1e3 else f"{stiffness / 1e3:.4g} kN"
        parts.append(f"E A {newtons}")
    if compliance:
        parts.append(f"transmission {compliance * 1e3:.4g} mm/N")
    return ", ".join(parts)


def _in_words(
    rows: tuple[ActuationRow, ...], loops: tuple[Loop, Loop], friction: Source, elasticity: Source
) -> tuple[str, ...]:
    up, down, *stretches, loaded, released = rows
    out = []

    def mean(row: ActuationRow) -> str:
        return in_mm(row.mean_error(row.case))

    def own(row: ActuationRow) -> str:
        return in_mm(row.mean_error(row.base))

    if math.isfinite(up.moved) and math.isfinite(down.moved):
        true, *changed = (
            case.comparisons["cc_from_lengths"].mean for case in (up.base, up.case, down.case)
        )
        from_lengths = ""
        if all(map(math.isfinite, (true, *changed))):
            from_lengths = (
                f" From true tendon lengths it changes from {in_mm(true)} to "
                f"{' and '.join(map(in_mm, changed))}."
            )
        mu = up.label.split(",")[0].split(" (")[0].removeprefix("friction ")
        out.append(
            f"Tension control: friction of {mu} at the holes ({_SAID[friction]}) moves the tip by "
            f"{in_mm(up.moved)} on average during loading and {in_mm(down.moved)} during "
            f"unloading. The mean error of constant curvature from force changes from {own(up)} to "
            f"{mean(up)} (loading) and {mean(down)} (unloading).{from_lengths}"
        )
    for stretched in (row for row in stretches if math.isfinite(row.moved)):
        source = f" ({_SAID[elasticity]})"
        give = stretched.label.removeprefix("displacement control, elastic tendons (").removesuffix(
            ")"
        )
        text = (
            f"Displacement control: elastic tendons, {give.removesuffix(', assumed')}{source}, "
            f"move the tip by {in_mm(stretched.moved)} on average. The mean error of constant "
            f"curvature from the commanded lengths changes from {own(stretched)} to "
            f"{mean(stretched)}"
        )
        if math.isfinite(loaded.moved) and math.isfinite(released.moved):
            text += (
                f"; with friction as well, to {mean(loaded)} (loading) and {mean(released)} "
                "(unloading)"
            )
        out.append(text + ".")
    widths = [
        f"{in_mm(loop.width)} ({in_percent(loop.width / loop.length)} of length) at "
        + (
            f"{significant(loop.widest_at)} N"
            if loop.control == "tension"
            else f"a tendon displacement of {in_mm(loop.widest_at)}"
        )
        for loop in loops
        if math.isfinite(loop.width)
    ]
    if widths:
        out.append(
            f"Hysteresis: at the same command, loading and unloading differ by up to "
            f"{' and '.join(widths)}. A model that knows only the command, as constant curvature "
            "does, has an error of at least half of this difference on one of the two branches."
        )
    if out and any(case.problem for row in rows for case in (row.case, row.base)):
        out.append(
            "Some commands have no equilibrium: each mean on actuation is over the others, which "
            "need not be the same ones for two means."
        )
    return tuple(out)


def _of_memory(rows: tuple[ActuationRow, ...]) -> tuple[str, ...]:
    """Sentences on hysteresis or backlash by its rows of loading and unloading, if any."""
    if not rows or not all(math.isfinite(row.moved) for row in rows):
        return ()
    up, down = rows
    what = up.label.removesuffix(", loading").removeprefix("displacement control, ")
    law = "from force" if up.control == "tension" else "from the commanded lengths"
    return (
        f"{up.control.capitalize()} control: {what} moves the tip by "
        f"{in_mm(up.moved)} on average during loading and {in_mm(down.moved)} during unloading. "
        f"The mean error of constant curvature {law} changes from "
        f"{in_mm(up.mean_error(up.base))} to {in_mm(up.mean_error(up.case))} (loading) and "
        f"{in_mm(down.mean_error(down.case))} (unloading).",
    )


def _when_held(rows: tuple[ActuationRow, ...]) -> tuple[str, ...]:
    """Sentences on relaxation and creep."""
    out = []
    for row in rows:
        if not math.isfinite(row.moved):
            continue
        what = row.label.removesuffix(", load held").removeprefix("displacement control, ")
        law = "from force" if row.control == "tension" else "from the commanded lengths"
        out.append(
            f"{row.control.capitalize()} control: {what} moves the tip by {in_mm(row.moved)} on "
            f"average once each load is held until the robot rests. The mean error of constant "
            f"curvature {law} then changes from {in_mm(row.mean_error(row.base))} to "
            f"{in_mm(row.mean_error(row.case))}."
        )
    return tuple(out)


def _notes(
    model: Model, friction: Source, elasticity: Source, by: str, stiffness: float
) -> tuple[str, ...]:
    """Notes on values outside the robot file and their sources."""
    out = []
    if friction == "assumed":
        out.append(
            f"The file gives no friction: {ASSUMED_FRICTION:g} is assumed, the order of a steel "
            "cable in a smooth hole, not measured. Set friction in the robot file to replace it."
        )
    elif friction == "calibrated":
        out.append(
            "Friction is that of the calibration to the measurements"
            + (
                ", not that of the file."
                if model.given_robot.has_friction
                else "; the file gives none."
            )
        )
    if elasticity == "assumed":
        out.append(
            f"The file gives the tendons no elasticity: {_elasticity(stiffness, 0.0)} is assumed "
            f"({by}), right within a factor of two, not measured. Between motor and base hole only "
            "the free length that the file gives stretches. Set axial_stiffness, free_length and "
            "compliance to replace it, or the tendon's diameter and material for a better "
            "estimate."
        )
    elif elasticity == "left_out":
        out.append(
            f"Tendon elasticity is left out, {by}. Set axial_stiffness or diameter in the "
            "robot file to include it."
        )
    return tuple(out)


def _path_notes(model: Model, steps: int, taut: bool) -> tuple[str, ...]:
    """Notes on the paths and their interpretation."""
    actuated = np.flatnonzero(model.shares) + 1
    wound = f"Tendon {actuated[0]} is shortened to its length"
    if len(actuated) > 1:
        wound = f"Tendons {listed([str(t) for t in actuated])} are shortened to their lengths"
    out = [
        "Actuation: the physics is that of the main sweep. 'Change' and 'tip moves' "
        "compare with the same commands on inextensible tendons without friction.",
        "Loading and unloading are one path, from home to the largest command and back in "
        f"{steps} steps each branch: friction depends on the history.",
        "Friction can also lower constant curvature's error: during loading it reduces the bend, "
        "and a law that bends the robot too little then has a smaller error.",
        "Displacements: the linear law makes an arc of each tension of the sweep, and the inverse "
        f"of Eq. 5 makes tendon lengths of the arc. {wound}, the others are lengthened to theirs "
        f"and {_SURPLUS * 100:g} % of the robot's length more, so that they stay slack; a "
        "tendon with a pretension in the file gets no surplus. Constant curvature's tip is that of "
        "the lengths without the surplus.",
    ]
    if model.arc_scale < 1.0:
        out.append(
            "In gravity the linear law bends far more than the robot: its arcs, of which the "
            f"displacements are made, are taken at {in_percent(model.arc_scale)} of the tensions, "
            "so that they end at about the robot's own bend."
        )
    if taut:
        out.append(
            "In spite of that, another tendon than the actuated one is taut at some commands."
        )
    return tuple(out)
