"""Random robots, loads and what the Python package finds, for the page.

``python random_robots.py FILE`` writes them as JSON: ``robots`` has the text of each robot file,
its compiled form, the load and the tip; ``causes`` has robots with clamps, tensions, and the error
of constant curvature without each effect, as a study has it.
``implausible`` has robots with numbers in wrong units and the warnings, ``written`` robots as
``fit`` writes them with their laws, and ``laws`` the fields of all laws with their sizes in a robot
without them. ``study`` is the verdict of the built-in robot's study on its causes.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import bowstring as bs
from bowstring.calibration import Data, fit
from bowstring.robot.laws import LAWS
from bowstring.robot.plausibility import implausible
from bowstring.robot.writer import to_yaml
from bowstring.study.comparison import Model
from bowstring.study.verdict import shares_of

COUNT = 1000
WITH_CAUSES = 40
WRONG_UNITS = (
    ("E: 35 GPa", "E: 35 MPa"),
    ("E: 35 GPa", "E: 35 kPa"),
    ("E: 35 GPa", "E: 3.5 TPa"),
    ("diameter: 5 mm", "diameter: 40 mm"),
    ("diameter: 5 mm", "diameter: 50 um"),
    ("density: 1800 kg/m^3", "density: 30 g/cm^3"),
    ("density: 1800 kg/m^3", "density: 1.8 kg/m^3"),
    ("mass: 20 g", "mass: 2 kg"),
    ("mass: 20 g", "mass: 20 mg"),
    ("nu: 0.3", "G: 13 MPa"),
    ("segments:", "gravity: 0 0 -9810 m/s^2\nsegments:"),
    ("nu: 0.3", "nu: 0.3"),
)


def segment(rng: np.random.Generator, diameter: float) -> dict[str, Any]:
    """A segment of a random robot, as a robot file has it."""
    count = int(rng.integers(2, 9))
    length = rng.uniform(40, 160)
    pitch = diameter * rng.uniform(2, 5)
    tendons: Any = {"count": int(rng.integers(3, 5)), "pitch_radius": f"{pitch:.4f} mm"}
    if rng.random() < 0.5:
        tendons["first_angle"] = f"{rng.uniform(-180, 180):.3f} deg"
    else:
        angles = np.sort(rng.uniform(-180, 180, 3))
        tendons = [{"angle": f"{a:.3f} deg", "pitch_radius": f"{pitch:.4f} mm"} for a in angles]
    disks: dict[str, Any] = {
        "mass": f"{rng.uniform(0.1, 3):.3f} g",
        "radius": f"{6 * diameter:.4f} mm",
        "thickness": "1.5 mm",
        "clamped_length": f"{rng.choice([0.0, 1.5])} mm",
    }
    if rng.random() < 0.5:
        disks["count"] = count
    else:
        shares = np.cumsum(rng.uniform(0.6, 1.4, count))
        places = [f"{x:.4f}" for x in shares[:-1] / shares[-1] * length] + [f"{length:.4f}"]
        disks["positions"] = " ".join(places) + " mm"
    backbone: dict[str, Any] = {
        "diameter": f"{diameter:.3f} mm",
        "E": f"{rng.uniform(30, 80):.3f} GPa",
        "density": "6450 kg/m^3",
        **({"nu": 0.3} if rng.random() < 0.5 else {"G": "20 GPa"}),
    }
    if rng.random() < 0.3:
        backbone["inner_diameter"] = f"{0.6 * diameter:.3f} mm"
    return {
        "length": f"{length:.4f} mm",
        "backbone": backbone,
        "disks": disks,
        "tendons": tendons,
    }


def case(rng: np.random.Generator, folder: Path) -> dict[str, Any]:
    """A random robot, a load that it holds, and its tip by the Python package."""
    diameter = rng.uniform(0.8, 1.6)
    content = {
        "name": "random",
        "gravity": f"0 {rng.uniform(-3, 3):.3f} {rng.choice([-9.8, 9.8])} m/s^2",
        "segments": [segment(rng, diameter) for _ in range(int(rng.integers(1, 4)))],
    }
    if rng.random() < 0.3:
        content["payloads"] = [{"mass": "2 g", "centre": "1 0 5 mm"}]
    path = folder / "robot.yaml"
    path.write_text(json.dumps(content))
    robot = bs.load_robot(path)
    most = np.array([t["max_tension_N"] for t in bs.compile_robot(robot)["tendons"]])
    tensions = most * rng.uniform(0, 0.2, len(most)) * (rng.random(len(most)) < 0.6)
    force = rng.uniform(-0.02, 0.02, 3)
    found = bs.solve(robot, tensions, load=bs.Load(tip_force=force))
    return {
        "file": json.dumps(content),
        "compiled": json.dumps(bs.compile_robot(robot)),
        "length": robot.length,
        "tensions": tensions.tolist(),
        "gravity": list(robot.gravity),
        "force": force.tolist(),
        "tip": None if found.tip is None else found.tip.position.tolist(),
    }


def with_causes(rng: np.random.Generator, folder: Path) -> dict[str, Any]:
    """A random robot with clamps, its tensions, and the causes of the error by a study."""
    segments = [segment(rng, rng.uniform(0.8, 1.6)) for _ in range(int(rng.integers(1, 3)))]
    for each in segments:
        each["disks"] |= {"clamped_length": "3 mm"}
        if rng.random() < 0.5:
            each["disks"] |= {"hole_length": "2 mm"}
    gravity = rng.choice(["0 0 0 m/s^2", "0 0 -9.8 m/s^2", "0 2 9.8 m/s^2"])
    content = {"name": "clamped", "gravity": gravity, "segments": segments}
    path = folder / "clamped.yaml"
    path.write_text(json.dumps(content))
    robot = bs.load_robot(path)
    most = np.array([t["max_tension_N"] for t in bs.compile_robot(robot)["tendons"]])
    tension = 0.2 * float(most.min())
    shares = rng.uniform(0, 1, len(most)) * (rng.random(len(most)) < 0.3)
    shares[0] = 1.0
    model = Model(robot, 0, "cosserat", list(shares))
    found = shares_of(model, "cc_from_force", tension)
    return {
        "file": json.dumps(content),
        "length": robot.length,
        "tensions": (tension * shares).tolist(),
        "gravity": list(robot.gravity),
        "without": {s.effect: s.error_without for s in found},
        "shares": {s.effect: s.share for s in found},
    }


def with_wrong_unit(was: str, now: str, folder: Path) -> dict[str, Any]:
    """A robot file with a number in a wrong unit, and the warnings that the page has, too."""
    built_in = Path(bs.__file__).parent / "robot" / "builtin" / "amouri2019.yaml"
    text = built_in.read_text()
    if was not in text:
        raise ValueError(f"the built-in robot has no {was!r}")
    path = folder / "unit.yaml"
    path.write_text(text.replace(was, now, 1))
    # the page does not look for buckling, which it shows
    warnings = [w for w in implausible(bs.load_robot(path)) if "buckles" not in w]
    return {"file": path.read_text(), "warnings": warnings}


def fits(rng: np.random.Generator) -> list[bs.Robot]:
    """Robots of fits to noisy tips under tendon displacements, one for each kind of parameter."""
    ring = "segments.0.tendons"
    elastic = {f"{ring}.compliance": "0.05 mm/N", f"{ring}.pretension": "5 N"}
    robot = bs.load_robot("amouri2019", elastic)
    found = bs.sweep(robot, rng.uniform(5, 60, (16, 3)))
    points = found.tip_position + rng.normal(0, 3e-4, (16, 3))
    data = Data(points=points, displacements=found.displacements())
    backlash = robot.with_({f"{ring}.backlash": "0.2 mm"})
    return [
        fit(robot, data, ["segments.0.backbone.E"]).robot,
        fit(robot, data, ["gain", "offset"]).robot,
        fit(robot, data, [f"{ring}.friction"]).robot,
        fit(backlash, data, ["segments.0.backbone.E"]).robot,
        fit(robot, data, ["hole_clearance"]).robot,
        fit(robot, data, ["mount_compliance"]).robot,
        fit(robot, data, ["segments.0.backbone.hysteresis"]).robot,
    ]


def study_of(tension: float) -> dict[str, Any]:
    """Causes of the built-in robot's error at a tension of tendon 1 (N), as a study says."""
    found = shares_of(
        Model(bs.load_robot("amouri2019"), 0, "cosserat", [1, 0, 0]), "cc_from_force", tension
    )
    return {"tension": tension, "without": {s.effect: s.error_without for s in found}}


if __name__ == "__main__":
    generator = np.random.default_rng(23)
    with tempfile.TemporaryDirectory() as folder:
        robots = [case(generator, Path(folder)) for _ in range(COUNT)]
        causes = [with_causes(generator, Path(folder)) for _ in range(WITH_CAUSES)]
        wrong_units = [with_wrong_unit(was, now, Path(folder)) for was, now in WRONG_UNITS]
    found = {
        "robots": robots,
        "causes": causes,
        "implausible": wrong_units,
        "written": [
            {"file": to_yaml(robot), "laws": list(robot.laws)}
            for robot in [bs.load_robot("amouri2019"), bs.load_robot("rao2021"), *fits(generator)]
        ],
        "laws": {size: law.none for law in LAWS.values() for size in law.sizes},
        "study": study_of(60.0),
    }
    Path(sys.argv[1]).write_text(json.dumps(found))
