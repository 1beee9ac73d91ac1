"""Curvature that varies along the robot, compared with constant curvature.

All models are compared with statics at the loads of the sweep, at the tip and over the disks. Fits
(`bowstring.constant_curvature.fit_curvature`) know the shape by statics: they show the least
error of a family of shapes. Predictions (`bowstring.constant_curvature.curvature_from_loads`) know
tensions and weight only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final, Literal

import numpy as np

from bowstring.aliases import Floats
from bowstring.constant_curvature import (
    RobotArcs,
    VariableCurvature,
    curvature_from_loads,
    fit_curvature,
)
from bowstring.data.tip_errors import Comparison, ModelName, known_max, known_mean
from bowstring.display import short_repr
from bowstring.errors import BowstringError
from bowstring.formatting import in_mm, in_percent
from bowstring.results import Key, Result
from bowstring.study.comparison import (
    COMPARISONS,
    FITS,
    FROM_FORCE,
    LABELS,
    PREDICTIONS,
    Model,
    disks_by_arcs,
)
from bowstring.study.design_map import has_too_many_disks

if TYPE_CHECKING:
    from bowstring.study.sweeps import Statics

Kind = Literal["constant_curvature", "fit", "prediction"]

_COMMON: Final[Kind] = "constant_curvature"
_SAME: Final = 1e-9  # distance of two predictions over the length that is rounding
_REDUCES: Final = 0.5  # ratio of two errors below which the text names a model
_OF_BEND: Final = 0.2  # ratio of the fitted arc's error to that from force, likewise
_POWERS: Final = {1: "linear in arc length", 2: "quadratic"}
_EXACT: Final = 1e-4  # mean tip error over the length that needs no better model


@dataclass(frozen=True)
class TipOfShape(Result):
    """Errors of the tip of one model against statics."""

    name: Annotated[ModelName, Key()]
    """Model, as of ``comparisons``."""
    n: Annotated[int, Key()]
    """Number of loads."""
    mean: Annotated[float, Key("tip_mean_mm")]
    """Mean error of the tip, m; NaN without loads."""
    maximum: Annotated[float, Key("tip_max_mm")]
    """Largest error of the tip, m; NaN without loads."""
    share: Annotated[float, Key("tip_mean_percent")]
    """Mean error of the tip as a share of the length; NaN without loads."""


@short_repr
@dataclass(frozen=True)
class ShapeModel(Result):
    """Errors of one model at the tip and over the whole backbone, against statics."""

    name: str
    """Name of its comparison."""
    kind: Annotated[Kind, Key()]
    """``constant_curvature`` from lengths or force; ``fit``: curvature fitted to the disks by
    statics; ``prediction``: from tensions and weight."""
    degree: Annotated[int, Key()]
    """Degree of the curvature in arc length: 0 where it is constant."""
    comparison: Comparison
    """Tips."""
    shape: Floats
    """RMS (n,) over the disks of their distance from statics, m."""
    largest: Floats
    """Largest distance (n,) of a disk from statics, m."""

    @property
    def label(self) -> str:
        """The model in words."""
        return LABELS[self.name]

    @property
    def tip(self) -> Annotated[TipOfShape, Key(flat=True)]:
        """Errors of the tip."""
        found = self.comparison
        return TipOfShape(found.model, found.n, found.mean, found.maximum, found.mean_share)

    @property
    def shape_mean(self) -> Annotated[float, Key("shape_mean_mm")]:
        """Mean over the loads of the RMS error over the disks, m; NaN without loads."""
        return known_mean(self.shape)

    @property
    def shape_max(self) -> Annotated[float, Key("shape_max_mm")]:
        """Largest error of a disk, m; NaN without loads."""
        return known_max(self.largest)

    @property
    def shape_share(self) -> Annotated[float, Key("shape_mean_percent")]:
        """The mean error as a share of the length; NaN without loads."""
        return self.shape_mean / self.comparison.length


@short_repr
@dataclass(frozen=True)
class ShapeModels(Result):
    """Constant and variable curvature over the whole backbone."""

    models: Annotated[tuple[ShapeModel, ...], Key()]
    """Constant curvature, then fits and predictions by degree."""
    curves: Mapping[str, VariableCurvature]
    """Curvature of fits and predictions at the loads of the sweep (n,), by name."""
    without: tuple[str, ...]
    """Why models are left out, in sentences."""

    def find(self, name: str) -> ShapeModel | None:
        """The model of a name; None if it is left out."""
        return next((model for model in self.models if model.name == name), None)

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """Comparisons of the tips of fits and predictions."""
        return tuple(model.comparison for model in self.models if model.kind != _COMMON)

    @property
    def text(self) -> Annotated[tuple[str, ...], Key()]:
        """Results in sentences, then why models are left out."""
        return (*_on_fits(self), *_on_predictions(self), *self.without)


def compare_shapes(
    model: Model, statics: Statics, comparisons: Mapping[str, Comparison]
) -> ShapeModels:
    """Compare constant and variable curvature with statics, at the tip and over the disks.

    Parameters
    ----------
    model : Model
        Robot and actuated tendons.
    statics : Statics
        Sweep.
    comparisons : mapping
        Constant curvature against statics, by name.
    """
    tensions, disks = model.tensions(statics.tension), statics.disk_positions
    out = []
    for name in COMPARISONS:
        commands = tensions if name in FROM_FORCE else statics.tendon_lengths
        away = disks_by_arcs(model.robot, name, commands) - disks
        out.append(ShapeModel(name, _COMMON, 0, comparisons[name], *_over_disks(away)))
    curves, without = {}, []
    if has_too_many_disks(model.robot):
        without.append(
            f"Variable curvature is left out: {model.robot.name} has "
            f"{len(model.robot.disks.station_m)} disks, too many for a fit at each load."
        )
    else:
        fits, why = _fitted(model, statics)
        predictions, same = _predicted(model, statics)
        curves = fits | predictions
        without += [*why, *same]
    for name, curve in curves.items():
        kind: Kind = "fit" if name in FITS else "prediction"
        away = curve.disk_positions - disks
        tip = curve.disk_positions[:, -1]
        compared = Comparison(name, "statics", model.length, tip, tip - statics.tip_position)
        out.append(ShapeModel(name, kind, curve.degree, compared, *_over_disks(away)))
    return ShapeModels(tuple(out), curves, tuple(without))


def _over_disks(away: Floats) -> tuple[Floats, Floats]:
    """RMS and largest distance (n,) of disks, from their differences (n, N, 3)."""
    distance = np.linalg.norm(away, axis=-1)
    return np.sqrt(np.mean(distance**2, axis=-1)), distance.max(axis=-1)


def _fitted(model: Model, statics: Statics) -> tuple[dict[str, VariableCurvature], list[str]]:
    """Fits by name, and why some are left out."""
    out: dict[str, VariableCurvature] = {}
    rows = np.flatnonzero(statics.converged)
    for degree, name in enumerate(FITS):
        try:
            fit = fit_curvature(model.robot, statics.disk_positions[rows], degree)
        except BowstringError as error:
            return out, [f"{LABELS[name].capitalize()}, is left out: {str(error).rstrip('.')}."]
        bend = np.full((len(statics.tension), *fit.bend.shape[1:]), np.nan)
        bend[rows] = fit.bend
        out[name] = VariableCurvature(model.robot, bend)
    return out, []


def _predicted(model: Model, statics: Statics) -> tuple[dict[str, VariableCurvature], list[str]]:
    """Predictions by name where they differ from the linear law, else a sentence on why not."""
    robot, tensions = model.robot, model.tensions(statics.tension)
    found: dict[str, VariableCurvature] = {}
    last: VariableCurvature | None = None
    for degree, name in enumerate(PREDICTIONS):
        last = found[name] = curvature_from_loads(robot, tensions, degree, start=last)
    try:
        law = RobotArcs.from_tensions(robot, tensions).disk_positions
    except BowstringError:
        return found, []
    apart = [np.abs(curve.disk_positions - law).max() for curve in found.values()]
    if max(apart) > _SAME * model.length or not np.isfinite(apart).all():
        return found, []
    return {}, [
        "From tensions and weight alone, a curvature linear or quadratic in arc length is that of "
        "the linear law: the bending moment is the same all along each segment."
    ]


# -- in sentences ----------------------------------------------------------------------------------


def _mean(model: ShapeModel) -> str:
    mean = model.comparison.mean
    return f"{in_mm(mean)} ({in_percent(mean / model.comparison.length)})"


def _on_fits(found: ShapeModels) -> Iterator[str]:
    fits = [model for name in FITS if (model := found.find(name)) is not None]
    if not fits:
        return
    arc, others = fits[0], fits[1:]
    length, mean = arc.comparison.length, arc.comparison.mean
    text = (
        "Fitted to the shape of the rod, which a prediction does not know, constant curvature is "
        f"off by {in_mm(mean)} ({in_percent(mean / length)} of length) at the tip in the mean"
    )
    if mean < _EXACT * length:
        text += "; a curvature that varies along the robot has nothing to gain"
    elif any(model.comparison.mean < _REDUCES * mean for model in others):
        parts = [f"{_POWERS[model.degree]} to {_mean(model)}" for model in others]
        text += f"; a curvature {', one '.join(parts)}".replace(" to ", " reduces it to ", 1)
    elif others:
        parts = [f"{_POWERS[model.degree]} {_mean(model)}" for model in others]
        text += f"; a curvature that varies along the robot gains little ({', '.join(parts)})"
    force = found.find("cc_from_force")
    if force is not None and mean < _OF_BEND * force.comparison.mean:
        text += (
            f". Most of the error from force, {_mean(force)}, is one of the bend and not of the "
            "shape"
        )
    yield f"{text}."


def _on_predictions(found: ShapeModels) -> Iterator[str]:
    known = [model for name in PREDICTIONS if (model := found.find(name)) is not None]
    if not known:
        return
    parts = [f"{model.label.partition(' ')[0]} {_mean(model)}" for model in known]
    loads = len(known[0].shape)
    fewest = min(model.comparison.n for model in known)
    over = "" if fewest == loads else f" (at {fewest} of {loads} loads or more)"
    force = found.find("cc_from_force")
    law = "" if force is None else f"; by the linear law {_mean(force)}"
    yield (
        "From tensions, routing and weight, the predicted curvature has these mean tip errors: "
        f"{', '.join(parts)}{over}{law}."
    )
