"""Calibration on a measured robot with three segments: effect of each part of the model.

    python -m benchmarks.calibration [--quick]

Data: `crl-ftdcr-mocap`, measured by others (docs/verification/calibration.md), in `BOWSTRING_DATA`
or ../shared/data. Every parameter is fitted on train only. Models are selected by cross-validation
inside train: five blocks of neighbouring families of patterns, each predicted by a fit without it.
Val is predicted once by each of the final models, which are those of the suite (`bowstring suite`)
and one more, without further alignment. All rows are one path in the order of the recording, while
val is a path of its own in the suite; of predicted rows only commands and times are used. --quick
skips all but the final fits. On one core the whole takes about two hours."""

from __future__ import annotations

import csv
import os
import sys
import time
from pathlib import Path
from typing import Literal

import numpy as np

import bowstring as bs
from bowstring.calibration.cross_validation import cross_validate
from bowstring.calibration.fitting import Fit, fit
from bowstring.calibration.observations import Data, commands, score
from bowstring.calibration.parameters import Unknowns
from bowstring.calibration.priors import default_priors, with_priors
from bowstring.calibration.tip_model import TipModel
from bowstring.errors import InputError
from bowstring.statics import actuation
from bowstring.suite import built_in_sets, read_set

DATA = Path(os.environ.get("BOWSTRING_DATA", Path(__file__).parents[2] / "shared" / "data"))
FOLDER = DATA / "crl-ftdcr-mocap"
MM = 1e3

SET = read_set(next(each for each in built_in_sets() if each.name == "crl-ftdcr-mocap"))
_MODELS = {model.name: list(model.parameters) for model in SET.protocol.models}
assert SET.robot is not None
ROBOT = SET.robot
ELASTIC = ROBOT.with_({f"segments.{i}.tendons.compliance": 1e-4 for i in range(3)})
START = {"tool.z": 0.008}

PCC = _MODELS["cc calibrated"]
#: Eight parameters, to measure the time of a fit.
EIGHT = _MODELS["rod, eight parameters"]
#: The model that cross-validation chose, and two without its last effects.
CHOSEN = _MODELS["rod calibrated"]
WITHOUT = CHOSEN[: CHOSEN.index("backlash") + 1]
GRAVITY = CHOSEN[: CHOSEN.index("gravity.2") + 1]
FRAMES = ["base", "tool"]
GIVE = ["segments.*.tendons.compliance"]
GIVE_EACH = [f"segments.{i}.tendons.compliance" for i in range(3)]

#: Each row adds an effect to a model above it: to the best so far, or to an alternative of it.
ABLATION: dict[str, list[str]] = {
    "frames alone, inextensible tendons": FRAMES,
    "+ compliance": [*FRAMES, *GIVE],
    "+ gain by segment": [*FRAMES, *GIVE, "gain.segments"],
    "+ offset by tendon": [*FRAMES, *GIVE, "gain.segments", "offset.tendons"],
    "+ gain by tendon, not by segment": [*FRAMES, *GIVE, "gain.tendons", "offset.tendons"],
    "+ backlash": WITHOUT,
    "  backlash by segment": [*WITHOUT[:-1], "backlash.segments"],
    "  delay instead of backlash": [*WITHOUT[:-1], "delay"],
    "  delay and backlash": [*WITHOUT, "delay"],
    "  and angles of holes": [*WITHOUT, "hole_angle.segments.1", "hole_angle.segments.2"],
    "  and E by segment": [*WITHOUT, "segments.1.backbone.E", "segments.2.backbone.E"],
    "  and compliance by segment": [*FRAMES, *GIVE_EACH, *WITHOUT[3:]],
    "+ gravity": GRAVITY,
    "+ clearance in the holes": [*GRAVITY, "hole_clearance"],
    "+ compliance of the mount": [*GRAVITY, "hole_clearance", "mount_compliance"],
    "+ twist of the outer segment": CHOSEN,
}
ROD = bs.RodModel()
FINALS: dict[str, tuple[bs.Robot, list[str], bs.RodModel | Literal["arc"]]] = {
    "PCC with gains": (ROBOT, PCC, "arc"),
    "physics, eight parameters": (ELASTIC, EIGHT, ROD),
    "physics without gravity": (ELASTIC, WITHOUT, ROD),
    "physics without clearance": (ELASTIC, GRAVITY, ROD),
    "physics, chosen": (ELASTIC, CHOSEN, ROD),
}


def read(name: str) -> Data:
    """Return the rows of a file in SI units, with columns of servos in the order of the tendons."""
    with (FOLDER / f"ftdcr_v4_{name}.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    servos = [column for column in rows[0] if column.startswith("servo_")]
    time_s = np.array([float(row["timestamp"]) for row in rows])
    return Data(
        points=1e-3 * np.array([[float(row[f"tip_{axis}"]) for axis in "xyz"] for row in rows]),
        displacements=1e-3 * np.array([[float(row[servo]) for servo in servos] for row in rows]),
        group=np.array([family(row["pattern_label"]) for row in rows]),
        time=time_s - 1778538602.0,
    )


def family(label: str) -> str:
    """`rep1_pair12_same_dir60_hold` is of the family pair12_same."""
    name = label.removesuffix("_hold").removeprefix("rep1_")
    return "one tendon" if name.startswith("tendon") else name.rpartition("_")[0]


def floor(data: Data) -> None:
    """Print the distance of tips measured under the same nine displacements at different times."""
    displacements, tips = MM * np.asarray(data.displacements), MM * np.asarray(data.points)
    apart = np.linalg.norm(displacements[:, None] - displacements, axis=-1)
    later = np.asarray(data.time)[:, None] - np.asarray(data.time) > 2.0
    i, j = np.nonzero((apart < 0.2) & later)
    distance = np.linalg.norm(tips[i] - tips[j], axis=1)
    way = np.gradient(displacements, axis=0)
    size = np.linalg.norm(way, axis=1) + 1e-9
    same = (way[i] * way[j]).sum(axis=1) / (size[i] * size[j])
    print(
        "\nTips of rows whose nine displacements agree to 0.2 mm in all, more than 2 s apart "
        "(train)"
    )
    for name, which in [
        ("all pairs", same > -2),
        ("moving the same way", same > 0.7),
        ("moving opposite ways", same < -0.7),
    ]:
        rms = np.sqrt(np.mean(distance[which] ** 2))
        print(
            f"  {name}: {which.sum()} pairs, {rms:.2f} mm RMS apart; a model that knows the "
            f"displacements alone has {rms / 2:.2f} mm RMSE on them at least"
        )


def slack_pose(data: Data) -> None:
    """Print tip positions with all nine tendons lengthened; an elastic rod would have one pose."""
    rest = MM * np.asarray(data.points)[(MM * np.asarray(data.displacements) < -0.5).all(axis=1)]
    spread = np.sqrt(((rest - rest.mean(axis=0)) ** 2).sum(axis=1).mean())
    print(
        f"\nAll nine tendons lengthened by more than 0.5 mm: {len(rest)} rows (train), tips "
        f"{spread:.1f} mm RMS about their mean, x from {rest[:, 0].min():.1f} to "
        f"{rest[:, 0].max():.1f} mm, y from {rest[:, 1].min():.1f} to {rest[:, 1].max():.1f} mm"
    )


def ablation(train: Data) -> None:
    print("\nAblation: five-fold cross-validation inside train, RMSE and mean in mm")
    for name, parameters in ABLATION.items():
        began = time.perf_counter()
        robot = ROBOT if parameters is FRAMES else ELASTIC
        whole = fit(robot, train, parameters, start=START, loss="linear")
        found = cross_validate(whole, train, folds=5)
        error = MM * np.linalg.norm(found.residuals, axis=1)
        taut = np.asarray(train.group) != "one tendon"
        print(
            f"  {name:36s} {MM * found.score.rmse:6.2f} {MM * found.score.mean:6.2f}"
            f"   without one-tendon rows {np.sqrt(np.mean(error[taut] ** 2)):6.2f}"
            f"   folds {' '.join(f'{MM * fold.rmse:5.2f}' for fold in found.folds)}"
            f"   {time.perf_counter() - began:4.0f} s",
            flush=True,
        )


def everywhere(fields: dict[str, float]) -> bs.Robot:
    """Return the elastic robot with fields of each segment changed."""
    return ELASTIC.with_({f"segments.{i}.{k}": v for k, v in fields.items() for i in range(3)})


def one_memory(train: Data, every: Data, val: np.ndarray) -> None:
    """Time and RMSE of fits of one memory beside the eight parameters; val continues train."""
    memories: dict[str, tuple[dict[str, float], list[str]]] = {
        "none": ({}, []),
        "backlash": ({}, ["backlash"]),
        "hysteresis": (
            {"backbone.hysteresis": 0.3, "backbone.hysteresis_play": 0.05},
            ["segments.*.backbone.hysteresis", "segments.*.backbone.hysteresis_play"],
        ),
        "relaxation": (
            {"backbone.relaxation": 0.3, "backbone.relaxation_time": 3},
            ["segments.*.backbone.relaxation", "segments.*.backbone.relaxation_time"],
        ),
        "friction": ({"tendons.friction": 0.05}, ["segments.*.tendons.friction"]),
        "wrap angle, friction 0.01": (
            {"tendons.friction": 0.01, "tendons.wrap_angle": 5},
            ["segments.*.tendons.wrap_angle"],
        ),
    }
    print("\nOne memory beside the eight parameters: RMSE in mm, and time of the fit")
    for name, (fields, parameters) in memories.items():
        began = time.perf_counter()
        found = fit(everywhere(fields), train, [*EIGHT, *parameters], start=START, loss="linear")
        spent = time.perf_counter() - began
        reached = score(found.predict(every)[val], np.asarray(every.points)[val])
        own = ", ".join(str(each) for each in found.estimates if each.name in parameters)
        print(
            f"  {name:26s} train {MM * found.score.rmse:.2f}, val {MM * reached.rmse:.2f},"
            f" {spent:.0f} s; {own}",
            flush=True,
        )


def friction(train: Data, val: Data) -> None:
    """RMSE with friction at the holes or before the base hole, other parameters refitted.

    Derivatives with friction are not exact, but those without it are descent directions that are
    good enough to see whether friction reduces the error. The best of a few steps counts. Rows of
    each table are one path.
    """
    print("\nFriction: RMSE in mm on train, where the rest is fitted again, and on val")
    models = {
        "without gravity": (WITHOUT, [(0.0, 0.0), (0.02, 0.0), (0.05, 0.0), (0.1, 0.0)]),
        "chosen": (CHOSEN, [(0.0, 0.0), (0.05, 0.0), (0.01, 5.0), (0.01, 15.0), (0.01, 30.0)]),
    }
    same = np.asarray(val.group) == "all3_same"
    for model, (parameters, cases) in models.items():
        start = np.array(
            list(fit(ELASTIC, train, parameters, start=START, loss="linear").values.values())
        )
        for mu, wrap in cases:
            robot = everywhere({"tendons.friction": mu, "tendons.wrap_angle": wrap})
            values, reached = _refitted(robot, train, parameters, start)
            other = TipModel(Unknowns(robot, parameters, START), commands(val, robot), ROD)
            predicted = other.predict(values).point
            on_val = score(predicted, np.asarray(val.points)).rmse
            on_same = score(predicted[same], np.asarray(val.points)[same]).rmse
            print(
                f"  {model}, friction {mu:.2f}, wrap angle {wrap:2.0f} rad: "
                f"train {MM * reached:.3f}, val {MM * on_val:.3f}, "
                f"all segments bent the same way {MM * on_same:.3f}",
                flush=True,
            )


def _refitted(
    robot: bs.Robot, train: Data, parameters: list[str], values: np.ndarray
) -> tuple[np.ndarray, float]:
    """Parameters of a robot with friction and their RMSE in m, from those without friction."""
    plain = TipModel(Unknowns(ELASTIC, parameters, START), commands(train, ELASTIC), ROD)
    with_friction = TipModel(Unknowns(robot, parameters, START), plain.commands, ROD)
    step = np.array([item.step for item in plain.unknowns.items])
    low = np.array([item.low for item in plain.unknowns.items])
    best, reached = values, np.inf
    for _ in range(6):
        point = with_friction.predict(values).point
        rmse = score(point, np.asarray(train.points)).rmse
        if not rmse < reached:
            break
        best, reached = values, rmse
        error = np.nan_to_num(point - np.asarray(train.points))  # unsolved rows have no part
        at = plain.predict(values, keep=True)
        jacobian = plain.jacobian(values, at).reshape(error.size, -1) * step
        values = values - step * np.linalg.lstsq(jacobian, error.ravel(), rcond=None)[0]
        values = np.maximum(values, low)
    return best, reached


def cost_of_memories(train: Data) -> None:
    """Processor time of a row of train along its path, beside that without a memory."""
    fields: dict[str, dict[str, float]] = {
        "none": {},
        "backlash 0.05 mm": {"tendons.backlash": 5e-5},
        "friction 0.01": {"tendons.friction": 0.01},
        "friction 0.15": {"tendons.friction": 0.15},
        "friction 0.01, wrap angle 15 rad": {"tendons.friction": 0.01, "tendons.wrap_angle": 15},
        "friction 0.2, wrap angle 3 rad": {"tendons.friction": 0.2, "tendons.wrap_angle": 3},
        "hysteresis": {"backbone.hysteresis": 0.3, "backbone.hysteresis_play": 0.05},
        "relaxation": {"backbone.relaxation": 0.3, "backbone.relaxation_time": 30},
        "creep": {"tendons.creep_compliance": 3e-5, "tendons.creep_time": 30},
    }
    spent: dict[str, list[float]] = {name: [] for name in fields}
    solved = {}
    for _ in range(9):
        for name, given in fields.items():
            robot = everywhere(given)
            path, rows = actuation.Path(robot, ROD.replace(elements=1)), commands(train, robot)
            late = rows.durations(np.arange(len(rows))) if robot.is_viscoelastic else None
            begin = time.process_time()
            at = path.core.follow(rows.by_displacement, rows.values, bs.Load(), False, None, late)
            spent[name].append(1e3 * (time.process_time() - begin) / len(rows))
            solved[name] = at["converged"].mean()
    print("\nCost of a memory: processor time of a row along the path of train")
    for name, times in spent.items():
        ratio = float(np.median(np.divide(times, spent["none"])))
        print(
            f"  {name:34s} {np.median(times):.2f} ms, {ratio:.1f} times that without; "
            f"{100 * solved[name]:.1f} % of rows solved"
        )


def one_tendon(train: Data) -> None:
    """Rows in which eight tendons are slack, predicted by fits without them."""
    slack = np.asarray(train.group) == "one tendon"
    print("\nOne-tendon rows of train, predicted by a fit to the other rows of train")
    for name, (robot, parameters, model) in FINALS.items():
        found = fit(robot, train, parameters, model=model, start=START, loss="linear", rows=~slack)
        print(f"  {name}: {score(found.predict(train)[slack], np.asarray(train.points)[slack])}")


def few_rows(train: Data, every: Data, val: np.ndarray) -> None:
    """Errors on val of fits to few rows of train, with and without the default priors."""
    place = np.arange(len(np.asarray(train.points)))
    chosen = {
        "all rows": place >= 0,
        "every 40th row": place % 40 == 20,
        "every 80th row": place % 80 == 20,
        "one-tendon rows": np.asarray(train.group) == "one tendon",
    }
    print("\nDefault priors: RMSE in mm, eight parameters and those without gravity")
    for label, rows in chosen.items():
        known = with_priors(Unknowns(ELASTIC, WITHOUT).names, default_priors(ELASTIC, WITHOUT))
        for names, priors in ((EIGHT, None), (WITHOUT, None), (known, "default")):
            what = "eight parameters" if names is EIGHT else "without gravity"
            said = f"  {label}, {rows.sum()}; {what}, priors {priors}:"
            try:
                found = fit(ELASTIC, train, names, start=START, loss="linear", rows=rows)
            except InputError as error:  # fewer rows than parameters
                print(said, error)
                continue
            reached = score(found.predict(every)[val], np.asarray(every.points)[val])
            print(f"{said} train {MM * found.score.rmse:.2f}, val {MM * reached.rmse:.2f}")


def by_family(found: Fit, data: Data, rows: np.ndarray) -> None:
    """Errors by family, and the time by which predictions lead (regression on their speed)."""
    predicted = MM * found.predict(data)
    error = predicted - MM * np.asarray(data.points)
    gap = np.diff(np.asarray(data.time))
    speed = np.zeros_like(error)
    speed[1:] = np.where((gap < 1.2)[:, None], np.diff(predicted, axis=0) / gap[:, None], 0.0)
    group = np.asarray(data.group)
    for name in dict.fromkeys(group[rows]):
        here = rows & (group == name)
        e, v = error[here], speed[here]
        print(
            f"    {name:12s} {len(e):4d} rows  RMSE {np.sqrt((e**2).sum(1).mean()):6.2f}"
            f"  mean error vector ({', '.join(f'{x:+.1f}' for x in e.mean(axis=0))})"
            f"  leads by {(e * v).sum() / (v * v).sum():+.3f} s"
        )


def main() -> None:
    train, every = read("train"), read("keypoints")
    val = np.arange(len(every.points)) >= len(train.points)
    assert np.array_equal(np.asarray(every.points)[~val], train.points)
    floor(train)
    slack_pose(train)
    if "--quick" not in sys.argv:
        ablation(train)
        one_memory(train, every, val)
        friction(train, read("val"))
        cost_of_memories(train)
        one_tendon(train)
        few_rows(train, every, val)
    print("\nFitted on all of train, val predicted once")
    for name, (robot, parameters, model) in FINALS.items():
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
