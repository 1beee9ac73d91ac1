"""Curvature that varies along the robot, beside constant curvature in a study."""

from __future__ import annotations

import numpy as np
import pytest

import bowstring as bs
from bowstring.study.comparison import COMPARISONS, FITS, PREDICTIONS
from bowstring.study.shape_figures import draw_shapes
from bowstring.study.shape_models import ShapeModel, ShapeModels
from bowstring.study.study import Study
from bowstring.viz.style import figure_style
from objects import legend_of
from stages import Stages

ROBOT = bs.load_robot("amouri2019")
HORIZONTAL = {"gravity": "-9.81 0 0 m/s^2"}
CONVERGING = {"segments.0.tendons.end_pitch_radius": "15 mm"}


def found(changes: dict[str, object], **loading: object) -> ShapeModels:
    return Stages(ROBOT.with_(changes), **loading).shapes


def of(shapes: ShapeModels, name: str) -> ShapeModel:
    model = shapes.find(name)
    assert model is not None
    return model


def test_the_studys_robot_bends_in_an_arc(paper: Study) -> None:
    shapes = paper.shapes
    assert [m.name for m in shapes.models] == [*COMPARISONS, *FITS]  # it has no weight
    arc, force = of(shapes, "constant_curvature_fit"), of(shapes, "cc_from_force")
    assert arc.comparison.mean < 1e-4 * paper.length < 0.01 * force.comparison.mean * 1e2
    assert "has nothing to gain" in shapes.text[0]
    assert "is one of the bend and not of the shape" in shapes.text[0]
    assert "is that of the linear law" in shapes.text[1]
    at = paper.verdict.text.index(shapes.text[0])
    assert paper.verdict.text[at : at + 2] == shapes.text
    assert paper.verdict.text[at - 1].startswith("Corrections in closed form")


def test_errors_are_those_of_tips_and_disks(paper: Study) -> None:
    s = paper.statics
    for model in paper.shapes.models:
        assert model.comparison is paper.comparison(model.name)
    arcs = bs.constant_curvature.RobotArcs.from_tensions(ROBOT, paper.model.tensions(s.tension))
    away = np.linalg.norm(arcs.disk_positions - s.disk_positions, axis=-1)
    force = of(paper.shapes, "cc_from_force")
    assert force.shape == pytest.approx(np.sqrt(np.mean(away**2, axis=1)), abs=1e-12)
    assert force.largest == pytest.approx(away.max(axis=1), abs=1e-12)
    values = {v["name"]: v for v in paper.to_dict()["shapes"]["models"]}
    assert values["cc_from_force"]["tip_mean_mm"] == pytest.approx(4.42, abs=5e-3)
    assert values["cc_from_force"]["shape_mean_mm"] == pytest.approx(1e3 * force.shape.mean())
    assert values["linear_curvature_fit"]["degree"] == 1
    assert values["linear_curvature_fit"]["kind"] == "fit"


def test_a_sagging_robot_has_another_curvature() -> None:
    shapes = found(HORIZONTAL, points=5)
    assert [m.name for m in shapes.models] == [*COMPARISONS, *FITS, *PREDICTIONS]
    fits = [of(shapes, name) for name in FITS]
    errors = np.array([model.shape for model in fits])
    assert (np.diff(errors, axis=0) <= 1e-12).all()  # at every load
    assert fits[1].comparison.mean < 0.1 * fits[0].comparison.mean
    assert "a curvature linear in arc length reduces it to" in shapes.text[0]
    # knowing the weight helps, and so does a curvature that may vary
    law, arc, linear = (
        of(shapes, name).comparison.mean for name in ("cc_from_force", *tuple(PREDICTIONS)[:2])
    )
    assert linear < 0.2 * arc < 0.2 * law
    # no prediction of a family is nearer over the disks than its fit
    for fit, prediction in zip(FITS, PREDICTIONS, strict=True):
        assert (of(shapes, fit).shape <= of(shapes, prediction).shape + 1e-12).all()


def test_converging_tendons_have_a_linear_curvature() -> None:
    shapes = found(CONVERGING, points=5, max_tension=40.0)
    constant, linear = (of(shapes, name).comparison.mean for name in tuple(PREDICTIONS)[:2])
    force = of(shapes, "cc_from_force").comparison.mean
    assert constant == pytest.approx(force)  # both know the mean of the holes only
    assert linear < 0.3 * constant
    assert "by the linear law" in shapes.text[1]


def test_loads_without_equilibrium_have_no_fit() -> None:
    few = ROBOT.with_({"segments.0.disks.count": 4, **HORIZONTAL})
    stages = Stages(few, points=6, max_tension=900.0)
    missing = ~stages.statics.converged
    assert missing.any() and not missing.all()
    for model in stages.shapes.models:
        assert not np.isfinite(model.comparison.error[missing]).any()
    assert np.isfinite(of(stages.shapes, "quadratic_curvature_fit").shape[~missing]).all()


@pytest.mark.parametrize(
    ("changes", "names", "why"),
    [
        (
            {"segments.0.disks.count": 3},
            ["constant_curvature_fit", "linear_curvature_fit"],
            "Quadratic curvature, fitted, is left out: a segment of amouri2019 has 3 disks; a "
            "curvature of degree 2 needs 4 or more to be fitted.",
        ),
        (
            {"segments.0.disks.count": 61},
            [],
            "Variable curvature is left out: amouri2019 has 61 disks",
        ),
    ],
    ids=["few", "many"],
)
def test_what_is_left_out_is_said(changes: dict[str, object], names: list[str], why: str) -> None:
    shapes = found(changes, points=3)
    assert [m.name for m in shapes.models if m.kind == "fit"] == names
    assert any(sentence.startswith(why) for sentence in shapes.text)


def test_two_segments_with_free_routing_and_precurved_backbones_are_compared() -> None:
    robot = bs.load_robot(
        "crl-ftdcr-v4",
        {
            "segments.0.backbone.rest_bend": "20 deg",
            "segments.1.backbone.rest_twist": "30 deg",
            "segments.2.tendons.turns": 0.2,
        },
    )
    stages = Stages(robot, points=4)
    fits = [of(stages.shapes, name).shape for name in FITS]
    assert all(np.isfinite(shape).all() for shape in fits)
    assert (fits[1] < 0.1 * fits[0])[1:].all()
    linear, law = (of(stages.shapes, n) for n in ("linear_curvature_from_loads", "cc_from_force"))
    assert linear.comparison.mean < 0.2 * law.comparison.mean


def test_the_figure_has_each_model_and_the_rod(paper: Study) -> None:
    with figure_style():
        tip, disks, along = draw_shapes(paper).axes
    labels = legend_of(tip)
    assert labels == [
        "CC from lengths",
        "CC from force",
        "constant, fitted",
        "linear, fitted",
        "quadratic, fitted",
    ]
    assert "(% of length)" in tip.get_ylabel() and "(1/m)" in along.get_ylabel()
    line = next(line for line in tip.lines if line.get_label() == "CC from force")
    drawn = np.asarray(line.get_ydata(), dtype=float)
    error = paper.comparison("cc_from_force").error / paper.length * 100.0
    assert drawn[1:] == pytest.approx(error[1:])
    assert len(disks.lines) == len(labels)
    rod = next(line for line in along.lines if line.get_label() == "rod, by disk")
    # F r / EI, and what straight spans add
    law = 80.0 * float(ROBOT.tendons.pitch_radius_m[0]) / float(ROBOT.bending_stiffness[0])
    assert np.asarray(rod.get_ydata()) == pytest.approx(np.full(9, law), rel=0.06)
