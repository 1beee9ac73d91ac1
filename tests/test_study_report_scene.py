"""Numbers of the 3-D view of the report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bowstring.data.measurements import read_measurements
from bowstring.study.data_validation import judge_data
from bowstring.study.report_scene import scene, scene_text
from bowstring.study.study import Study

BENCH = Path(__file__).parents[1] / "examples" / "bench.csv"


def test_it_has_the_numbers_of_the_study(paper: Study) -> None:
    found = scene(paper)
    assert found is not None
    statics = paper.statics
    assert found["load"] == pytest.approx(statics.tension.tolist())
    disks = np.array(found["disks"])
    np.testing.assert_allclose(disks[:, :, :3], statics.disk_positions * 1e3, atol=1e-4)
    turns = disks[:, :, 3:].reshape(statics.disk_rotations.shape)
    np.testing.assert_allclose(turns, statics.disk_rotations, atol=1e-4)
    assert found["tolerance"] == pytest.approx(6.41)
    for model in found["models"]:
        tips = np.array([line[-1] for line in model["backbone"]])
        away = np.linalg.norm(tips - disks[:, -1, :3], axis=1)
        np.testing.assert_allclose(model["error"], away, atol=2e-3)
    # each tendon ends in its hole of the last disk
    ends = np.array([[path[-1] for path in row] for row in found["tendons"]])
    arms = np.linalg.norm(ends - disks[:, -1, None, :3], axis=-1)
    np.testing.assert_allclose(arms, 29.0, atol=0.02)
    assert found["measured"] == [] and found["label"] is None


def test_loads_without_an_equilibrium_or_an_arc_are_left_out(paper: Study) -> None:
    s = paper.statics
    converged = s.converged.copy()
    converged[3:] = False
    lengths = s.tendon_lengths.copy()
    lengths[1] = 0.011 * s.tendon_lengths[1]  # no arc
    disks = s.disk_positions.copy()
    disks[3:] = np.nan
    cut = replace(s, converged=converged, tendon_lengths=lengths, disk_positions=disks)
    found = json.loads(scene_text(replace(paper, statics=cut)))
    assert len(found["load"]) == len(found["disks"]) == 3
    by_lengths = next(m for m in found["models"] if m["name"] == "cc_from_lengths")
    assert by_lengths["backbone"][1] is None and by_lengths["backbone"][2] is not None
    none = replace(s, converged=np.zeros_like(converged))
    assert scene_text(replace(paper, statics=none)) == "null"


@pytest.mark.slow
def test_measured_points_are_named_and_cannot_end_the_script(paper: Study) -> None:
    judged = judge_data(paper.robot, read_measurements(BENCH, paper.robot), 0.01)
    named = replace(judged, data=replace(judged.data, name="</script><b>"))
    text = scene_text(replace(paper, data=named))
    assert "<" not in text
    found = json.loads(text)
    assert found["label"] == "synthetic: </script><b>"
    np.testing.assert_allclose(found["measured"], judged.point * 1e3, atol=1e-3)
