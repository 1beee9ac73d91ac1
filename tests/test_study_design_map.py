"""Map of validity of a study: the axis that fits the robot, and why there is none."""

from __future__ import annotations

import numpy as np
import pytest

import bowstring as bs
from bowstring.study.design_map import caption_of, design_axis, design_map, without_map
from bowstring.validity.loading import Loading
from stages import Stages

ROBOT = bs.load_robot("amouri2019")
LISTED = ROBOT.with_({"segments.0.disks.positions": np.linspace(0.1, 0.641, 6)})
CLAMPED = ROBOT.with_({"segments.0.disks.clamped_length": "60 mm"})
UNEQUAL = bs.load_robot("crl-ftdcr-v4").with_({"segments.1.disks.count": 8})
COUNT = "segments.*.disks.count"


@pytest.mark.parametrize(
    ("robot", "path", "start", "stop"),
    [
        (ROBOT, COUNT, 3, 13),
        (ROBOT.with_({COUNT: 2}), COUNT, 1, 5),  # this robot lies inside
        (CLAMPED, COUNT, 3, 10),  # eleven disks would clamp the whole backbone
        (LISTED, "segments.0.tendons.pitch_radius", 0.0145, 0.0319),  # within the disks
        (UNEQUAL, "segments.*.tendons.pitch_radius", 0.00225, 0.0054),
        (
            UNEQUAL.with_({"segments.0.tendons.pitch_radius": "4 mm"}),
            "segments.*.backbone.diameter",
            0.0005,
            0.0015,
        ),
    ],
    ids=["count", "few", "clamped", "listed", "unequal", "radii"],
)
def test_the_axis_fits_the_robot(robot: bs.Robot, path: str, start: float, stop: float) -> None:
    axis = design_axis(robot)
    assert axis is not None and axis.path == path
    assert (axis.start, axis.stop) == pytest.approx((start, stop))
    own = axis.own_value(robot)
    assert own is not None and start < own < stop
    assert without_map(robot) == ""


@pytest.mark.parametrize(
    ("robot", "words"),
    [
        (
            LISTED,
            "by the pitch radius and the tension, all other numbers as they are (the positions",
        ),
        (CLAMPED, "by the number of disks of each segment and the tension"),
        (UNEQUAL, "(segments have different numbers of disks)"),
    ],
    ids=["listed", "clamped", "unequal"],
)
def test_any_robot_has_a_map(robot: bs.Robot, words: str) -> None:
    found = design_map(robot, Stages(robot, points=3).settings)
    assert found is not None and words in caption_of(found)
    assert all(np.isfinite(value).any() for value in found.value.values())


def test_a_study_without_a_map_says_why() -> None:
    found = bs.run_study(ROBOT.with_({COUNT: 61}), loading=Loading(points=2))
    assert found.map is None and found.load_map is None
    assert not {"validity_map", "load_map"} & {f.stem for f in found.figures}
    (why,) = [note for note in found.notes if "map" in note]
    assert why.startswith("The maps of validity are left out: amouri2019 has 61 disks")
    assert found.to_dict()["maps"] == {"design": None, "load": None, "text": []}
    mixed = {
        f"segments.0.{path}": value
        for path, value in {
            "tendons.pitch_radius": "4 mm",
            "backbone.diameter": "1.1 mm",
            "backbone.E": "51 GPa",
        }.items()
    }
    assert "no number of all is varied" in without_map(UNEQUAL.with_(mixed))
