"""Studies of backbones by a stiffness matrix: figures of plain robots, of maps and of solves."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.constant_curvature import RobotArcs, curvature_from_loads
from bowstring.data import synthetic
from bowstring.dynamics import ramp
from bowstring.dynamics.run_file import read_run
from bowstring.errors import InputError
from bowstring.formatting import plain
from bowstring.robot.writer import to_yaml
from bowstring.statics.fields import FIELDS
from bowstring.study import report
from bowstring.study import run as study_module
from bowstring.study.comparison import Model
from bowstring.study.figures import draw
from bowstring.study.study import Study
from bowstring.validity.effects import with_values
from objects import coupled_robot
from shell import Shell
from test_offset_line import Pair

MM = 1e-3
LOADING = bs.Loading(max_tension=15.0, points=5, tendon=1)
WITHOUT = (
    "Stress and strain at the surface are not computed: the section is given by its stiffness "
    "matrix, which has no shape."
)

#: Of a plain backbone alone: stress, continuous tendons in the baseline, E and diameter as axes.
OF_PLAIN = re.compile(
    r"budget\.baseline|budget\.rows\.(straight_spans|\w+\.added)|verdict\..*(cause|share)"
    r"|_max_(MPa|percent)|maps\.design|uncertainty|provenance\.robot|cause"
)


def numbers(values: Any, path: str = "") -> Iterator[tuple[str, float | None]]:
    """Paths and numbers of JSON values; effects by their name."""
    if isinstance(values, dict):
        for key, value in values.items():
            yield from numbers(value, f"{path}.{key}")
    elif isinstance(values, list):
        for i, value in enumerate(values):
            name = value.get("effect", i) if isinstance(value, dict) else i
            yield from numbers(value, f"{path}.{name}")
    elif values is None or (isinstance(values, (int, float)) and not isinstance(values, bool)):
        yield path, values


def common(study: Study) -> dict[str, float | None]:
    found = numbers(plain(study.to_dict()))
    return {path: value for path, value in found if not OF_PLAIN.search(path)}


def equal(here: dict[str, float | None], there: dict[str, float | None]) -> None:
    """Hold numbers in mm, N, s, Hz and percent to those of another robot."""
    for path, value in here.items():
        other = there[path]
        assert (value is None) == (other is None), path
        place = path.endswith("max_error_at_N")  # of errors that may be rounding
        if value is not None and other is not None and not place:
            assert other == pytest.approx(value, rel=1e-5, abs=2e-4), path


@pytest.fixture(scope="module")
def pair() -> Pair:
    """A plain robot, and the same by its matrix, solved by the equations of coupled sections."""
    return Pair.of([0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def studies(pair: Pair) -> tuple[Study, Study]:
    with pytest.MonkeyPatch.context() as patch:  # OF_PLAIN: only one of them has an E
        patch.setattr(study_module, "design_map", lambda robot, settings: None)
        return tuple(bs.run_study(r, loading=LOADING) for r in (pair.plain, pair.other))  # type: ignore[return-value]


# -- the same robot in two descriptions --------------------------------------------------------


def test_numbers_are_those_of_the_plain_robot(studies: tuple[Study, Study]) -> None:
    here, there = (common(study) for study in studies)
    assert here.keys() == there.keys() and len(here) > 6000
    equal(here, there)


def test_causes_are_those_of_the_plain_robot_without_straight_spans(
    studies: tuple[Study, Study],
) -> None:
    here, there = (study.verdict for study in studies)
    for a, b in zip(here.meanings, there.meanings, strict=True):
        rest = [share for share in a.shares if share.effect != "straight_spans"]
        assert len(a.shares) == len(rest) + 1
        assert [s.effect for s in b.shares] == [s.effect for s in rest]
        errors = [[s.error_without for s in shares] for shares in (rest, b.shares)]
        assert errors[1] == pytest.approx(errors[0], abs=1e-7)
    assert any("this effect is not examined" in sentence for sentence in there.text)
    assert not any("not examined" in sentence for sentence in here.text)


def test_the_baseline_has_straight_spans(pair: Pair, studies: tuple[Study, Study]) -> None:
    """Each effect added to it, against the plain robot with straight spans alone."""
    budget, tension = studies[1].budget, studies[1].statics.tension
    assert "straight_spans" not in [row.effect for row in budget.rows] and len(budget.rows) == 10
    assert budget.baseline_description.startswith("straight spans, no clamps")
    model = Model(pair.plain, 0, "cosserat")
    spans = with_values(model.baseline, "model", {"tendon_path": "straight"})
    young = pair.plain.segments[0].backbone.young
    added: dict[str, Any] = {
        "clamps": ("disks", {"clamped_length": model.budget_clamps}),
        "shear_extension": ("model", {"theory": "cosserat"}),
        "torsion": ("model", {"twist": True}),
        "gravity_horizontal": ("load", {"gravity": (-9.81, 0.0, 0.0)}),
        "E_plus_10": ("backbone", {"E": 1.1 * young}),
    }
    rows = {row.effect: row.added for row in budget.rows}
    cases = [(rows[name], with_values(spans, *values)) for name, values in added.items()]
    for case, rods in [(budget.baseline, spans), *cases]:
        expected = model.case(rods, tension)
        for name, comparison in expected.comparisons.items():
            assert case.error(name) == pytest.approx(comparison.error, abs=1e-7)
    moved = rows["E_plus_10"].tip_position - budget.baseline.tip_position
    assert np.linalg.norm(moved, axis=1).max() > 5 * MM


def test_a_line_beside_the_axis_has_the_numbers_of_the_axis(studies: tuple[Study, Study]) -> None:
    """Perpendicular to the plane of bending the line bends as the axis, without extension.

    The law with the mean lever arm takes the distance to the tension centre, that of the axis.
    """
    place = 0.003
    pair = Pair.of([0.0, place, 0.0])
    assert pair.other.tension_centre_m[0] == pytest.approx([0.0, -place], abs=1e-12)
    assert abs(pair.other.section_stiffness[0, 3:, :3]).max() > 1000.0
    a, b = studies[0], bs.run_study(pair.other, loading=LOADING)
    assert b.towards == pytest.approx(a.towards, abs=1e-9)
    here, there = common(a), common(b)
    # weights beside the plane twist the robot, so that the tip of the line leaves that of the axis;
    # held shear and extension are those of the line; outputs of dynamics are at other times
    others = re.compile(
        r"tip_force|gravity_|full|removed|maps\.load|shear_extension"
        r"|dynamics\.((time|tension|tip)_|difference_from|overshoot|residual)"
    )
    compared = [path for path in here if not others.search(path)]
    assert len(compared) > 1500
    for name in ("cc_from_force.contribution_mm", "cc_from_lengths.contribution_mm"):
        assert f".budget.rows.torsion.in_sweep.{name}" in compared
    equal({path: here[path] for path in compared}, there)


# -- the same as maps and single solves --------------------------------------------------------

MATRIX = np.diag([0.10, 0.12, 0.08, 9000.0, 9000.0, 4000.0])
MATRIX[0, 2] = MATRIX[2, 0] = 0.03
MATRIX[2, 5] = MATRIX[5, 2] = 2.0
MATRIX[1, 5] = MATRIX[5, 1] = -4.0


def made(**changes: Any) -> bs.Robot:
    return coupled_robot(MATRIX, count=6, **{"gravity": "0 0 -9.81 m/s^2"} | changes)


@pytest.fixture(scope="module")
def coupled() -> Study:
    return bs.run_study(made(), loading=bs.Loading(max_tension=10.0, points=6, tendon=1))


def test_errors_are_those_of_single_solves(coupled: Study) -> None:
    robot = coupled.robot
    free = np.linalg.inv(MATRIX)
    for k, tension in enumerate(coupled.statics.tension):
        found = bs.solve(robot, [tension, 0.0, 0.0]).raise_for_status()
        arcs = {
            "cc_from_lengths": RobotArcs.from_lengths(robot, found.tendon_lengths),
            "cc_from_force": RobotArcs.from_tensions(robot, [tension, 0.0, 0.0]),
        }
        for name, arc in arcs.items():
            error = np.linalg.norm(arc.tip.position - found.tip.position)
            assert coupled.comparison(name).error[k] == pytest.approx(error, abs=1e-7)
        # the curvatures that the moment of the tendon and its force make
        wrench = np.array([0.0, 0.02, 0.0, 0.0, 0.0, -1.0]) * tension
        about_x, about_y = 0.4 * (free @ wrench)[:2]
        bend = arcs["cc_from_force"].theta[0] * np.array(
            [np.cos(arcs["cc_from_force"].phi[0]), np.sin(arcs["cc_from_force"].phi[0])]
        )
        assert bend == pytest.approx([about_y, -about_x], abs=1e-12)


def test_errors_are_those_of_a_map(coupled: Study) -> None:
    axis = f"tension=0:10 N:{len(coupled.statics.tension)}"
    found = bs.validity_map(coupled.robot, [axis], metric="error", loading=LOADING)
    for name in ("cc_from_lengths", "cc_from_force"):
        share = coupled.comparison(name).error / coupled.length
        assert found.value[name] == pytest.approx(share, abs=1e-6)


def test_without_gravity_the_law_has_the_slope_of_the_rod() -> None:
    """At small loads the tip by the linear law tends to that of the rod, with its extension."""
    robot = made(gravity="0 0 0 m/s^2")
    for tensions in ([1e-3, 0.0, 0.0], [0.0, 1e-3, 0.0], [0.0, 1e-3, 1e-3]):
        rod = bs.solve(robot, tensions).raise_for_status().tip.position
        arc = RobotArcs.from_tensions(robot, tensions).tip.position
        varied = curvature_from_loads(robot, tensions, 1).tip.position
        size = np.linalg.norm(rod[:2])
        for tip in (arc, varied):
            assert np.linalg.norm(tip[:2] - rod[:2]) < 2e-3 * size


# -- what is not computed ----------------------------------------------------------------------


def test_the_report_says_what_is_not_computed(coupled: Study, tmp_path: Path) -> None:
    folder = report.write(coupled, tmp_path / "study")
    page = (folder / "report.html").read_text()
    visible = re.sub(r"<svg.*?</svg>|<style.*?</style>|<[^>]+>", " ", page, flags=re.DOTALL)
    assert visible.count(WITHOUT) == 2
    assert "Straight spans are no row here" in visible and "stiffness matrix 10 % lower" in visible
    assert "Tip and displacement against force" in visible
    assert "take no distributions" in visible
    assert "the lever-arm law is for a backbone with equal bending stiffness" in visible
    assert not re.search(r"\bnan\b|\bNone\b", visible)
    # stress is not mentioned as if there were some
    assert "largest on the surface" not in visible
    (figure,) = (drawing() for stem, drawing in draw(coupled) if stem == "fig05_tip_against_force")
    assert [axes.get_ylabel().split("\n")[0] for axes in figure.axes] == [
        "tip coordinate (mm)",
        "displacement",
    ]
    content = json.loads((folder / "study.json").read_text())
    assert WITHOUT in content["notes"] and content["backbone_limits"] == []
    assert set(content["sweep"]["von_mises_max_MPa"]) == {None}
    assert content["dynamics"]["status"] == "converged"
    assert set(content["dynamics"]["strain_max_percent"]) == {None}
    for table in (folder / "tables").glob("*.csv"):
        with table.open() as file:
            assert not any(cell in ("nan", "inf") for row in csv.reader(file) for cell in row)


def test_stress_is_that_of_the_other_segments() -> None:
    changes = {"segments.0.backbone.yield_strength": "2 GPa", "gravity": "0 0 0 m/s^2"}
    robot = mixed().with_(changes)
    study = bs.run_study(robot, loading=bs.Loading(max_tension=4.0, points=3, tendon=4))
    says = study.without_surface
    assert "in segment" not in says and "segment 2: the section is given" in says
    assert says.endswith("the largest values are those of the other segments.")
    fields = bs.solve(robot, [0, 0, 0, 4, 0, 0]).raise_for_status().to_dataset()
    here = fields.segment == 1
    assert study.statics.surface.von_mises[-1] == pytest.approx(
        float(fields.von_mises[0, here].max()), rel=1e-6
    )
    assert len(study.limits_text) == 1 and "of segment 1" in study.limits_text[0]
    label = {row.effect: row.label for row in study.budget.rows}["E_minus_10"]
    assert label == "E or stiffness matrix 10 % lower"


# -- with measurements -------------------------------------------------------------------------


def test_a_study_with_measurements_keeps_the_matrix() -> None:
    robot = made()
    loads = synthetic.Loads(tensions=np.outer(np.linspace(0.0, 9.0, 7), [1.0, 0.0, 0.0]))
    data = synthetic.simulate(robot, loads, instrument=synthetic.Instrument(noise=2e-5))
    study = bs.run_study(robot, loading=bs.Loading(max_tension=9.0, points=4), measurements=data)
    assert study.data is not None and study.data.calibration is not None
    notes = " ".join(study.data.calibration.notes)
    assert "stays as in the robot file" in notes
    assert study.data.calibration.robot.segments[0].backbone == robot.segments[0].backbone
    assert study.data.comparison("rod").mean < 1e-4


# -- files of runs -----------------------------------------------------------------------------


def mixed() -> bs.Robot:
    plain_one = bs.load_robot("amouri2019").segments[0].model_dump(exclude_none=True)
    coupled_one = made().segments[0].model_dump(exclude_none=True)
    return made().with_({"segments": [plain_one, coupled_one]})


@pytest.mark.parametrize(
    "robot",
    [
        made(),
        made().with_({"segments.0.backbone.rest_bend": "20 deg"}),
        mixed(),
        bs.load_robot("amouri2019", {"segments.0.backbone.rest_bend": "40 deg"}),
    ],
    ids=["coupled", "coupled and curved", "mixed", "plain and curved"],
)
def test_a_file_of_a_run_has_its_fields(robot: bs.Robot, tmp_path: Path) -> None:
    tensions = [5.0, 1.0, 0.0] + [0.0] * (len(robot.tendons.segment) - 3)
    load = bs.Load(tensions=ramp(tensions, 0.03))
    kept = bs.simulate(robot, duration=0.06, load=load).to_dataset()
    output = bs.Output(path=tmp_path / "run.nc")
    bs.simulate(robot, duration=0.06, load=load, output=output).raise_for_status()
    written = read_run(tmp_path / "run.nc")
    for field in FIELDS:
        here, there = kept[field.name].to_numpy(), written[field.name].to_numpy()
        size = np.nanmax(abs(here), initial=0.0)
        np.testing.assert_allclose(there, here, rtol=0.0, atol=1e-12 * size, err_msg=field.name)
    assert np.isfinite(written.curvature).all() and np.isfinite(written.strain).all()
    round_ = [segment.backbone.is_round for segment in robot.segments]
    assert np.isfinite(written.von_mises_max).all() == any(round_)
    matrix = robot.section_stiffness[-1]
    if not np.isnan(matrix).any():
        # moments and forces by the strains of the file
        last = written.isel(station=written.segment.to_numpy() == len(robot.segments), time=-1)
        strain = np.concatenate([last.curvature, last.strain], axis=-1)
        strain[:, :3] -= robot.rest_curvature[-1]
        wrench = np.concatenate([last.moment, last.force], axis=-1)
        assert strain @ matrix == pytest.approx(wrench, rel=1e-9, abs=1e-9)


# -- refusals ----------------------------------------------------------------------------------


def test_the_chart_is_not_for_a_matrix() -> None:
    with pytest.raises(InputError, match="not for those by a stiffness matrix; use"):
        bs.validity_chart(made(gravity="0 0 0 m/s^2"))


def test_what_needs_a_surface_is_refused(shell: Shell, tmp_path: Path) -> None:
    (tmp_path / "coupled.yaml").write_text(to_yaml(made()))
    file = str(tmp_path / "coupled.yaml")
    needs = "needs shape and material of the section, which a backbone by its stiffness matrix"
    for command in (
        ("fe", file, "--tension", "1,0,0"),
        ("study", file, "--fe"),
        ("study", file, "--solid"),
        ("export", file, "--out", str(tmp_path / "a.step")),
        ("export", file, "--drawing", str(tmp_path / "disks.svg")),
    ):
        says = shell.error(*command)
        assert needs in says and says.count("\n") <= 1, command
