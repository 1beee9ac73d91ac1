"""Comparison of nested models on a table: which one to use, and where constant curvature errs.

K is the number of rows. All values are in SI.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Final, Literal, cast

import numpy as np

from bowstring import interrupts
from bowstring.aliases import Bools, Floats, Ints, Progress
from bowstring.calibration import observations
from bowstring.calibration.cross_validation import cross_validate
from bowstring.calibration.error_parts import ErrorParts, noise_of, parts_of
from bowstring.calibration.fitting import Estimate, Fit, fit_from
from bowstring.calibration.folds import part_of_rows
from bowstring.calibration.memories import (
    MEMORIES,
    Memory,
    is_zero,
    limit_of,
    parameters_of,
    reason_against,
    starts_of,
)
from bowstring.calibration.model_choice import (
    LIMIT_ERRORS,
    MEMORY_ERRORS,
    blocks_of,
    choose,
    gain,
)
from bowstring.calibration.observations import Score, score_of_errors
from bowstring.calibration.parameters import Unknowns, initial_of
from bowstring.calibration.pieces import Loss
from bowstring.calibration.priors import Prior, deviations_of, names_of, with_priors
from bowstring.calibration.residual import model_points, refuse_disorder
from bowstring.calibration.residual_comparison import of_arcs
from bowstring.calibration.tip_model import Commands
from bowstring.data.measurements import Measurements
from bowstring.display import short_repr
from bowstring.errors import BowstringError, InputError, NoSolutionError
from bowstring.formatting import listed
from bowstring.results import Key, Result
from bowstring.robot.model import Robot, check_robot
from bowstring.statics.model import RodModel
from bowstring.validation import check_is_read, shown

ModelName = Literal[
    "cc",
    "cc_calibrated",
    "rod",
    "rod_calibrated",
    "rod_backlash",
    "rod_friction",
    "rod_hysteresis",
    "rod_creep",
    "rod_relaxation",
]
RowsOfParts = Literal["folds", "validation"]
#: Names of models in words.
_CALLED: Final[dict[ModelName, str]] = {
    "cc": "constant curvature",
    "cc_calibrated": "constant curvature, calibrated",
    "rod": "rod",
    "rod_calibrated": "rod, calibrated",
    "rod_backlash": "rod with backlash",
    "rod_friction": "rod with tendon friction",
    "rod_hysteresis": "rod with backbone hysteresis",
    "rod_creep": "rod with creeping tendons",
    "rod_relaxation": "rod with backbone relaxation",
}
_OF_MEMORY: Final = {memory: cast("ModelName", f"rod_{memory}") for memory in MEMORIES}
#: Time of a model over that of the calibrated rod, about: with a memory derivatives are
#: differences, and hysteresis, creep and relaxation begin at three values.
_TIME: Final[dict[ModelName, float]] = {
    **dict.fromkeys(("cc", "cc_calibrated"), 0.2),
    **dict.fromkeys(("rod", "rod_calibrated", "rod_backlash"), 1.0),
    "rod_friction": 2.0,
    **dict.fromkeys(("rod_hysteresis", "rod_creep", "rod_relaxation"), 4.0),
}
#: Least number of rows in a fold.
_PER_FOLD: Final = 4
#: Least share by which a memory lowers the fitted error.
_LITTLE: Final = 0.01


@short_repr
@dataclass(frozen=True, eq=False)
class JudgedModel(Result):
    """One model of a comparison."""

    name: Annotated[ModelName, Key("model")]
    """``cc``, ``rod``: constant curvature and statics as the robot file has them; ``_calibrated``:
    with fitted parameters; the others: with a memory besides."""
    parameters: Annotated[tuple[str, ...], Key()]
    """Fitted parameters; empty for a model as the robot file has it, whose frames are stated."""
    fit: Fit | None = None
    """Fit to all rows; None without parameters and where it failed."""
    fitted: Annotated[Score | None, Key()] = None
    """Tip errors of the fitted rows; None if `reason` says why."""
    left_out: Annotated[Score | None, Key()] = None
    """Tip errors of the same rows, each predicted by a fit without its fold."""
    validation: Annotated[Score | None, Key()] = None
    """Tip errors of the validation table; None without one."""
    residuals: Floats | None = None
    """Predicted minus measured tip of the left-out rows (K, 3), m; NaN without a prediction."""
    validation_residuals: Floats | None = None
    """The same for the validation table."""
    reason: Annotated[str, Key()] = ""
    """Why there are no numbers; with numbers a note on them, or empty."""

    @property
    def estimates(self) -> Annotated[tuple[Estimate, ...], Key()]:
        """Estimates of the parameters; empty if nothing was fitted, or the fit failed."""
        return () if self.fit is None else self.fit.estimates

    @property
    def called(self) -> str:
        """Name in words."""
        return _CALLED[self.name]

    @property
    def errors(self) -> Floats:
        """Distances (K,) of the left-out rows, m; NaN where a row has none."""
        if self.residuals is None:
            raise InputError(f"{self.called} has no numbers: {self.reason}")
        return np.asarray(np.linalg.norm(self.residuals, axis=1))


@dataclass(frozen=True)
class HeldOutParts(ErrorParts):
    """Parts of the error of constant curvature, and the rows they are of."""

    on: Annotated[RowsOfParts, Key()]
    """Left-out rows of the folds, or validation table."""


@short_repr
@dataclass(frozen=True, eq=False)
class ModelComparison(Result):
    """Models judged on left-out rows; made by `compare_models`."""

    models: Annotated[tuple[JudgedModel, ...], Key()]
    """All models, in the order of complexity."""
    chosen: JudgedModel
    """The model to use."""
    memory: JudgedModel | None
    """The memory that is clearly better than the calibrated rod; None without one."""
    parts: ErrorParts
    """Parts of the error of constant curvature, on the validation table if there is one, else on
    the left-out rows."""
    folds: Annotated[int, Key()]
    """Number of folds."""
    on: RowsOfParts
    """Rows of `parts`."""

    def __getitem__(self, name: str) -> JudgedModel:
        for each in self.models:
            if each.name == name:
                return each
        known = listed([each.name for each in self.models])
        raise InputError(f"{shown(name)} was not compared; the models are {known}")

    @property
    def verdict(self) -> Annotated[str, Key()]:
        """Sentence on the largest part of the error of constant curvature, and what to do."""
        memory = "" if self.memory is None else self.memory.called.removeprefix("rod with ")
        return self.parts.verdict(memory)

    @property
    def parts_on(self) -> Annotated[HeldOutParts, Key("parts")]:
        """Parts of the error of constant curvature."""
        return HeldOutParts(**vars(self.parts), on=self.on)

    @property
    def chosen_name(self) -> Annotated[ModelName, Key("chosen")]:
        """Name of the model to use."""
        return self.chosen.name

    @property
    def memory_name(self) -> Annotated[ModelName | None, Key("memory")]:
        """Name of the memory that is clearly better than the calibrated rod; None without one."""
        return None if self.memory is None else self.memory.name


class ComparisonInterrupted(Result, KeyboardInterrupt):
    """Ctrl-C during a comparison."""

    models: Annotated[tuple[JudgedModel, ...], Key()]
    """Models that are finished, in the order of complexity."""
    unfinished: Annotated[tuple[ModelName, ...], Key()]
    """Names of the others."""
    folds: Annotated[int, Key()]
    """Number of folds."""

    def __init__(
        self, models: Sequence[JudgedModel], unfinished: Sequence[ModelName], folds: int
    ) -> None:
        total = len(models) + len(unfinished)
        super().__init__(f"{len(models)} of {total} models are compared")
        self.models, self.unfinished, self.folds = tuple(models), tuple(unfinished), folds


@dataclass(frozen=True)
class _Candidate:
    """A model to fit.

    Its parameters, kind, initial values to try, the parameters of an added memory, and values that
    are not fitted.
    """

    name: ModelName
    parameters: tuple[str, ...]
    arcs: bool = False
    starts: tuple[Mapping[str, float], ...] = ({},)
    added: tuple[str, ...] = ()
    fixed: Mapping[str, float] = field(default_factory=dict)


def compare_models(
    robot: Robot,
    data: Measurements,
    parameters: Sequence[str | Prior],
    *,
    folds: int = 5,
    validation: Measurements | None = None,
    loss: Loss = "soft_l1",
    memories: Sequence[Memory] = MEMORIES,
    progress: Progress | None = None,
) -> ModelComparison:
    """Compare constant curvature, the rod and its memories on left-out rows, and choose one.

    Parameters
    ----------
    robot : Robot
        As for `bowstring.fit`.
    data : Measurements
        Table of measurements, as `bowstring.read_measurements` gives it.
    parameters : sequence of str or Prior
        Parameters of the calibrated rod, as for `bowstring.fit`. Calibrated constant curvature has
        those that it knows, and one ``bend_gain`` for each segment. Models as the robot file has
        them fit only those of ``base`` and ``tool``. Those of an initial state are of models with a
        memory only.
    folds : int
        Number of folds of the cross-validation, by blocks of neighbouring groups, loads or rows
        (`bowstring.calibration.cross_validate`). Groups that are fewer than the folds, such as
        loading and unloading, may be split.
    validation : Measurements, optional
        Another table of the same bench, which every model predicts without registration to it.
    loss : {"linear", "soft_l1", "huber"}
        As for `bowstring.fit`.
    memories : sequence of {"backlash", "friction", "hysteresis", "creep", "relaxation"}
        Memories, each of which is added to the calibrated rod: ``backlash`` of displacements,
        friction of the tendons, hysteresis of the backbones; in rows with times creep of the
        tendons under displacement control, and relaxation of the backbones.
    progress : callable, optional
        Progress callback, called before each fit with the name of the model and the finished share
        from 0 to 1, about that of the time.

    Returns
    -------
    ModelComparison
        Models, choice, and parts of the error of constant curvature.

    Raises
    ------
    InputError
        If an argument is wrong, there are too few rows, rows are not in the order of their times,
        or validation rows are also fitted. Nothing is fitted then.
    NoSolutionError
        If a model without an added memory has no solution for most rows.
    ComparisonInterrupted
        After Ctrl-C, with the models that are finished.

    Notes
    -----
    The chosen model is the simplest one that is within one standard error of the one with the least
    mean left-out error (one-standard-error rule: Hastie, Tibshirani and Friedman, The Elements of
    Statistical Learning, 2nd ed. 2009, section 7.10). The standard error is here that of the paired
    comparison: of the mean logarithm of the ratio of both errors over blocks of neighbouring rows,
    four in each fold, because neighbours have similar errors. The order of complexity is that of
    `ModelComparison.models`.

    A memory takes part only if it is better than the calibrated rod by more than 2.5 standard
    errors: several memories are tried, and folds share most of their fitted rows, so that one
    standard error would choose a memory too often. A memory whose fit fails or finds no effect,
    less than 1 % of the fitted error, has a reason instead of numbers. So has hysteresis, creep or
    relaxation that is not also better, by one standard error, than its limit of no play or time: in
    this limit it is an elasticity that the calibrated rod may lack.

    The fits of the folds start from the values of the fit to all rows. That of hysteresis starts
    from three plays, those of creep and relaxation from three times, as their errors have several
    minima.
    """
    names = names_of(parameters)
    work = _Work.of(robot, data, names, folds, validation, progress, loss)
    candidates = _candidates(robot, names)
    by_tension = work.commands.are_tensions
    work.known = deviations_of(robot, parameters, by_tension=by_tension)
    for memory in [memories] if isinstance(memories, str) else memories:
        if memory not in MEMORIES:
            raise InputError(f"memory {shown(memory)} is unknown; memories are {listed(MEMORIES)}")
    asked = [memory for memory in MEMORIES if memory in memories]
    if asked:
        refuse_disorder(work.commands, "a memory needs")
        if validation is not None:
            others = observations.commands(validation, robot)
            refuse_disorder(others, f"in {validation.name} a memory needs")
    called = [*(each.name for each in candidates), *(_OF_MEMORY[each] for each in asked)]
    work.total = sum(_TIME[name] for name in called)
    models: list[JudgedModel] = []
    try:
        for each in candidates:
            models.append(work.judge(each))
        rod = models[-1]
        work.rod = rod.fitted
        for memory in asked:
            models.append(_with_memory(work, names, memory, rod))
        work.notify("done", 1.0)
        return _compared(work, models)
    except KeyboardInterrupt:
        interrupts.acknowledge()
        raise ComparisonInterrupted(models, called[len(models) :], work.folds) from None


def _compared(work: _Work, models: Sequence[JudgedModel]) -> ModelComparison:
    """Choose a model, and divide the error of constant curvature."""
    block = blocks_of(work.part, work.used)
    plain, rod = list(models[:4]), models[3]
    better = [
        each for each in models[4:] if each.residuals is not None and work.is_better(rod, each)
    ]
    memory = better[choose([each.errors for each in better], block)] if better else None
    rivals = plain if memory is None else [*plain, memory]
    chosen = rivals[choose([each.errors for each in rivals], block)]
    nested = [models[0], models[1], rod, memory]
    on: Literal["folds", "validation"] = "folds" if work.validation is None else "validation"
    table = work.data if work.validation is None else work.validation
    commands = observations.commands(table, work.robot)
    noise = noise_of(table, commands.values, table.tip)
    stated, arcs, whole, last = (None if each is None else _held_out(each, on) for each in nested)
    assert stated is not None and arcs is not None and whole is not None
    parts = parts_of(stated, arcs, whole, last, noise)
    return ModelComparison(tuple(models), chosen, memory, parts, work.folds, on)


def _held_out(model: JudgedModel, on: str) -> Floats:
    """Errors of the left-out rows, or of those of the validation table."""
    if on == "folds":
        return model.errors
    assert model.validation_residuals is not None
    return np.asarray(np.linalg.norm(model.validation_residuals, axis=1))


# -- models --------------------------------------------------------------------------------------


def _candidates(robot: Robot, parameters: Sequence[str]) -> list[_Candidate]:
    """Models without an added memory, in the order of complexity."""
    for name in parameters:
        if name.partition(".")[0] == "bend_gain":
            raise InputError(
                f"parameter {name} belongs to constant curvature; leave it out, calibrated "
                "constant curvature has it",
                argument="parameters",
            )
    whole = tuple(Unknowns(robot, parameters).names)
    if not (robot.has_memory or any(name.startswith("backlash") for name in whole)):
        whole = tuple(name for name in whole if initial_of(name) is None)
    frames = tuple(name for name in whole if name.partition(".")[0] in ("base", "tool"))
    arcs, _ = of_arcs(whole, {})
    return [
        _Candidate("cc", frames, arcs=True),
        _Candidate("cc_calibrated", tuple(names_of(arcs)), arcs=True),
        _Candidate("rod", frames),
        _Candidate("rod_calibrated", whole),
    ]


def _with_memory(
    work: _Work, parameters: Sequence[str], memory: Memory, rod: JudgedModel
) -> JudgedModel:
    """Add a memory to the calibrated rod; a reason in place of numbers where that fails."""
    name, added = _OF_MEMORY[memory], parameters_of(memory)
    given = Unknowns(work.robot, parameters)
    whole = (*given.names, *added)
    if reason := reason_against(memory, work.commands, given):
        work.total -= _TIME[name]
        return JudgedModel(name, whole, reason=reason)
    known_start = {} if rod.fit is None else _without_frames(rod.fit.values)
    starts = tuple({**known_start, **each} for each in starts_of(memory, work.robot, work.commands))
    candidate = _Candidate(name, whole, starts=starts, added=tuple(added))
    try:
        found = work.judge(candidate)
        if found.residuals is not None and work.is_better(rod, found):
            limit, what = limit_of(memory)
            if limit:
                at_once = _acting_at_once(work, candidate, found, limit)
                if not work.is_better(at_once, found, LIMIT_ERRORS):
                    reason = f"it does no better than {what} without memory, which may be missing"
                    return JudgedModel(name, whole, found.fit, reason=reason)
        return found
    except BowstringError as error:
        return JudgedModel(name, whole, reason=str(error).rstrip("."))


def _acting_at_once(
    work: _Work, candidate: _Candidate, found: JudgedModel, limit: Mapping[str, float]
) -> JudgedModel:
    """Judge a memory in the limit where it acts at once, as a missing elasticity does."""
    assert found.fit is not None
    left = tuple(name for name in candidate.parameters if name not in limit)
    start = {**_without_frames(found.fit.values), **limit}
    at_once = replace(candidate, parameters=left, starts=(start,), added=(), fixed=limit)
    work.total += _TIME[at_once.name]
    return work.judge(at_once)


def _without_frames(values: Mapping[str, float]) -> dict[str, float]:
    """Values except base and tool: a base without an initial value is registered anew."""
    return {k: v for k, v in values.items() if k.partition(".")[0] not in ("base", "tool")}


# -- judgement -----------------------------------------------------------------------------------


@dataclass
class _Work:
    """Rows of a comparison, and the progress of its fits."""

    robot: Robot
    data: Measurements
    commands: Commands
    used: Bools
    part: Ints
    folds: int
    validation: Measurements | None
    notify: Progress
    loss: Loss
    total: float = 1.0  # in times of the calibrated rod
    done: float = 0.0
    rod: Score | None = None  # of the calibrated rod at the fitted rows
    known: Mapping[str, float] = field(default_factory=dict)  # priors of the calibrated rod

    @classmethod
    def of(
        cls,
        robot: Robot,
        data: Measurements,
        parameters: Sequence[str],
        folds: int,
        validation: Measurements | None,
        progress: Progress | None,
        loss: Loss,
    ) -> _Work:
        """Check the rows before any work."""
        check_robot(robot)
        check_is_read(data)
        if not isinstance(data, Measurements):
            raise InputError(f"data is {shown(data)}, it must be Measurements, of a table")
        commands = observations.commands(data, robot)
        used = observations.fitted_rows(None, observations.tips(data, len(commands)))
        data = _foldable(data, used, folds)
        part, _ = part_of_rows(data, commands.values, used, folds)
        most = int(np.bincount(part[used]).max())
        count, free = int(used.sum()), len(Unknowns(robot, parameters).items) + 2
        least = max(_PER_FOLD * int(folds), free + most)
        if count < least:
            raise InputError(
                f"{count} rows with a measured tip are too few to compare models of up to {free} "
                f"parameters in {folds} folds; measure {least} at least, or take fewer folds or "
                "parameters",
                argument="folds",
            )
        if validation is not None:
            observations.commands(validation, robot)
            observations.check_validation(data, used, validation)
        notify = progress or (lambda what, share: None)
        return cls(robot, data, commands, used, part, int(folds), validation, notify, loss)

    def is_better(
        self, simple: JudgedModel, memory: JudgedModel, errors: float = MEMORY_ERRORS
    ) -> bool:
        """Whether a memory is better than a model without it by some standard errors."""
        found = gain(simple.errors, memory.errors, blocks_of(self.part, self.used))
        return found.exceeds(errors)

    def judge(self, model: _Candidate) -> JudgedModel:
        """Fit a model to all rows and without each fold, and predict the validation table."""
        self._step(model, 0.0)
        try:
            return self._fitted(model) if model.parameters else self._stated(model)
        finally:
            self.done += _TIME[model.name]

    def _fitted(self, model: _Candidate) -> JudgedModel:
        parameters = with_priors(Unknowns(self.robot, model.parameters).names, self.known)
        kind: Literal["arc"] | None = "arc" if model.arcs else None
        found = fit_from(
            model.starts, self.robot, self.data, parameters, model=kind, loss=self.loss
        )
        why = "" if found.converged else found.message.partition(". ")[0]
        if model.added and (why := why or self._no_effect(found, model)):
            return JudgedModel(model.name, model.parameters, found, reason=why)
        crossed = cross_validate(
            found,
            self.data,
            folds=self.folds,
            start={**_without_frames(found.values), **model.fixed},
            progress=lambda share: self._step(model, (1 + share * self.folds) / (1 + self.folds)),
        )
        notes = [why] if why else []
        if edge := [name for name in model.added if found[name].at_limit]:
            notes.append(f"{listed(edge)} at the end of the range, perhaps for another effect")
        if crossed.without_solution:
            lost = f"{crossed.without_solution} of {int(self.used.sum())} left-out rows"
            notes.append(f"{lost} have no solution")
        other = None
        if self.validation is not None:
            other = found.predict(self.validation) - self.validation.tip
        return JudgedModel(
            model.name,
            model.parameters,
            found,
            found.score,
            crossed.score,
            None if other is None else _score(other, model),
            crossed.residuals,
            other,
            "; ".join(notes),
        )

    def _no_effect(self, found: Fit, model: _Candidate) -> str:
        """Why an added memory has no effect; empty if it has one."""
        sizes = [name for name in model.added if not name.endswith(("_play", "_time"))]
        if all(is_zero(self.robot, name, found.values[name]) for name in sizes):
            return f"the fit finds none: {listed([str(found[name]) for name in sizes])}"
        if self.rod is not None and found.score.mean > (1.0 - _LITTLE) * self.rod.mean:
            return "it lowers the fitted error by less than 1 %"
        return ""

    def _step(self, model: _Candidate, share: float) -> None:
        self.notify(_CALLED[model.name], (self.done + share * _TIME[model.name]) / self.total)

    def _stated(self, model: _Candidate) -> JudgedModel:
        """Judge a model without parameters to fit: its frames are stated."""
        here = self._predicted(model, self.data) - self.data.tip
        here[~self.used] = np.nan
        there = None
        if self.validation is not None:
            there = self._predicted(model, self.validation) - self.validation.tip
        own = _score(here, model)
        validated = None if there is None else _score(there, model)
        return JudgedModel(model.name, (), None, own, own, validated, here, there)

    def _predicted(self, model: _Candidate, table: Measurements) -> Floats:
        said: dict[str, Any] = dict(zip(("tool.x", "tool.y", "tool.z"), table.tool, strict=True))
        commands = observations.commands(table, self.robot)
        return model_points(self.robot, said, commands, None if model.arcs else RodModel())


def _foldable(data: Measurements, used: Bools, folds: int) -> Measurements:
    """Measurements, without their groups if these are fewer than the folds.

    Folds are then blocks of neighbouring loads or rows.
    """
    groups = len(np.unique(observations.groups(data, len(data))[used]))
    return data if not groups < folds else replace(data, group=np.full(len(data), ""))


def _score(residuals: Floats, model: _Candidate) -> Score:
    if not np.isfinite(residuals).all(axis=1).any():
        raise NoSolutionError(f"{_CALLED[model.name]} has no solution for any row")
    return score_of_errors(residuals)
