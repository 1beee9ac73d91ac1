"""Command fit."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from bowstring.cli import completion
from bowstring.cli.flags import Number, Share, of_flag
from bowstring.cli.groups import Group, option
from bowstring.cli.options import (
    AsJson,
    MappingFile,
    OfMasses,
    RobotArgument,
    changes_of,
    measurements_of,
    out_folder,
)
from bowstring.cli.output import (
    Stopped,
    counted,
    fixed,
    new_table,
    progress_bar,
    provenance_of,
    say,
    warn,
    write_json,
    write_tables,
)
from bowstring.errors import InputError, NoSolutionError
from bowstring.formatting import in_mm, in_percent, listed, plain
from bowstring.units import rounded, si_of

if TYPE_CHECKING:
    from rich.table import Table

    from bowstring.aliases import Progress
    from bowstring.calibration.fitting import Estimate, Fit
    from bowstring.calibration.model_comparison import (
        ComparisonInterrupted,
        JudgedModel,
        ModelComparison,
    )
    from bowstring.calibration.priors import Prior
    from bowstring.calibration.residual_comparison import ResidualStudy
    from bowstring.calibration.table_fit import Calibration
    from bowstring.cli.schemas.basic import OfRobot
    from bowstring.data.measurements import Measurements
    from bowstring.robot.model import Robot

_FittedModel = Literal["rod", "arc"]
_Loss = Literal["linear", "soft_l1", "huber"]
#: Ratio of RMS to robust scatter of a coordinate above which both are printed.
_FAR_MORE: Final = 2.0
_LONG: Final = 10.0  # s of a comparison after which the rest is estimated
_EXACT: Final = 1e-8  # m: data without noise


def _priors(
    robot: Robot,
    parameter: list[str],
    prior: Annotated[
        list[str] | None,
        option(
            "NAME=SD",
            "Standard deviation of a fitted parameter about its nominal value, or none: "
            'gain="2 %", offset="0.5 mm". A name stands for its group. Repeatable.',
        ),
    ] = None,
    priors: Annotated[
        bool,
        typer.Option(
            "--priors", help="Default priors of gains, offsets, backlash, delay and holes."
        ),
    ] = False,
) -> Callable[[bool], tuple[Sequence[str | Prior], dict[str, float] | None]]:
    """Function that gives parameters with priors, and priors by name (None without a flag).

    Its argument is whether all commands are tensions, which tells the unit of an offset.
    """
    texts = changes_of("--prior", prior, 'gain="2 %"')

    def known(by_tension: bool) -> tuple[Sequence[str | Prior], dict[str, float] | None]:
        from bowstring.calibration.parameters import Unknowns
        from bowstring.calibration.priors import default_priors, matching, with_priors

        if not (texts or priors):
            return parameter, None
        example = 'offset="0.5 mm"'
        unknowns = Unknowns(robot, parameter, by_tension=by_tension)
        found = default_priors(robot, parameter, by_tension=by_tension) if priors else {}
        for name, text in texts.items():
            items = of_flag("--prior", partial(matching, unknowns), name)
            if text.strip() == "none":
                value = math.inf
            elif si := si_of(items[0].unit):
                value = Number(si, example, "", must_be="positive").number("--prior", text)
            else:
                kind = Share("a positive number", lambda share: share > 0, example, "")
                value = kind.read("--prior", text, robot)
            found |= {item.name: value for item in items}
        found = {name: value for name, value in found.items() if math.isfinite(value)}
        return with_priors(unknowns.names, found), found

    return known


_Priors = Annotated[Callable[[bool], Any], Group("Priors", _priors)]


class _Tables:
    """Tables of measurements: files of one's own, or those of a public data set."""

    def __init__(
        self,
        robot: Robot,
        parameter: list[str],
        measurements: Annotated[
            Path | None, option("FILE", "Table of measurements: CSV, TSV, .xlsx, .mat or .mcap.")
        ] = None,
        mapping: MappingFile = None,
        data: Annotated[
            str | None,
            option("NAME", "A public data set instead of a table.", values=completion.data_sets),
        ] = None,
        part: Annotated[
            str | None,
            option("PART", "Which of its tables, if it has several.", values=completion.parts),
        ] = None,
        *,
        g: OfMasses,
    ) -> None:
        from bowstring.data import datasets

        if (measurements is None) == (data is None):
            raise InputError(
                "give either --measurements FILE or --data NAME, a public data set (bowstring data "
                "list)."
            )
        if data is None and part is not None:
            raise InputError("--part selects a table of a public data set; name that by --data.")
        if data is not None and mapping is not None:
            raise InputError("--mapping is for tables of your own; a set of --data has its own.")
        if data is not None and data not in datasets.available() and Path(data).is_file():
            raise InputError(
                f"--data: {data} is a file, not a public data set; give --measurements."
            )
        self._robot, self._parameter, self._g = robot, parameter, g
        self._file, self._mapping, self._data, self._part = measurements, mapping, data, part
        #: Provenance: entries of the result on the tables.
        self.origin: dict[str, Any] = {
            "measurements": measurements,
            "mapping": mapping if data is None else data,
            "data": data,
            "part": part,
            "g_m_per_s2": g,
        }

    def fitted(self) -> Measurements:
        """Read the table that the model is fitted to."""
        of_set = "--data" if self._part is None else "--part"
        flag = "--measurements" if self._data is None else of_set
        return self.read(flag, self._file, self._part)

    def read(self, flag: str, file: str | Path | None, part: str | None) -> Measurements:
        """Read the file, or this part of the data set."""
        from bowstring.calibration.parameters import zero_is_fitted
        from bowstring.data import datasets
        from bowstring.data.measurements import read_measurements

        settings: dict[str, Any] = {
            "g": self._g,
            "keep_below_zero": zero_is_fitted(self._parameter),
        }
        data = self._data
        if data is None:
            return measurements_of(flag, file, self._robot, self._mapping, **settings)
        of_flag("--data", datasets.describe, data)
        place = of_flag(flag, lambda name: datasets.table(data, name), part)
        found = read_measurements(place, self._robot, data, **settings)
        return replace(found, name=data if part is None else f"{data}, {part}")


@dataclass(frozen=True)
class _Judged:
    """Rows on which the fit is judged, and what is judged beside it."""

    holdout: Annotated[
        float | None,
        Share(
            "a share of the rows above 0 and below 1",
            lambda value: 0 < value < 1,
            '"20 %"',
            "Leave this share of the rows, the last, out of the fit and predict it.",
            form="SHARE",
        ),
    ]
    folds: Annotated[
        int | None,
        option("K", "Cross-validation: predict each of K parts from a fit to the others."),
    ] = None
    validate: Annotated[
        str | None,
        option(
            "FILE",
            "Table (with --data a part of the data set) that the fit predicts; nothing is aligned "
            "to it.",
        ),
    ] = None
    filter_: Annotated[
        bool,
        typer.Option(
            "--filter",
            help="With --validate, also predict each row from the measured tips before it.",
        ),
    ] = False
    residual: Annotated[
        bool,
        typer.Option(
            "--residual",
            help="Learn what the calibrated model leaves, and compare with constant curvature and "
            "with the commands alone; needs --validate or --holdout.",
        ),
    ] = False
    compare: Annotated[
        bool,
        typer.Option(
            "--compare",
            help="Compare constant curvature, the rod and its memories on left-out rows (5 folds, "
            "or --folds; with --validate on that table too), and name the cause of the error.",
        ),
    ] = False

    def __post_init__(self) -> None:
        ways = (self.holdout, self.folds, self.validate)
        if not self.compare and sum(way is not None for way in ways) > 1:
            raise InputError("--holdout, --folds and --validate are ways to validate; give one.")
        if self.filter_ and self.validate is None:
            raise InputError("--filter needs a table to predict; name it by --validate.")
        if self.residual and self.holdout is None and self.validate is None:
            raise InputError(
                "--residual is judged on rows that are not fitted; give --validate FILE or "
                "--holdout SHARE."
            )
        if self.folds is not None and self.folds < 2:
            raise InputError(f"--folds: got {self.folds}; must be 2 or more.")

    def origin(self) -> dict[str, Any]:
        """Provenance: entries of the result on the validation."""
        return {
            "holdout": self.holdout,
            "folds": self.folds,
            "validate": self.validate,
            "filter": self.filter_,
            "learn_residual": self.residual,
            "compare": self.compare,
        }


class _Folder:
    """Folder of the results, which a result in doubt is not written to without --force."""

    def __init__(
        self,
        out: Annotated[
            Path | None, option("DIR", "Folder for the calibrated robot file and figures.")
        ] = None,
        force: Annotated[
            bool,
            typer.Option(
                "--force",
                help="With --out, write the calibrated robot although the result itself is in "
                "doubt. Files of others are not overwritten.",
            ),
        ] = False,
    ) -> None:
        out_folder(out, "fit")
        self.out, self._force = out, force

    def refuses(self, found: Calibration) -> bool:
        """Whether the result is in doubt, and not wanted nevertheless."""
        return self.out is not None and bool(found.doubts) and not self._force


def fit(
    robot: RobotArgument,
    parameter: Annotated[
        list[str],
        option(
            "NAME",
            "Parameter to fit: a number of the robot file (E for all backbones, "
            "segments.0.backbone.E, payloads.0.mass), base, tool, marker.0, gain, offset, "
            "backlash, hole_clearance, mount_compliance, delay, hole_angle, pitch_radius, "
            "bend_gain, initial_displacement, initial_tension. Repeatable.",
            values=completion.words(
                *("base", "tool", "marker.0", "gain", "offset", "backlash", "hole_clearance"),
                *("mount_compliance", "delay", "hole_angle", "pitch_radius", "bend_gain"),
                *("E", "segments.0.backbone.E", "initial_displacement", "initial_tension"),
            ),
        ),
    ],
    tables: Annotated[_Tables, Group("Measurements", _Tables)],
    priors: _Priors,
    judged: Annotated[_Judged, Group("Validation", _Judged)],
    folder: Annotated[_Folder, Group("Outputs", _Folder)],
    model: Annotated[
        _FittedModel,
        typer.Option(help="Model to fit: rod statics, or arcs of constant curvature."),
    ] = "rod",
    loss: Annotated[
        _Loss, typer.Option(help="Least squares (linear), or robust against outliers.")
    ] = "soft_l1",
    start: Annotated[
        Path | None,
        option(
            "FILE",
            "calibration.json of an earlier fit: base, tool and actuation start from its values, "
            "or keep them if they are not fitted.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Calibrate a robot: fit parameters to measured tips and points along the body."""
    import numpy as np

    from bowstring.calibration import table_fit

    if model == "rod" and any(name.startswith("bend_gain") for name in parameter):
        raise InputError("--parameter bend_gain belongs to constant curvature; give --model arc.")
    if judged.compare:
        _check_comparison(model, judged.holdout, start)
    begin = None if start is None else of_flag("--start", table_fit.read_start, start)
    with progress_bar("measurements"):
        table, named = tables.fitted(), judged.validate
        other = None if named is None else tables.read("--validate", named, named)
    parameters, deviations = priors(bool(np.isnan(table.displacements).all()))
    origin = provenance_of(
        robot,
        **tables.origin,
        parameters=parameter,
        model=model,
        loss=loss,
        priors=deviations,
        **judged.origin(),
        start=begin,
    )
    if not table.points.shape[1]:
        _check_angles(judged, folder, deviations)
        return _fit_orientation(robot, table, parameter, model, loss, begin, origin, as_json)
    compared = None
    try:
        if judged.compare:
            from bowstring.calibration.model_comparison import compare_models

            with progress_bar("comparison") as notify:
                compared = compare_models(
                    robot,
                    table,
                    parameters,
                    folds=judged.folds or 5,
                    validation=other,
                    loss=loss,
                    progress=_with_estimate(notify),
                )
        with progress_bar("fit") as notify:
            folds = None if judged.compare else judged.folds
            found = table_fit.calibrate(
                robot,
                table,
                parameters,
                model="arc" if model == "arc" else None,
                loss=loss,
                start=begin,
                validation=table_fit.Validation(judged.holdout, folds, other, judged.filter_),
                progress=notify,
            )
    except KeyboardInterrupt as error:
        stopped = _stopped(error, compared)
        if stopped is None:
            raise
        warned = [*robot.warnings, *filter(None, [table.doubt])]
        raise Stopped(_write_stopped(stopped, origin, warned, folder.out, as_json)) from None
    learnt = None
    if judged.residual and found.fit.converged:
        from bowstring.calibration.residual_comparison import study_residual

        with progress_bar("residual") as notify:
            learnt = study_residual(found, robot, progress=notify)
    _report(robot, found, origin, learnt, compared, folder, as_json)


def _report(
    robot: Robot,
    found: Calibration,
    origin: OfRobot,
    learnt: ResidualStudy | None,
    compared: ModelComparison | None,
    folder: _Folder,
    as_json: bool,
) -> None:
    """Write and print a fit; raise `NoSolutionError` if it is not a result, or in doubt."""
    tendons = found.tendons.sentence if found.tendons.alarm else found.tendons.remark
    doubts = list(filter(None, [tendons, found.broken_path]))
    of_table = [*filter(None, [found.data.doubt]), *found.fit.doubts]
    warn(*(of_table if as_json else ()), *doubts)  # else they are the first lines
    content: dict[str, Any] = {
        **found.to_dict(),
        **origin,
        "residual": None if learnt is None else learnt.to_dict(),
        "comparison": None if compared is None else compared.to_dict(),
        "warnings": [*robot.warnings, *of_table, *doubts],
    }
    written = None
    refused = folder.refuses(found)
    if folder.out is not None and found.fit.converged and not refused:
        with progress_bar("figures") as notify:
            from bowstring.calibration.fit_folder import write_fit

            written = write_fit(
                found,
                plain(content),
                folder.out,
                residual=None if learnt is None else learnt.residual,
                comparison=compared,
                progress=notify,
            )
    if as_json:
        write_json({**content, "folder": written})
    else:
        place = folder.out if written else None
        parts = [] if learnt is None else _residual_tables(learnt, place)
        models = [] if compared is None else _comparison_tables(compared, place)
        write_tables(*_fit_tables(found, place), *parts, *models)
    if not found.fit.converged:
        raise NoSolutionError(f"{robot.name}: {found.fit.whole_message}")
    if refused:
        raise NoSolutionError(
            f"{robot.name}: nothing is written, because the result is in doubt; --force writes it "
            f"nevertheless. {found.doubts[0]}"
        )


def _with_estimate(notify: Progress) -> Progress:
    """Progress callback that prints once how long a comparison of minutes will take."""
    began, said = time.monotonic(), False

    def update(what: str, done: float) -> None:
        nonlocal said
        now = time.monotonic() - began
        if not said and done > 0.0 and now > _LONG:
            said = True
            left = max(1, round(now * (1.0 / done - 1.0) / 60.0))
            say(
                "Note",
                f"the comparison takes about {counted(left, 'minute')} more; Ctrl-C keeps the "
                "models that are finished.",
            )
        notify(what, done)

    return update


def _stopped(
    error: KeyboardInterrupt, compared: ModelComparison | None
) -> ComparisonInterrupted | None:
    """The interrupt that has the models finished before Ctrl-C; None without any."""
    from bowstring import interrupts
    from bowstring.calibration.model_comparison import ComparisonInterrupted

    if compared is not None:
        interrupts.acknowledge()
        return ComparisonInterrupted(compared.models, (), compared.folds)
    return error if isinstance(error, ComparisonInterrupted) and error.models else None


def _write_stopped(
    stopped: ComparisonInterrupted,
    origin: OfRobot,
    warnings: list[str],
    out: Path | None,
    as_json: bool,
) -> str:
    """Write the finished models of a stopped comparison, and return what remains as a sentence."""
    count = len(stopped.models)
    total = counted(count + len(stopped.unfinished), "model")
    done = f"{count} of {total} {'is' if count == 1 else 'are'} finished"
    where, folder = "", None
    content: dict[str, Any] = {**origin, **stopped.to_dict(), "warnings": warnings}
    if out is not None:
        from bowstring.calibration.fit_folder import write_stopped

        try:
            folder = write_stopped(stopped, plain(content), out)
            where = f"; {out} has {'it' if count == 1 else 'these'}, without a fit"
        except InputError as error:
            where = f"; they are not written: {str(error).rstrip('.')}"
    if as_json:
        write_json({**content, "folder": folder})
    else:
        validated = any(each.validation is not None for each in stopped.models)
        write_tables(
            f"Incomplete: {done}. RMSE and mean of the tip error in mm; left out by "
            f"{stopped.folds} folds:",
            _model_table(stopped.models, None, validated),
        )
    return f"{done}{where}."


def _check_comparison(model: str, holdout: float | None, start: Path | None) -> None:
    """Refuse flags that a comparison of models cannot use."""
    if model == "arc":
        raise InputError("--compare has constant curvature and the rod; leave --model out.")
    if holdout is not None:
        raise InputError("--compare leaves rows out by folds; give --folds in place of --holdout.")
    if start is not None:
        raise InputError("--compare begins at the values of ROBOT; leave --start out.")


def _check_angles(judged: _Judged, folder: _Folder, priors: dict[str, float] | None) -> None:
    """Refuse flags that a table of angles alone cannot serve."""
    refused = {
        "--holdout": judged.holdout,
        "--folds": judged.folds,
        "--validate": judged.validate,
        "--residual": judged.residual,
        "--compare": judged.compare,
        "--out": folder.out,
        "--prior and --priors": priors,
    }
    for flag in (flag for flag, value in refused.items() if value):
        raise InputError(f"{flag} needs measured tips, and the table has angles only.")


def _fit_orientation(
    robot: Robot,
    table: Measurements,
    parameter: list[str],
    model: _FittedModel,
    loss: _Loss,
    begin: dict[str, float] | None,
    origin: OfRobot,
    as_json: bool,
) -> None:
    """Fit a model to a table of angles, and write the result."""
    from bowstring.calibration.orientation_fit import fit_orientation
    from bowstring.calibration.parameters import zero_is_fitted
    from bowstring.data.tendon_check import check_tendons

    order = check_tendons(
        robot,
        table,
        zero_is_fitted=zero_is_fitted(parameter),
        delay_is_fitted="delay" in parameter,
    )
    kind: Literal["arc"] | None = "arc" if model == "arc" else None
    found = fit_orientation(robot, table, parameter, model=kind, start=begin, loss=loss)
    doubts = [table.doubt, order.sentence if order.alarm else order.remark]
    doubts = [sentence for sentence in doubts if sentence]
    warn(*doubts)
    if as_json:
        write_json({**found.to_dict(), **origin, "warnings": [*robot.warnings, *doubts]})
    else:
        what = "statics" if model == "rod" else "constant curvature"
        left = f", {table.left_out} left out" if table.left_out else ""
        lost = len(table) - found.rows
        left += f", {lost} without an equilibrium" if lost else ""
        scores = new_table("angle error", ">RMSE deg", ">mean deg", ">largest deg")
        for name, score in (("before", found.score_before), ("after", found.score)):
            sizes = (score.rmse, score.mean, score.largest)
            scores.add_row(name, *[fixed(math.degrees(size), 3) for size in sizes])
        write_tables(
            f"{robot.name}, {what}, fitted to the angles of {table.name} "
            f"({table.source}): {counted(found.rows, 'row')}{left}",
            _estimate_table(found.estimates),
            scores,
        )
    if not found.converged:
        raise NoSolutionError(
            f"{robot.name}: not converged; begin from better values, or with fewer parameters"
        )


def _fit_tables(found: Calibration, folder: Path | None) -> Iterator[Table | str]:
    import numpy as np

    from bowstring.calibration import table_fit

    fit, data = found.fit, found.data
    if data.doubt:
        yield f"Check the table. {data.doubt}"
    if fit.doubts:
        yield " ".join(["Check the result.", *fit.doubts])
    left = f", {data.without_tip} without a tip" if data.without_tip else ""
    left += f", {data.left_out} left out" if data.left_out else ""
    kept = f", {counted(int(found.held_out.sum()), 'row')} held out" if found.held_out.any() else ""
    what = "statics" if fit.model == "rod" else "constant curvature"
    several = f", {len(fit.points)} points a row" if len(fit.points) > 1 else ""
    yield (
        f"{fit.robot.name}, {what}, fitted to {data.name} ({data.source}): "
        f"{counted(int(fit.used.sum()), 'row')}{several}{kept}{left}"
    )
    yield _estimate_table(fit.estimates)
    yield fit.message
    if found.correlated:
        pairs = [f"{each.pair} by {each.correlation:.3f}" for each in found.correlated]
        yield "Estimates correlate: " + "; ".join(pairs) + "."
    scores = new_table("tip error", ">rows", ">RMSE mm", ">mean mm", ">largest mm")
    placed = {"base.x", "base.y", "base.z", "base.rx", "base.ry", "base.rz"} <= set(fit.names)
    before = "before, base put in place" if placed else "before"
    rows = [(before, fit.score_before), ("after", fit.score)]
    if found.held_out_score is not None:
        rows.append(("rows held out", found.held_out_score))
    if found.other is not None and found.other_score is not None:
        of = f"{found.other.name} ({found.other.source})"
        rows.append((of, found.other_score))
        if found.ahead is not None:
            rows.append(("  each from the rows before", found.ahead.score))
    if found.folds is not None:
        rows.append((f"{len(found.folds.folds)} folds", found.folds.score))
        rows += [(f"  {n}", s) for n, s in zip(found.folds.labels, found.folds.folds, strict=True)]
    for name, score in rows:
        cells = [fixed(1e3 * v, 3) for v in (score.rmse, score.mean, score.largest)]
        scores.add_row(name, str(score.count), *cells)
    yield scores
    if len(fit.points) > 1:
        yield _point_table(fit)
    if found.other is not None and found.other_score is not None:
        own = found.other_score
        yield (
            f"{found.other.name} was not fitted, and nothing was aligned to it. Without the mean "
            f"offset its RMSE is {fixed(1e3 * own.rmse_centred, 3)} mm, its mean "
            f"{fixed(1e3 * own.mean_centred, 3)} mm."
        )
    if found.other is not None and found.other_predicted is not None:
        inside = found.other_predicted.coverage(found.other.tip)
        yield (
            f"{in_percent(inside)} of its coordinates lie in their 95 % intervals, "
            f"{in_mm(found.other_predicted.half_width)} to either side: parameters and scatter of "
            "the fitted rows."
        )
    if found.bias is not None:
        unit = "s" if found.bias.timed else "rows"
        yield (
            "Each from the rows before: filtered with the measured tips of the rows before it, by "
            f"a slow bias of {in_mm(found.bias.spread)} that lasts "
            f"{rounded(found.bias.duration, 2)} {unit}. The other scores are open loop."
        )
    if found.without_solution:
        has, is_ = ("has", "is") if found.without_solution == 1 else ("have", "are")
        yield (
            f"{counted(found.without_solution, 'validation row')} {has} no solution and "
            f"{is_} left out of the scores."
        )
    said = ""
    if data.sigma is not None:
        said = f"; the table says {rounded(1e3 * float(np.median(data.sigma)), 3)} mm"
    yield f"Scatter of a coordinate: {fixed(1e3 * fit.noise, 4)} mm{said}.{_outlier_note(fit)}"
    if found.outliers:
        named = [f"line {row.line} ({in_mm(row.distance)})" for row in found.outliers[:5]]
        more = f" and {len(found.outliers) - 5} more" if len(found.outliers) > 5 else ""
        yield f"Far off, look at: {', '.join(named)}{more}."
    if folder is not None:
        yield f"Calibrated robot: {folder / 'robot.yaml'}"
        if found.beside:
            yield f"Base, tool and actuation, for --start: {folder / table_fit.BESIDE}"


def _estimate_table(estimates: Sequence[Estimate]) -> Table:
    some = [">prior"] if any(e.prior_sd for e in estimates) else []
    table = new_table(
        "parameter", ">value", ">std. error", ">95 % from", ">to", ">began at", *some, "unit"
    )
    for e in estimates:
        prior = "" if e.prior_sd is None else f"{e.prior_mean:.6g} ± {rounded(e.prior_sd, 2)}"
        digits = _digits(e.standard_error, e.value)
        told = math.isfinite(e.standard_error)
        table.add_row(
            e.name,
            fixed(e.value, digits),
            rounded(e.standard_error, 2) if told else "unknown",
            *[fixed(end, digits) if math.isfinite(end) else "-" for end in (e.low, e.high)],
            f"{e.start:.6g}",
            *([prior] if some else []),
            e.unit,
        )
    return table


def _point_table(fit: Fit) -> Table:
    """Errors of each measured point after the fit, and its RMSE before."""
    table = new_table(
        "point", ">disk", ">rows", ">RMSE mm", ">mean mm", ">largest mm", ">RMSE mm before"
    )
    last = len(fit.points)
    rows = [
        ("tip" if k == last else str(k), str(each.disk), each.score, each.before)
        for k, each in enumerate(fit.points, start=1)
    ]
    rows.append(("all", "", fit.score_of_points, fit.score_of_points_before))
    for name, disk, score, before in rows:
        sizes = (score.rmse, score.mean, score.largest, before.rmse)
        cells = [fixed(1e3 * size, 3) for size in sizes]
        table.add_row(name, disk, str(score.count), *cells)
    return table


def _residual_tables(found: ResidualStudy, folder: Path | None) -> Iterator[Table | str]:
    from bowstring.calibration.residual_file import RESIDUAL

    scales = found.residual.length_scales.to_dict()
    used = [name for name, length in scales.items() if length is not None]
    inputs = {"commands": "commands", "point": "predicted point"}
    radius = 1e3 * (found.residual.memory_radius or 0.0)
    words = [inputs.get(name, f"memory state of radius {rounded(radius, 3)} mm") for name in used]
    model, corrected = found.residual.validated
    yield (
        f"Residual: a Gaussian process on {listed(words)}. At the fitted rows, left out by blocks, "
        f"RMSE {fixed(1e3 * corrected.rmse, 3)} mm; the calibrated model has "
        f"{fixed(1e3 * model.rmse, 3)} mm there."
    )
    called = {"rod": "statics", "arc": "constant curvature", "commands": "commands alone"}
    table = new_table("validation rows", ">fitted rows", ">RMSE mm", ">with residual", ">mean mm")
    for each in found.compared:
        table.add_row(
            called[each.model],
            str(each.rows),
            "-" if each.alone is None else fixed(1e3 * each.alone.rmse, 3),
            fixed(1e3 * each.corrected.rmse, 3),
            fixed(1e3 * each.corrected.mean, 3),
        )
    yield table
    yield (
        f"{counted(found.rows_beyond_data, 'validation row')} beyond the data, where the "
        "correction fades; the explained share of the variance is "
        f"{fixed(found.median_share_kept, 2)} in the median."
    )
    if folder is not None:
        yield f"Residual: {folder / RESIDUAL}"


def _comparison_tables(found: ModelComparison, folder: Path | None) -> Iterator[Table | str]:
    yield (
        "Models, number of parameters, and RMSE and mean of the tip error in mm; left out by "
        f"{found.folds} folds:"
    )
    there = any(each.validation is not None for each in found.models)
    yield _model_table(found.models, found.chosen, there)
    yield from (
        f"{m.called[:1].upper()}{m.called[1:]}: {m.reason}." for m in found.models if m.reason
    )
    chosen = set(found.chosen.parameters) - set(found["rod_calibrated"].parameters)
    more = [f"--parameter {name}" for name in found.chosen.parameters if name in chosen]
    fitted = f" Fit it with {' '.join(more)} besides." if found.chosen is found.memory else ""
    yield (
        f"* {found.chosen.called}: the simplest model within one standard error of the least mean "
        f"left-out error.{fitted}"
    )
    parts = found.parts
    of = "left-out rows" if found.on == "folds" else "rows of the validation table"
    cells = new_table(f"mean error of {parts.rows} {of}", ">mm")
    cells.add_row("constant curvature", fixed(1e3 * parts.total, 3))
    for name, value in parts.known.items():
        cells.add_row(f"  {parts.called(name)}", fixed(1e3 * value, 3))
    yield cells
    yield found.verdict
    if folder is not None:
        yield f"Models and parts: {folder / 'models.csv'}, {folder / 'error_parts.svg'}"


def _model_table(
    models: Sequence[JudgedModel], chosen: JudgedModel | None, validated: bool
) -> Table:
    """Errors of models, with a mark at the chosen one."""
    columns = ["fitted", "left out", "mean"] + ["validation", "mean"] * validated
    table = new_table("", "model", ">number", *[f">{name}" for name in columns])
    for each in models:
        numbers = [(each.fitted, "rmse"), (each.left_out, "rmse"), (each.left_out, "mean")]
        numbers += [(each.validation, "rmse"), (each.validation, "mean")] * validated
        table.add_row(
            "*" if each is chosen else "",
            each.called,
            str(len(each.parameters)),
            *["-" if of is None else fixed(1e3 * getattr(of, name), 3) for of, name in numbers],
        )
    return table


def _outlier_note(fit: Fit) -> str:
    """Note on outliers, which the robust scatter does not show; empty without any."""
    whole = fit.score.rmse / math.sqrt(3.0)
    if whole < _FAR_MORE * fit.noise or whole < _EXACT:
        return ""
    return (
        f" That is by their median; their root mean square is {fixed(1e3 * whole, 4)} mm: some "
        "rows err by far more than most."
    )


def _digits(error: float, value: float) -> int:
    """Number of decimals of an estimate: two significant digits of its standard error."""
    size = error if math.isfinite(error) and error > 0 else abs(value) * 1e-4 or 1e-4
    return min(12, max(0, 1 - math.floor(math.log10(size))))
