"""Map of validity of a study over the tension and a load."""

from __future__ import annotations

import numpy as np
import pytest

import bowstring as bs
from bowstring.errors import InputError
from bowstring.study.comparison import Model
from bowstring.study.load_map import caption_of_loads, check_load_axis, load_map, load_text
from bowstring.study.study import Study
from bowstring.validity.loading import Loading
from bowstring.validity.map_result import ValidityMap
from stages import Stages

ROBOT = bs.load_robot("amouri2019")
UPRIGHT = ROBOT.with_({"gravity": "0 0 -9.81 m/s^2"})
LENGTHS, FORCE = "cc_from_lengths", "cc_from_force"


def mapped(robot: bs.Robot, over: str | None = None, top: float = 40.0) -> ValidityMap:
    stages = Stages(robot, max_tension=top)
    axis = check_load_axis(robot, stages.model, over)
    found = load_map(stages.model, stages.settings, axis)
    assert found is not None
    return found


def test_without_gravity_the_load_is_a_tip_force(paper: Study) -> None:
    found = paper.load_map
    assert found is not None
    assert [axis.path for axis in found.axes] == ["tension", "tip_force"]
    assert found.axes[1].stop == pytest.approx(0.5)
    # on the line, the error of a verdict with this force is the tolerance
    line = max(found.contour[FORCE], key=len)
    bent = line[line[:, 0] > 5.0]
    for tension, force in bent[:: len(bent) // 3]:
        given = bs.Load(gravity=(0.0, 0.0, 0.0), tip_force=force * np.array(paper.model.across))
        direct = bs.validity_map(ROBOT, [f"tension=0:{tension:.9g} N:2"], load=given)
        assert direct.value[FORCE][-1] == pytest.approx(0.01, rel=0.02)
    # without the force it is the crossing of the verdict
    (force,) = [m for m in paper.verdict.meanings if m.name == FORCE]
    assert line[np.argmin(line[:, 1])] == pytest.approx([force.valid_to, 0.0], abs=0.3)


def test_in_gravity_the_load_is_a_payload() -> None:
    found = mapped(UPRIGHT)
    assert found.axes[1].path == "payload" and found.axes[1].stop == pytest.approx(0.05)
    assert "gravity (0, 0, -9.81) m/s2 of the robot file" in caption_of_loads(found)
    row = int(np.argmax(found.axes[1].values >= 0.02))
    mass = float(found.axes[1].values[row])
    load = bs.Load(tip_force=[0.0, 0.0, -9.81 * mass])
    direct = bs.validity_map(UPRIGHT, ["tension=0:40 N:5"], load=load)
    assert found.value[LENGTHS][row, -1] == pytest.approx(direct.value[LENGTHS][-1], rel=1e-3)


def test_the_sentence_has_the_crossings_at_half_of_the_sweep(paper: Study) -> None:
    found = paper.load_map
    assert found is not None
    heading, sentence = load_text(found)
    assert heading == "Tip force"
    assert sentence.startswith(
        "with the tension at 40 N, half of the largest, "
        "the error stays within 1 % up to 0.257 N (from lengths), up to 0.066"
    )
    (text,) = paper.to_dict()["maps"]["text"]
    assert text == f"{heading} (dead, perpendicular to the bending plane), {sentence}."
    load = bs.Load(tip_force=0.257 * np.array(paper.model.across))
    error = bs.validity_map(ROBOT, ["tension=0:40 N:2"], load=load).value[LENGTHS][-1]
    assert error == pytest.approx(0.01, rel=0.01)


def test_ranges_of_a_tilt_may_be_several_or_none() -> None:
    heading, sentence = load_text(mapped(UPRIGHT, "tilt=0:180 deg:13", 60.0))
    assert heading == "Tilt of the base"
    first, rest = sentence.split(" (from lengths)")
    assert first.count(" to ") == 2 and first.endswith("to at least 180 deg")
    assert rest.endswith("deg (from force)")
    # nothing is beyond the end of the axis
    few = load_text(mapped(ROBOT, "tip_force.y=0:0.01 N", 20.0))[1]
    most = "up to at least 0.01 N"
    assert (
        few.partition("largest, ")[2]
        == f"the error stays within 1 % {most} (from lengths and from force)"
    )
    horizontal = ROBOT.with_({"gravity": "-9.81 0 0 m/s^2"})
    none = "1 % at no value from 0 to 50 g (from lengths and from force)"
    assert none in load_text(mapped(horizontal))[1]


def test_the_axis_of_a_study_is_any_load() -> None:
    found = bs.run_study(
        UPRIGHT, loading=Loading(20.0, 3), extras=bs.Extras(over="gravity.x=-2:2 m/s^2:5")
    )
    assert found.load_map is not None
    assert found.load_map.axes[1].path == "gravity.x"
    heading, _ = load_text(found.load_map)
    assert heading == "Gravity along x"
    values = found.to_dict()["maps"]["load"]
    assert values is not None and values["axes"][1]["values"] == [-2.0, -1.0, 0.0, 1.0, 2.0]
    assert "load_map" in [figure.stem for figure in found.figures]


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ("E=30:40 GPa", "axis segments.0.backbone.E is no load of this map"),
        ("tension=0:9 N", "axis tension is no load of this map"),
        ("payload=0:9 g", "axis payload: without gravity it changes nothing"),
        ("payload", "write PATH=from:to:n"),
    ],
)
def test_an_axis_that_is_no_load_is_refused(over: str, message: str) -> None:
    model = Model(ROBOT, 0, "cosserat")
    with pytest.raises(InputError, match=message):
        check_load_axis(ROBOT, model, over)
