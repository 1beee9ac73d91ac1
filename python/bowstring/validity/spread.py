"""Validity limit of constant curvature for a robot whose numbers are known only roughly."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import numpy as np

from bowstring.aliases import Bools, Floats, Progress
from bowstring.display import short_repr
from bowstring.errors import InputError, NoSolutionError
from bowstring.formatting import in_newtons, in_percent, significant
from bowstring.results import Key, Result
from bowstring.robot.designs import Designs
from bowstring.robot.model import Robot, check_robot, with_tendons, without_laws
from bowstring.robot.parts import TendonRing
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel, as_model
from bowstring.uncertainty import (
    Distributions,
    SaltelliDesign,
    SobolIndices,
    Summary,
    evaluate,
    read_distributions,
    sobol_indices,
    spread_text,
    summarise,
)
from bowstring.validation import choice, instance, share_of_length
from bowstring.validity.axes import BY_DISPLACEMENT
from bowstring.validity.dead_loads import dead_loads
from bowstring.validity.design_space import RampErrors
from bowstring.validity.effects import Rods
from bowstring.validity.errors import LABELS, LAWS, Ramps, arc_tips, follow
from bowstring.validity.loading import Loading
from bowstring.validity.map_settings import end_of_ramp
from bowstring.viz.style import LIGHT, legend_above, subplots, title_above

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_POINTS: Final = 1024  # base points
_BLOCK: Final = 4096  # samples solved at a time
_MOST_ASSUMED: Final = 24  # numbers of one kind, as each takes its share of the samples
_WIDEST: Final = 5.0  # standard deviations that a sample stays within
_NAMED: Final = 0.025  # share of the samples without any valid load, from which on the text has it
_BINS: Final = 40  # of the histogram
_MARGIN: Final = 1.5  # end of the ramp over the nominal limit


@dataclass(frozen=True)
class Statistics(Result):
    """Statistics of an output over samples."""

    mean: Annotated[float, Key()]
    """Mean, which may be infinite."""
    sd: Annotated[float, Key()]
    """Standard deviation; NaN if a value is infinite."""
    quantiles: Annotated[dict[str, float], Key()]
    """Quantiles by probability, which may be infinite."""
    probability: Annotated[float | None, Key()]
    """Probability that the tolerance holds; None for the limit."""
    without_result: Annotated[float, Key("without_result_percent")]
    """Share of the samples without a result."""

    @classmethod
    def of(cls, found: Summary, scale: float) -> Statistics:
        """Scale a summary to the unit of the output."""
        return cls(
            float(found.mean.value) * scale,
            float(found.sd.value) * scale,
            {f"{p:g}": float(q.value) * scale for p, q in found.quantiles.items()},
            None if found.probability is None else float(found.probability.value),
            found.share_without_result,
        )


@dataclass(frozen=True)
class FactorIndices(Result):
    """Sobol' indices of one factor, with their intervals at 95 %."""

    factor: Annotated[str, Key()]
    """Uncertain number, or the parameters of a calibration."""
    first: Annotated[float, Key()]
    """First-order index: share of the variance alone; NaN for an output that does not vary."""
    first_interval: Annotated[tuple[float, float], Key()]
    """Interval of the first-order index; NaN as the index."""
    total: Annotated[float, Key()]
    """Total index: share with all interactions; NaN for an output that does not vary."""
    total_interval: Annotated[tuple[float, float], Key()]
    """Interval of the total index; NaN as the index."""

    @classmethod
    def of(cls, found: SobolIndices | None) -> list[FactorIndices]:
        """Indices by factor; empty without any."""
        if found is None:
            return []
        first, total = found.first, found.total
        return [
            cls(
                factor,
                float(first.value[i]),
                (float(first.low[i]), float(first.high[i])),
                float(total.value[i]),
                (float(total.low[i]), float(total.high[i])),
            )
            for i, factor in enumerate(found.factors)
        ]


@short_repr
@dataclass(frozen=True, eq=False)
class Spread(Result):
    """Validity limit and error of one model of constant curvature over samples of a robot.

    Constant curvature has the nominal numbers; the rod has those of the sample.
    """

    robot: Robot
    """Nominal robot."""
    distributions: Distributions
    """Distributions of its numbers."""
    name: Annotated[str, Key()]
    """Model of constant curvature, as ``--model`` takes it."""
    tolerance: Annotated[float, Key("tolerance_percent")]
    """Tolerated tip error as a share of the length."""
    max_tension: Annotated[float, Key("max_tension_N")]
    """End of the ramp, N."""
    nominal: Annotated[float, Key("nominal_limit_N")]
    """Validity limit of the nominal robot, N; infinite where it holds to the end of the ramp, NaN
    without a result."""
    nominal_solved: Annotated[bool, Key()]
    """Whether the nominal robot is solved to its limit or the end of the ramp; if not, its limit is
    the last load of its ramp that is solved."""
    limit: Floats
    """Validity limit of each sample (n,), N; infinite where it holds to the end of the ramp, the
    last solved load where the ramp is not solved to its end and holds so far, NaN without a
    result."""
    solved: Bools
    """Whether each sample is solved to its limit or the end of the ramp (n,)."""
    error: Floats
    """Tip error of each sample at the end of the ramp (n,), as a share of the length."""
    limit_summary: Summary
    """Statistics of the limit."""
    error_summary: Summary
    """Statistics of the error at the end of the ramp."""
    limit_indices: SobolIndices | None
    """Sobol' indices of the limit; None where too few samples have a finite one."""
    error_indices: SobolIndices
    """Sobol' indices of the error at the end of the ramp."""

    @property
    def limit_text(self) -> str:
        """The validity limit and its spread, such as "56 N (95 %: 49 to 63 N)"."""
        if self.mostly_exceeded:  # no factor explains a limit that hardly varies
            return f"0 N in {self._exceeded_text}"
        if math.isfinite(float(self.limit_summary.quantiles[0.5].value)):
            top = self.max_tension
            return spread_text(self.limit_summary, self.limit_indices, "N", end=top)
        share = 100.0 * float(np.isinf(self.limit).mean())
        return f"{significant(self.max_tension)} N in {share:.0f} % of the samples"

    @property
    def text(self) -> Annotated[tuple[str, ...], Key()]:
        """Results of the samples in sentences."""
        percent, top = in_percent(self.tolerance, 3), f"{significant(self.max_tension)} N"
        at_end = spread_text(self.error_summary, self.error_indices, "%", 0.01)
        middle = math.isfinite(float(self.limit_summary.quantiles[0.5].value))
        model = f"onstant curvature {LABELS[self.name]}"
        first = f"In the median of {len(self.limit)} samples c" if middle else "C"
        said = f"{first}{model} holds to {percent} of length up to {self.limit_text}."
        if self.mostly_exceeded:
            high = float(self.limit_summary.quantiles[0.975].value)
            most = f"{significant(high)} N" if math.isfinite(high) else f"more than {top}"
            said = (
                f"In {self._exceeded_text} c{model} exceeds {percent} of length already at 0 N; "
                f"the others hold up to at most {most} (97.5 % of all samples)."
            )
        elif self.share_exceeded > _NAMED:
            said += f" {self._exceeded_text} exceed the tolerance already at 0 N."
        if not self.solved.all():
            share = significant(100.0 * self.not_solved, 2)
            said += (
                f" {share} % of the samples are not solved to their limit or to the end of the "
                "sweep: their limit is the last solved load."
            )
        return (
            f"{said}{self._sampling_text} {self._nominal_text}",
            f"Its error at {top}, in percent of length, is {at_end}.",
        )

    @property
    def _sampling_text(self) -> str:
        """Sampling error of the stated median or share."""
        n, middle = len(self.limit), self.limit_summary.quantiles[0.5]
        if self.mostly_exceeded:
            return f" There are {n} samples."
        if not math.isfinite(float(middle.value)):
            from scipy.stats import binomtest

            held = binomtest(int(np.isinf(self.limit).sum()), n).proportion_ci(0.95, "wilson")
            low, high = (f"{100.0 * end:.0f}" for end in (held.low, held.high))
            share = f"{low} %" if low == high else f"{low} to {high} %"
            return f" With {n} samples that share is known to {share}."
        ends = float(middle.low), float(middle.high)
        if not math.isfinite(ends[1]):
            return f" The median lies above {significant(ends[0])} N."
        return f" The median is known to {in_newtons(*ends)}."

    @property
    def _nominal_text(self) -> str:
        """How far constant curvature holds for the nominal robot."""
        end = f"{significant(self.nominal)} N"
        if math.isnan(self.nominal):
            return (
                "The nominal robot has no limit: its sweep is not solved at the first load; give "
                "a smaller largest tension."
            )
        if not self.nominal_solved:
            return f"The nominal robot holds as far as it is solved, up to {end}."
        if math.isinf(self.nominal):
            end = f"{significant(self.max_tension)} N or more"
        return f"The nominal robot holds up to {end}."

    @property
    def share_exceeded(self) -> Annotated[float, Key("exceeded_at_first_load_percent")]:
        """Share of the samples whose error is above the tolerance already at the first load."""
        return float((self.limit == 0.0).mean())

    @property
    def mostly_exceeded(self) -> bool:
        """Whether half of the samples or more exceed the tolerance already at the first load."""
        return self.share_exceeded >= 0.5

    @property
    def _exceeded_text(self) -> str:
        return f"{100.0 * self.share_exceeded:.0f} % of the samples"

    @property
    def not_solved(self) -> Annotated[float, Key("not_solved_percent")]:
        """Share of the samples that are not solved to their limit or the end of the sweep; their
        limit is the last load that is solved."""
        return float((~self.solved).mean())

    @property
    def samples(self) -> Annotated[int, Key()]:
        """Number of samples of the statistics."""
        return len(self.limit)

    @property
    def of_limit(self) -> Annotated[Statistics, Key("limit")]:
        """Validity limit in N."""
        return Statistics.of(self.limit_summary, 1.0)

    @property
    def of_error(self) -> Annotated[Statistics, Key("error")]:
        """Tip error at the end of the sweep, percent of length."""
        return Statistics.of(self.error_summary, 100.0)

    @property
    def indices_of_limit(self) -> Annotated[list[FactorIndices], Key("limit_indices")]:
        """Sobol' indices of the limit; empty where few samples have a finite one."""
        return FactorIndices.of(self.limit_indices)

    @property
    def indices_of_error(self) -> Annotated[list[FactorIndices], Key("error_indices")]:
        """Sobol' indices of the error at the end of the sweep."""
        return FactorIndices.of(self.error_indices)

    def figure(self) -> Figure:
        """Draw the distribution of the limit, and the indices.

        Returns
        -------
        matplotlib.figure.Figure
            Histogram above, bars of the indices with their intervals below.
        """
        return _draw(self)


def validity_spread(
    robot: Robot,
    distributions: Distributions | SaltelliDesign | str | Path | Mapping[str, Any],
    *,
    name: str = "cc_from_force",
    tolerance: float | str = 0.01,
    loading: Loading | None = None,
    load: Load | None = None,
    model: RodModel | None = None,
    progress: Progress | None = None,
) -> Spread:
    """Validity limit of constant curvature where numbers of the robot are uncertain.

    Constant curvature has the numbers of the nominal robot, as its user would; the rod has those of
    each sample. Samples are Saltelli's design over a Sobol' sequence.

    Parameters
    ----------
    robot : Robot
        Nominal robot; its friction is left out unless it has a distribution.
    distributions : Distributions, SaltelliDesign, str, Path or mapping
        Distributions of numbers of the robot file, of ``tip_force`` and ``gravity``, as
        `bowstring.uncertainty.read_distributions` takes them, for a design of 1024 base points; or
        a `bowstring.uncertainty.SaltelliDesign` of another number.
    name : str
        Model of constant curvature, of `bowstring.validity.errors.LAWS`.
    tolerance : float or str
        Tolerated tip error: a share of the length, 0.01 or "1 %", or a length, "0.5 mm".
    loading : Loading, optional
        Actuated tendons, end of the ramp and number of its loads. By default the ramp ends at 1.5
        times the limit of the nominal robot.
    load : Load, optional
        Gravity (that of the robot if left out) and tip force of the nominal robot.
    model : RodModel, optional
        Rods of the samples, as for `bowstring.solve`.
    progress : callable, optional
        Called with a word and the finished share.

    Returns
    -------
    Spread
        Limits and errors of all samples, their statistics, and Sobol' indices.

    Raises
    ------
    InputError
        If a distribution or another argument is wrong.
    NoSolutionError
        If too few samples have a result.
    """
    check_robot(robot)
    tolerance = share_of_length("tolerance", tolerance, robot.length)
    design = design_of(robot, distributions, _POINTS)
    return sampled(
        robot,
        design,
        (name,),
        tolerance=tolerance,
        loading=loading,
        load=load,
        model=model,
        progress=progress,
    )(name)


def design_of(
    robot: Robot,
    distributions: Distributions | SaltelliDesign | str | Path | Mapping[str, Any],
    points: int,
) -> SaltelliDesign:
    """Design of distributions in any form, with `points` base points; a design as it is."""
    if isinstance(distributions, SaltelliDesign):
        return distributions
    if not isinstance(distributions, Distributions):
        distributions = read_distributions(distributions, robot)
    return SaltelliDesign(distributions, points)


def sampled(
    robot: Robot,
    design: SaltelliDesign,
    names: Sequence[str],
    *,
    tolerance: float,
    loading: Loading | None = None,
    load: Load | None = None,
    model: RodModel | None = None,
    progress: Progress | None = None,
) -> Callable[[str], Spread]:
    """Solve the samples of `validity_spread` once for several models of constant curvature.

    Parameters
    ----------
    design : SaltelliDesign
        Samples of the numbers.
    names : sequence of str
        Models. If the loading has no largest tension, the ramp ends at 1.5 times the largest of
        their limits.
    tolerance : float
        Tolerated tip error as a share of the length.
    robot, loading, load, model, progress
        As for `validity_spread`.

    Returns
    -------
    callable
        Function from the name of a model to its `Spread`; raises `NoSolutionError` if too few
        samples have a result.

    Raises
    ------
    InputError
        If a distribution or another argument is wrong.
    """
    for name in names:
        choice("name", name, list(LAWS))
    loading, load = instance("loading", loading, Loading), instance("load", load, Load)
    joint = design.distributions
    _check_paths(joint)
    robot = without_laws(robot, "friction")
    if not any(path.endswith(".friction") for path in joint.paths):
        robot = with_tendons(robot, {"friction": 0.0})
    shares = np.array(loading.shares(robot))
    nominal = Designs(robot, {"segments.0.length": [robot.segments[0].length]})
    top = end_of_ramp(robot, loading, load)

    def ramps(rods: Rods, end: float) -> Ramps:
        ramp = np.linspace(0.0, end, loading.points)
        return follow(rods, np.tile(ramp, (len(rods.designs), 1)), shares)

    theory = as_model(model)
    own = ramps(Rods(nominal, theory, load), top)
    of_nominal = {name: _limit(nominal, own, name, tolerance) for name in names}
    largest = max(float(limit[0]) for limit, _ in of_nominal.values())
    if loading.max_tension is None and math.isfinite(largest) and largest > 0.0:
        top = min(top, _MARGIN * largest)

    def results(samples: Floats) -> Floats:
        try:
            rods = _rods(robot, theory, load, joint.by_path(samples))
        except InputError as refusal:
            text = f"samples reach a robot that is refused: {refusal}"
            raise InputError(text, argument=refusal.argument) from refusal
        found = ramps(rods, top)
        columns = []
        for name in names:
            error = _known_errors(nominal, found, name)
            columns += [*_limit(nominal, found, name, tolerance), error[:, -1]]
        return np.stack(columns, axis=1)

    report = progress or (lambda what, done: None)
    outputs = evaluate(
        results, design, rows=_BLOCK, progress=lambda done: report("samples", 0.9 * done)
    )
    report("indices", 0.9)
    by_name = dict(zip(names, np.split(outputs, len(names), axis=1), strict=True))

    def spread(name: str) -> Spread:
        (limit,), (own_solved,) = of_nominal[name]
        found = by_name[name]
        try:
            of_limit = sobol_indices(design, found[:, 0])
        except NoSolutionError:  # it holds to the end of the ramp in most samples
            of_limit = None
        of_error = sobol_indices(design, found[:, 2])
        sample = found[design.rows_of_sample]
        report("done", 1.0)
        return Spread(
            robot,
            joint,
            name,
            tolerance,
            top,
            float(limit),
            bool(own_solved),
            sample[:, 0],
            sample[:, 1] > 0.0,
            sample[:, 2],
            summarise(sample[:, 0]),
            summarise(sample[:, 2], tolerance=tolerance),
            of_limit,
            of_error,
        )

    return spread


def assumed_distributions(robot: Robot) -> Distributions:
    """Assume how roughly a robot is known: E to 5 %, the pitch radius to 1 % (standard deviations).

    Each is one number of the robot; where its values differ, one of each segment, or one of each
    tendon. What the robot refuses, such as a hole beyond the rim of its disk, does not vary.

    Raises
    ------
    InputError
        If there is no E and no pitch radius that may vary.
    """
    found: dict[str, Any] = {}
    moduli = [
        f"segments.{k}.backbone.E" for k, s in enumerate(robot.segments) if s.backbone.E is not None
    ]
    rings, tendons = [], []
    for k, segment in enumerate(robot.segments):
        own = [f"{i}." for i in range(len(segment.tendon_list))]
        rings += [f"segments.{k}.tendons.pitch_radius"] * bool(own)
        places = [""] if isinstance(segment.tendons, TendonRing) else own
        tendons += [f"segments.{k}.tendons.{place}pitch_radius" for place in places]
    for sd, choices in (
        ("5 %", (["segments.*.backbone.E"], moduli)),
        ("1 %", (["segments.*.tendons.pitch_radius"], rings, tendons)),
    ):
        for paths in choices:
            if len(paths) > _MOST_ASSUMED:
                continue
            wider = {**found, **{path: {"normal": {"sd": sd}} for path in paths}}
            try:
                joint = read_distributions(wider, robot)
                ends = joint.mean + np.array([[-_WIDEST], [_WIDEST]]) * joint.sd
                Designs(robot, joint.by_path(ends))
            except InputError:
                continue
            found = wider
            break
    return read_distributions(found, robot)


def _check_paths(joint: Distributions) -> None:
    for path in joint.paths:
        head = path.partition(".")[0]
        if head in ("tensions", "displacements", "tip_moment"):
            raise InputError(
                f"{path} cannot vary here: it belongs to the sweep; give numbers of backbone, "
                "disks and tendons, tip_force or gravity"
            )
        if path.rpartition(".")[2] in BY_DISPLACEMENT:
            raise InputError(f"{path} cannot vary here: with given tensions it changes nothing")


def _rods(robot: Robot, model: RodModel, load: Load, values: Mapping[str, Floats]) -> Rods:
    """Rods of the samples: numbers of the robot, and components of its load."""
    count = len(next(iter(values.values())))
    of_load = {p: v for p, v in values.items() if p.startswith(("tip_force.", "gravity."))}
    of_robot = {p: v for p, v in values.items() if p not in of_load}
    if not of_robot:
        of_robot = {"segments.0.length": np.full(count, robot.segments[0].length)}
    varied = dead_loads(robot, load, of_load, count)
    return Rods(Designs(robot, of_robot), model, load.replace(**varied))


def _known_errors(nominal: Designs, ramps: Ramps, name: str) -> Floats:
    """Errors (D, L) of the nominal robot's arcs against the rods, m over the nominal length."""
    apart = np.linalg.norm(arc_tips(nominal, name, ramps) - ramps.tip, axis=-1)
    return np.asarray(apart / nominal.length[0])


def _limit(nominal: Designs, ramps: Ramps, name: str, tolerance: float) -> tuple[Floats, Bools]:
    """Validity limit of each rod (D,), N, and whether it is solved to it or the end of its ramp.

    The limit is infinite where it holds to the end of the ramp.
    """
    share = _known_errors(nominal, ramps, name)
    errors = RampErrors(
        ramps.ramp,
        np.ones(len(share)),
        ramps.converged,
        ramps.tip,
        ramps.tip_error,
        {name: share},
        np.zeros(len(share), bool),
        ramps.gave_up,
    )
    found = errors.valid_to(name, tolerance)
    with np.errstate(invalid="ignore"):
        holds = (share <= tolerance).all(axis=1)
    solved = errors.is_solved("valid_to", name, tolerance)
    return np.where(holds, np.inf, found), solved


def _draw(found: Spread) -> Figure:
    """Draw the distribution of the validity limit, and Sobol' indices."""
    figure, (above, below) = subplots(2, 5.2, height_ratios=(3, 2))
    finite = found.limit[np.isfinite(found.limit)]
    percent = in_percent(found.tolerance, 3)
    of_limit = found.limit_indices is not None and finite.size > 0.5 * len(found.limit)
    values = finite if of_limit else 100.0 * found.error[np.isfinite(found.error)]
    summary = found.limit_summary if of_limit else found.error_summary
    scale = 1.0 if of_limit else 100.0
    total = int(np.isfinite(found.error).sum()) if not of_limit else len(found.limit)
    edges = np.linspace(0.0, found.max_tension if of_limit else values.max(), _BINS + 1).tolist()
    each: Any = {"weights": np.full(len(values), 100.0 / total)}
    above.hist(values, bins=edges, color=LIGHT["blue"], alpha=0.6, **each)
    held = 100.0 * float(np.isinf(found.limit).mean())
    if of_limit and held:
        wide = 2.0 * found.max_tension / _BINS
        label = f"holds to the end: {held:.0f} %"
        above.bar(
            found.max_tension + wide, held, wide, color=LIGHT["green"], alpha=0.6, label=label
        )
    two_sided = np.isfinite([float(summary.quantiles[p].value) for p in (0.025, 0.975)]).all()
    for p, style, label in (
        (0.5, "-", "median"),
        (0.025, ":", "95 % of the samples" if two_sided else "97.5 % of the samples lie above"),
        (0.975, ":", "" if two_sided else "97.5 % of the samples lie below"),
    ):
        at = float(summary.quantiles[p].value) * scale
        if np.isfinite(at):
            above.axvline(at, color=LIGHT["ink"], ls=style, lw=1.2, label=label or None)
    own = found.nominal if of_limit else 100.0 * found.tolerance
    if np.isfinite(own):
        label = "nominal robot" if of_limit else f"tolerance {percent}"
        above.axvline(own, color=LIGHT["red"], ls="--", lw=1.4, label=label)
    end = f"{significant(found.max_tension)} N"
    above.set_xlabel(
        f"{percent} of length holds up to (N); sweep to {end}"
        if of_limit
        else f"tip error at {end} (% of length)"
    )
    above.set_ylabel("share of the samples (%)")
    above.set_xlim(left=0.0)
    legend_above(above, 2)
    indices = found.limit_indices if of_limit else found.error_indices
    assert indices is not None
    order = np.argsort(np.nan_to_num(indices.total.value))
    place = np.arange(len(order), dtype=float)
    for estimate, shift, colour, label in (
        (indices.first, 0.18, "blue", "alone (first order)"),
        (indices.total, -0.18, "amber", "with interactions (total)"),
    ):
        value = np.clip(np.asarray(estimate.value)[order], 0.0, None)
        spread = [
            np.clip(value - np.asarray(estimate.low)[order], 0.0, None),
            np.clip(np.asarray(estimate.high)[order] - value, 0.0, None),
        ]
        below.barh(place + shift, value, 0.34, color=LIGHT[colour], label=label)
        below.errorbar(value, place + shift, xerr=spread, fmt="none", ecolor=LIGHT["ink"], lw=1.0)
    below.set_yticks(place, [indices.factors[i] for i in order])
    below.set_xlabel("share of the variance (Sobol' index, 95 % interval)")
    below.set_xlim(left=0.0)
    legend_above(below, 2)
    title = f"{found.robot.name}: constant curvature {LABELS[found.name]} (simulated)"
    title_above(figure, title)
    return figure
