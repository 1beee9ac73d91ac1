"""Figures of the study: they agree with the numbers, and no element covers another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from bowstring.robot.reader import load_robot
from bowstring.study.comparison import MEANINGS
from bowstring.study.error_budget import Side
from bowstring.study.figure_list import DATA_FIGURES, FIGURES
from bowstring.study.figures import _DRAWINGS
from bowstring.study.shapes import backbones
from bowstring.study.study import Study
from bowstring.viz.style import LIGHT, figure_style
from objects import legend_of
from stages import Stages, with_gaps

SILICONE = Path(__file__).parent / "silicone.yaml"
SIDES: tuple[Side, Side] = ("in_sweep", "removed")


@pytest.fixture(scope="module")
def soft(paper: Study) -> Study:
    """A sweep in which constant curvature from force has a large error."""
    return Stages(load_robot(SILICONE), points=9).over(paper)


def drawn(found: Study, stem: str) -> Figure:
    """One figure, laid out as in a file."""
    with figure_style():
        figure = _DRAWINGS[stem](found)
        figure.draw_without_rendering()
    return figure


def with_gaps_in(found: Study, effect: str, loads: Sequence[int]) -> Study:
    """The study as if the full model without an effect had no equilibrium at some loads."""
    row = next(r for r in found.budget.rows if r.effect == effect)
    lacking = replace(row, removed=with_gaps(row.removed, loads))
    rows = [lacking if r is row else r for r in found.budget.rows]
    return replace(found, budget=replace(found.budget, rows=tuple(rows)))


# -- the path of the tip and its magnified end -------------------------------------------------


def scale(axes: Axes) -> float:
    """Pixels in a mm."""
    return float(axes.bbox.width / np.ptp(axes.get_xlim()))


@pytest.mark.parametrize("name", ["amouri2019", "crl-ftdcr-v4", "silicone"])
@pytest.mark.slow
def test_an_inset_magnifies_and_covers_nothing(name: str, paper: Study, soft: Study) -> None:
    known = {"amouri2019": paper, "silicone": soft}
    # the outermost segment alone is nearly an arc, so that the curves need magnifying
    found = known.get(name) or Stages(load_robot(name), points=9, tendon=7).over(paper)
    (axes,) = (figure := drawn(found, "fig10_overlay")).axes
    assert len(axes.child_axes) == (0 if name == "silicone" else 1)
    x, z = np.array(axes.get_xlim()), np.array(axes.get_ylim())
    for inset in axes.child_axes:
        assert scale(inset) >= 2.0 * scale(axes)
        for low, high, whole in zip(
            *np.transpose([inset.get_xlim(), inset.get_ylim()]), (x, z), strict=True
        ):
            assert whole[0] <= low < high <= whole[1]  # its frame is within the axes
        for line in axes.lines:
            pixels = axes.transData.transform(np.asarray(line.get_xydata()))
            assert not any(inset.bbox.contains(*p) for p in pixels)
    for artist in axes.get_children():
        box = artist.get_tightbbox()
        if box is not None and artist.get_visible():
            assert box.x1 < figure.bbox.x1 + 1.0 and box.y0 > figure.bbox.y0 - 1.0


# -- configurations ----------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["amouri2019", "crl-ftdcr-v4", "silicone"])
@pytest.mark.slow
def test_no_disk_hides_the_label_of_a_tip(name: str, paper: Study, soft: Study) -> None:
    known = {"amouri2019": paper, "silicone": soft}
    found = known[name] if name in known else Stages(load_robot(name), points=9).over(paper)
    figure = drawn(found, "fig07_configurations")
    axes: Any = figure.axes[0]
    labels = [t for t in axes.texts if t.get_text()]
    assert len(labels) == 5
    boxes = [label.get_window_extent() for label in labels]
    rims = np.concatenate([p.vertices for disks in axes.collections for p in disks.get_paths()])
    rims = axes.transData.transform(rims)
    for i, (label, box) in enumerate(zip(labels, boxes, strict=True)):
        assert label.get_zorder() > max(disks.get_zorder() for disks in axes.collections)
        assert not any(box.contains(*p) for p in rims), label.get_text()
        assert not any(box.overlaps(other) for other in boxes[:i]), label.get_text()


# -- shapes at the largest load ----------------------------------------------------------------


@pytest.mark.parametrize("which", ["paper", "soft"])
def test_shapes_end_where_the_study_has_the_tips(
    which: str, request: pytest.FixtureRequest
) -> None:
    found: Study = request.getfixturevalue(which)
    tension, shapes = backbones(found)
    assert tension == found.settings.max_tension
    assert [s.name for s in shapes] == ["statics", *MEANINGS]
    for shape in shapes:
        tip = found.statics.tip_position[-1]
        error = 0.0
        if shape.name != "statics":
            comparison = found.comparison(shape.name)
            tip, error = comparison.tip_position[-1], comparison.error[-1]
        assert shape.backbone[0] == pytest.approx([0.0, 0.0, 0.0])
        assert shape.backbone[-1] == pytest.approx(tip, abs=1e-8)
        assert shape.disks[-1] == pytest.approx(tip, abs=1e-8)
        assert shape.from_statics[-1] == pytest.approx(error, abs=1e-8)
        # a backbone passes through its disks
        gaps = np.linalg.norm(shape.backbone[:, None] - shape.disks, axis=-1).min(axis=0)
        assert gaps.max() < 0.01 * found.length
    figure = drawn(found, "backbones")
    assert legend_of(figure.axes[0]) == ["rod model", "CC from lengths", "CC from force"]
    assert f"{found.settings.max_tension:g} N" in figure.axes[0].get_title(loc="left")


def test_a_load_without_equilibrium_is_not_the_largest(paper: Study) -> None:
    s = paper.statics
    converged, disks = s.converged.copy(), s.disk_positions.copy()
    converged[-3:], disks[-3:] = False, np.nan
    cut = replace(paper, statics=replace(s, converged=converged, disk_positions=disks))
    tension, shapes = backbones(cut)
    assert tension == s.tension[-4]
    assert shapes[0].backbone[-1] == pytest.approx(s.tip_position[-4], abs=1e-8)


# -- error budget ------------------------------------------------------------------------------


def ends(axes: Axes) -> dict[tuple[float, str, bool], float]:
    """Markers by place, colour, and whether they are filled: the mean error in mm."""
    out = {}
    for line in axes.lines:
        marker = line.get_marker() not in ("None", None, "")
        if marker and len(line.get_xdata()) == 1:
            filled = to_hex(line.get_markerfacecolor()) != LIGHT["paper"]
            (x,), (y,) = line.get_xdata(), line.get_ydata()
            out[round(float(y), 3), to_hex(line.get_color()), filled] = float(x)
    return out


def test_each_row_of_the_budget_is_drawn_between_its_own_two_cases(paper: Study) -> None:
    budget = paper.budget
    figure = drawn(paper, "error_budget")
    for axes, side in zip(figure.axes, SIDES, strict=False):
        found = ends(axes)
        assert len(found) == 4 * len(budget.rows)
        for i, row in enumerate(budget.rows):
            place = len(budget.rows) - 1 - i
            for name, colour, shift in zip(MEANINGS, ("blue", "red"), (0.16, -0.16), strict=True):
                c = budget.contribution(row, side, name)
                key = round(place + shift, 3), LIGHT[colour]
                assert found[(*key, True)] == pytest.approx(max(c.with_effect * 1e3, 1e-3))
                assert found[(*key, False)] == pytest.approx(max(c.without_effect * 1e3, 1e-3))
    # gravity of a suspended robot reduces the error: its line points to the left
    hanging = next(i for i, r in enumerate(budget.rows) if r.effect == "gravity_hanging")
    level = round(len(budget.rows) - 1 - hanging - 0.16, 3)
    red = ends(figure.axes[1])
    assert red[level, LIGHT["red"], True] < red[level, LIGHT["red"], False]
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"with the effect", "without it"} <= set(names)


@pytest.mark.slow
def test_rows_over_fewer_loads_are_marked(paper: Study) -> None:
    whole = drawn(paper, "error_budget").axes[1]
    assert not any(text.get_text() for text in whole.texts)
    axes = drawn(with_gaps_in(paper, "torsion", range(6)), "error_budget").axes[1]
    (mark,) = [text for text in axes.texts if text.get_text()]
    place = len(paper.budget.rows) - 1 - [r.effect for r in paper.budget.rows].index("torsion")
    assert mark.get_text() == "11 of 17" and mark.xy[1] == place  # type: ignore[attr-defined]
    assert "these loads only" in axes.get_xlabel()
    none = drawn(with_gaps_in(paper, "torsion", range(17)), "error_budget").axes[1]
    assert [text.get_text() for text in none.texts] == ["none"]


# -- names of figures --------------------------------------------------------------------------


def test_figures_of_data_are_named_as_in_the_source_study() -> None:
    captions = {figure.stem: figure.caption for figure in DATA_FIGURES}
    assert "Fig. 12 of Amouri (2019)" in captions["fig12_measured_errors"]
    assert "along each axis" in captions["fig12_measured_errors"]
    for stem, caption in captions.items():  # a file is named after its figure
        number = stem[3:5].lstrip("0") if stem.startswith("fig") else None
        assert (f"Fig. {number} " in caption) if number else ("Fig." not in caption)
    for figure in FIGURES:
        if figure.stem.startswith("fig") and "Fig." in figure.caption:
            assert f"Fig. {int(figure.stem[3:5])}" in figure.caption
