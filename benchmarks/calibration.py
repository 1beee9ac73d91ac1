"""Calibration on a measured robot with three segments: what each effect buys, and what is left.

    python -m benchmarks.calibration [--quick]

Data: `crl-ftdcr-mocap`, measured by others (docs/calibration.md), in `BOWSTRING_DATA` or
../shared/data. Every parameter is fitted on train alone. Between models only cross-validation
inside train decides: five blocks of neighbouring families of patterns, each predicted by a fit
that never saw it. Val is predicted once by each of the final models, nothing aligned any more. All
rows are one path in the order of the recording; of rows that are predicted only commands and times
are used.
--quick leaves the ablation out. On one core the whole takes about 40 minutes.
"""

from __future__ import annotations

import csv
import os
import sys
import time
from pathlib import Path

import numpy as np

import bowstring as bs
from bowstring.fit import Data, Fit, cross_validate, fit, score

DATA = Path(os.environ.get("BOWSTRING_DATA", Path(__file__).parents[2] / "shared" / "data"))
FOLDER = DATA / "crl-ftdcr-mocap"
MM = 1e3

ROBOT = bs.load_robot("crl-ftdcr-v4")
ELASTIC = ROBOT.with_({f"segments.{i}.tendons.compliance": 1e-4 for i in range(3)})
START = {"tool.z": 0.008}

PCC = ["hole_angle.segments", "bend_gain.segments", "base", "tool.z"]
FRAMES = ["base", "tool"]
GIVE = ["segments.*.tendons.compliance"]
GIVE_EACH = [f"segments.{i}.tendons.compliance" for i in range(3)]
#: The model that cross-validation chose.
CHOSEN = [*FRAMES, *GIVE, "gain.tendons", "offset.tendons", "backlash"]
#: Eight parameters, for the time that they take.
EIGHT = ["base", "tool.z", *GIVE]

#: Each row adds to a model above it: what was the best so far, or a rival of the row before.
ABLATION: dict[str, list[str]] = {
    "frames alone, inextensible tendons": FRAMES,
    "+ compliance": [*FRAMES, *GIVE],
    "+ gain by segment": [*FRAMES, *GIVE, "gain.segments"],
    "+ offset by tendon": [*FRAMES, *GIVE, "gain.segments", "offset.tendons"],
    "+ gain by tendon, not by segment": [*FRAMES, *GIVE, "gain.tendons", "offset.tendons"],
    "+ backlash": CHOSEN,
    "with delay instead of backlash": [*CHOSEN[:-1], "delay"],
    "with delay and backlash": [*CHOSEN, "delay"],
    "chosen + angles of holes": [*CHOSEN, "hole_angle.segments.1", "hole_angle.segments.2"],
    "chosen + E by segment": [*CHOSEN, "segments.1.backbone.E", "segments.2.backbone.E"],
    "chosen + compliance by segment": [*FRAMES, *GIVE_EACH, *CHOSEN[3:]],
    "chosen + gravity": [*CHOSEN, "gravity.0", "gravity.1", "gravity.2"],
}


def read(name: str) -> Data:
    """Rows of a file in SI; columns of servos stand in the order of the tendons."""
    with (FOLDER / f"ftdcr_v4_{name}.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    servos = [column for column in rows[0] if column.startswith("servo_")]
    time_s = np.array([float(row["timestamp"]) for row in rows])
    return Data(
        points=1e-3 * np.array([[float(row[f"tip_{axis}"]) for axis in "xyz"] for row in rows]),
        pulls=1e-3 * np.array([[float(row[servo]) for servo in servos] for row in rows]),
        group=np.array([family(row["pattern_label"]) for row in rows]),
        time=time_s - 1778538602.0,
    )


def family(label: str) -> str:
    """`rep1_pair12_same_dir60_hold` is of the family pair12_same."""
    name = label.removesuffix("_hold").removeprefix("rep1_")
    return "one tendon" if name.startswith("tendon") else name.rpartition("_")[0]


def floor(data: Data) -> None:
    """How far apart tips are that the same nine pulls led to, at other times."""
    pulls, tips = MM * np.asarray(data.pulls), MM * np.asarray(data.points)
    apart = np.linalg.norm(pulls[:, None] - pulls, axis=-1)
    later = np.asarray(data.time)[:, None] - np.asarray(data.time) > 2.0
    i, j = np.nonzero((apart < 0.2) & later)
    distance = np.linalg.norm(tips[i] - tips[j], axis=1)
    way = np.gradient(pulls, axis=0)
    size = np.linalg.norm(way, axis=1) + 1e-9
    same = (way[i] * way[j]).sum(axis=1) / (size[i] * size[j])
    print("\nTips of rows whose nine pulls agree to 0.2 mm in all, more than 2 s apart (train)")
    for name, which in [
        ("all pairs", same > -2),
        ("moving the same way", same > 0.7),
        ("moving opposite ways", same < -0.7),
    ]:
        rms = np.sqrt(np.mean(distance[which] ** 2))
        print(
            f"  {name}: {which.sum()} pairs, {rms:.2f} mm RMS apart; a model that knows the pulls "
            f"alone has {rms / 2:.2f} mm RMSE on them at least"
        )


def ablation(train: Data) -> None:
    print("\nAblation: five-fold cross-validation inside train, RMSE and mean in mm")
    for name, parameters in ABLATION.items():
        began = time.perf_counter()
        robot = ROBOT if parameters is FRAMES else ELASTIC
        found = cross_validate(robot, train, parameters, folds=5, start=START, loss="linear")
        error = MM * np.linalg.norm(found.residuals, axis=1)
        taut = np.asarray(train.group) != "one tendon"
        print(
            f"  {name:36s} {MM * found.score.rmse:6.2f} {MM * found.score.mean:6.2f}"
            f"   without one-tendon rows {np.sqrt(np.mean(error[taut] ** 2)):6.2f}"
            f"   folds {' '.join(f'{MM * fold.rmse:5.2f}' for fold in found.folds)}"
            f"   {time.perf_counter() - began:4.0f} s",
            flush=True,
        )


def by_family(found: Fit, data: Data, rows: np.ndarray) -> None:
    error = MM * (found.predict(data) - np.asarray(data.points))
    group = np.asarray(data.group)
    for name in dict.fromkeys(group[rows]):
        e = error[rows & (group == name)]
        print(
            f"    {name:12s} {len(e):4d} rows  RMSE {np.sqrt((e**2).sum(1).mean()):6.2f}"
            f"  mean error vector ({', '.join(f'{v:+.1f}' for v in e.mean(axis=0))})"
        )
    way = np.gradient(np.asarray(data.points), axis=0)
    way = way / (np.linalg.norm(way, axis=1, keepdims=True) + 1e-9)
    along = (error * way).sum(axis=1)[rows]
    print(f"    along the motion {along.mean():+.2f} mm in the mean (behind is negative)")


def main() -> None:
    train, every = read("train"), read("keypoints")
    val = np.arange(len(every.points)) >= len(train.points)
    assert np.array_equal(np.asarray(every.points)[~val], train.points)
    floor(train)
    if "--quick" not in sys.argv:
        ablation(train)
    print("\nFitted on all of train, val predicted once")
    finals = {
        "PCC with gains": (ROBOT, PCC, "arc"),
        "physics, eight parameters": (ELASTIC, EIGHT, "rod"),
        "physics, chosen": (ELASTIC, CHOSEN, "rod"),
    }
    for name, (robot, parameters, model) in finals.items():
        began = time.perf_counter()
        found = fit(robot, train, parameters, model=model, start=START, loss="linear")
        spent = time.perf_counter() - began
        predicted = found.predict(every)
        print(f"\n  {name}: {len(found.estimates)} parameters, {spent:.1f} s")
        print(f"    {found.message}")
        print(f"    train: {found.score}")
        print(f"    val:   {score(predicted[val], np.asarray(every.points)[val])}")
        by_family(found, every, ~val)
        by_family(found, every, val)
        for estimate in found.estimates:
            print(f"      {estimate}")


if __name__ == "__main__":
    main()
