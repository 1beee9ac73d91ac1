"""Wrong arguments of solvers: input and words of the message, in one table for each function."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.dynamics.load_history import Table, ramp, step
from bowstring.dynamics.modal import modes
from bowstring.dynamics.simulation import simulate
from objects import objects, refused

ROBOT = bs.load_robot("amouri2019")
NAN, INF = float("nan"), float("inf")
NUMBERS = ("duration", "dt", "every", "mass_damping", "material_damping")
NUMBERS += ("modal_damping", "spectral_radius")
OTHER = bs.solve(ROBOT.with_({"segments.0.tendons.friction": 0.2}), [10, 0, 0]).history()


def _motion(**given: Any) -> object:
    return simulate(**objects(**{"robot": ROBOT, "duration": 0.1, **given}))


#: Functions by name: how they are called with changed arguments.
FUNCTIONS: dict[str, Callable[..., object]] = {
    "solve": lambda **given: bs.solve(ROBOT, **objects(**{"tensions": [80, 0, 0], **given})),
    "solve by commands": lambda **given: bs.solve(ROBOT, **objects(**given)),
    "sweep": lambda **given: bs.sweep(ROBOT, **objects(**{"tensions": np.zeros((4, 3)), **given})),
    "solve_batch": lambda **given: bs.solve_batch(
        ROBOT, **objects(**{"tensions": np.zeros((4, 3)), **given})
    ),
    "sweep by commands": lambda **given: bs.sweep(ROBOT, **objects(**given)),
    "solve_batch by commands": lambda **given: bs.solve_batch(ROBOT, **objects(**given)),
    "inverse_kinematics": lambda **given: bs.inverse_kinematics(
        ROBOT, **{"position": [0.3, 0.0, 0.53], **given}
    ),
    "simulate": lambda **given: _motion(**{"tensions": [5, 0, 0], **given}),
    "simulate by commands": _motion,
    "modes": lambda **given: modes(**objects(**{"robot": ROBOT, **given})),
}

_ROWS = [
    ({"tensions": [80, 0, 0]}, "tensions has shape (3,), it must have one row for each load"),
    ({"tensions": [[80, 0]] * 4}, "tensions has shape (4, 2)"),
    ({"tensions": [[80, 0, 0], [1]]}, "tensions must be numbers of shape (n, 3)"),
    ({"tensions": "abc"}, "tensions must be numbers"),
    ({"tensions": [[0, 0, 0], [0, 0, -1]]}, "row 2: tension of tendon 3 is -1 N"),
    ({"tip_force": np.zeros((3, 3))}, "tip_force has shape (3, 3), it must be (3,) or (4, 3)"),
    ({"gravity": np.zeros((4, 3, 1))}, "it must be 3 numbers"),
    ({"gravity": [[0, 0, 0]] * 3 + [[0, NAN, 0]]}, "row 4: gravity is"),
]
_COMMANDED_ROWS = [
    ({"displacements": [0, 0, 0]}, "displacements has shape (3,)"),
    ({"displacements": [[0, 0, 0]], "tensions": [[np.nan] * 3] * 2}, "1 of displacements"),
    ({"displacements": [[0, 0, 0], [0, np.nan, 0]]}, "row 2: tendon 2 has no command"),
    ({"displacements": [[0, 0, 0], [0, 2, 0]]}, "row 2: displacement of tendon 2 is 2 m"),
    ({}, "tensions is None"),
]
ARGUMENTS: dict[str, list[tuple[dict[str, Any], str]]] = {
    "solve": [
        ({"tensions": [1, 2]}, "tensions has 2 numbers, it must have 3"),
        ({"tensions": []}, "tensions has 0 numbers"),
        ({"tensions": [1, -2, 3]}, "tension of tendon 2 is -2 N"),
        ({"tensions": [1, 2, NAN]}, "tension of tendon 3 is NaN N"),
        ({"tensions": [INF, 2, 3]}, "tension of tendon 1 is inf N"),
        ({"tensions": "80,0,0"}, "tensions is '80,0,0', it must be 3 numbers"),
        ({"tensions": 80}, "tensions is 80"),
        ({"tensions": [1, 2, "3"]}, "it must be 3 numbers"),
        ({"tensions": [[1, 2, 3]]}, "it must be 3 numbers"),
        ({"tensions": np.ones((2, 3))}, "it must be 3 numbers"),
        ({"tensions": np.ones(3, complex)}, "it must be 3 numbers"),
        ({"tensions": [10**400, 0, 0]}, "it must be 3 numbers"),
        (
            {"theory": "timoshenko"},
            'theory is \'timoshenko\', it must be "cosserat" or "kirchhoff"',
        ),
        ({"theory": 3}, "theory is 3"),
        ({"tendon_path": "curved"}, "tendon_path is 'curved'"),
        ({"tendon_path": 3}, "tendon_path is 3"),
        ({"twist": "no"}, "twist is 'no'"),
        ({"twist": 1}, "twist is 1, it must be True or False"),
        ({"elements": 3}, "elements is 3, it must be 1, 2, 4 or 8"),
        ({"elements": -1}, "elements is -1"),
        ({"elements": 2.0}, "elements is 2.0"),
        ({"elements": 10**30}, "elements is 1000"),
        ({"elements": True}, "elements is True"),
        ({"elements": "1"}, "elements is '1'"),
        ({"gravity": 9.81}, "gravity is 9.81, it must be 3 numbers, in m/s^2"),
        ({"gravity": (0, 0)}, "gravity has 2 numbers"),
        ({"gravity": (0, NAN, 0)}, "gravity is [0.0, NaN, 0.0] m/s^2"),
        ({"tip_force": (0, 0, INF)}, "tip force is"),
        ({"tip_moment": "0,0,0"}, "tip_moment is '0,0,0'"),
    ],
    "solve by commands": [
        ({"displacements": [0.01, None, 0]}, "tendon 2 has no command"),
        (
            {"displacements": [0.01, 0, 0], "tensions": [None, 1, None]},
            "tendon 2 has a tension and a displacement",
        ),
        (
            {"displacements": [0, 0, 0], "angles": [None, None, 1]},
            "tendon 3 has a displacement and an angle",
        ),
        ({"angles": [1, 1, 1]}, "tendon 1 of amouri2019 has no spool_radius"),
        (
            {"displacements": [1, 0, 0]},
            "displacement of tendon 1 is 1 m, it must be less than the tendon's length",
        ),
        ({"displacements": [np.inf, 0, 0]}, "displacement of tendon 1 is inf m"),
        ({"displacements": [0, 0]}, "displacements has 2 numbers, it must have 3, in m"),
        ({"displacements": [[0, 0, 0]]}, "displacements has shape (1, 3)"),
        ({"displacements": "all"}, "displacements must be numbers of shape (3,) in m"),
        ({"displacements": ["1", "2", "3"]}, "displacements must be numbers of shape (3,) in m"),
        ({"displacements": [None, 0, 0], "tensions": [-1, None, None]}, "a tendon can only pull"),
        ({"displacements": [0, 0, 0], "tendon_path": "continuous"}, "need straight spans"),
        ({"displacements": [0, 0, 0], "gravity": [1, 2]}, "gravity has 2 numbers"),
        ({"displacements": [0, 0, 0], "tip_force": "x"}, "tip_force is 'x'"),
    ],
    "sweep": _ROWS,
    "solve_batch": [*_ROWS, *(({"threads": n}, "threads is") for n in (-1, 1.5, "all", 10**9))],
    "sweep by commands": _COMMANDED_ROWS,
    "solve_batch by commands": _COMMANDED_ROWS,
    "inverse_kinematics": [
        ({"position": [0.1, 0.0]}, r"shape \(2,\)"),
        ({"position": [[[0.1, 0.0, 0.5]]]}, "shape"),
        ({"position": "here"}, "position is 'here'"),
        ({"position": [0.1, np.nan, 0.5]}, "finite"),
        ({"position": [[0.1, 0.0, 0.5], [0.1, np.inf, 0.5]]}, "row 2 of position"),
        ({"position": np.zeros((0, 3))}, "no rows"),
        ({"position": [100.0, 0.0, 300.0]}, "out of any reach"),
        ({"position": [[0.1, 0.0, 0.5], [0.0, 0.0, 0.7]]}, "row 2 of position is 700 mm"),
        ({"direction": [0.0, 0.0, 0.0]}, "must not be zero"),
        ({"direction": [[0.0, 0.0, 1.0]]}, "direction has shape"),
        ({"direction": [0.0, np.nan, 1.0]}, "finite"),
        ({"limits": bs.ActuationLimits(min_tension=-1.0)}, "0 N or more"),
        ({"limits": bs.ActuationLimits(max_tension=np.inf)}, "finite"),
        ({"limits": bs.ActuationLimits(max_tension=[1.0, 2.0])}, r"shape \(2,\)"),
        ({"limits": bs.ActuationLimits(5.0, 4.0)}, "must not be above"),
        ({"model": "physics"}, "constant_curvature"),
        ({"model": 3}, "RodModel"),
        ({"model": bs.RodModel(tendon_path="continuous")}, "needs derivatives"),
        ({"model": "constant_curvature", "load": bs.Load(tip_force=[0, 0, 1])}, "no loads"),
        ({"load": bs.Load([1.0, 0.0, 0.0])}, "has an actuation"),
        ({"load": 3}, "bowstring.Load"),
        ({"load": bs.Load(gravity=[0, 0, np.nan])}, "finite"),
        ({"load": bs.Load(gravity=[[0, 0, 1], [0, 0, 2]])}, "gravity"),
        ({"path": 1}, "True or False"),
        ({"distance_margin": -1e-3}, "distance_margin is -0.001"),
        ({"distance_margin": 1.0}, "share of the length"),
        ({"distance_margin": np.nan}, "distance_margin"),
        ({"distance_margin": "1 mm"}, "share of the length"),
    ],
    "simulate": [
        ({"duration": -1.0}, "duration is -1 s"),
        ({"duration": NAN}, "duration is nan s"),
        ({"tensions": [1.0]}, "tensions has shape"),
        ({"tensions": [1.0, -2.0, 0.0]}, "tendon 2 is -2 N"),
        ({"tensions": Table([0], [[1.0, 2.0]])}, "2 columns"),
        ({"tensions": "80 N"}, "tensions is '80 N'"),
        ({"dt": 0.0}, "dt is 0 s"),
        ({"dt": -1e-3}, "dt is -0.001 s"),
        ({"dt": 1e-3, "tolerance": 1e-6}, "dt or tolerance"),
        ({"every": 0.0}, "every is 0 s"),
        ({"points": 1}, "points is 1"),
        ({"mass_damping": -1.0}, "mass_damping is -1 1/s"),
        ({"modal_damping": 0.1, "mass_damping": 1.0}, "not both"),
        ({"spectral_radius": 2.0}, "spectral radius is 2"),
        ({"dt": 1e-9, "duration": 1e-6}, "below numerical resolution"),
        ({"dt": 1e-300}, "time step is 1e-300 s, it must be at least"),
        ({"duration": 1e12}, "more than 1000000 outputs"),
        ({"tolerance": 0.0}, "tolerance is 0 m"),
        ({"tolerance": True}, "tolerance is True"),
        ({"tolerance": "0.5 N"}, "tolerance is .0.5 N., it must be a length above 0"),
        ({"spectral_radius": None}, "spectral_radius is None"),
        ({"tip_force": [1.0, 2.0]}, "tip_force has shape"),
        ({"initial_tensions": [1.0]}, "start.load.tensions has shape"),
        ({"path": "no/such/folder/run.nc"}, "does not exist"),
        # booleans and text are rejected as numbers everywhere
        *(
            ({name: value}, f"{name} is {value!r}, it must be a finite number")
            for name in NUMBERS
            for value in (True, "1")
        ),
        ({"points": True}, "points is True"),
        ({"points": False}, "points is False"),
        ({"tensions": [5.0, True, 0]}, r"tensions is \[5.0, True, 0\], it must be 3 numbers in N"),
        ({"tensions": np.array([True, False, False])}, "it must be 3 numbers in N"),
        ({"tensions": ["5", "0", "0"]}, "tensions is .* it must be 3 numbers in N, a table"),
        ({"tip_force": [True, 0, 0]}, "tip_force is .* it must be 3 numbers"),
        ({"initial_tensions": (0, 0, True)}, "start.load.tensions is .* it must be 3 numbers"),
        ({"gravity": [True, False, False]}, "gravity is .* it must be 3 numbers in m/s"),
        ({"tensions": lambda t: [True, False, False]}, "returned .True, .* at 0 s, it must be 3 n"),
        ({"tensions": lambda t: "high"}, "returned 'high' at 0 s"),
        ({"tensions": lambda t: [10**400, 0, 0]}, "the function for tensions returned"),
        # of a wrong type or size
        ({"robot": "amouri2019"}, "robot is 'amouri2019', it must be a Robot"),
        ({"duration": 10**400}, "duration is inf s, it must be a finite number"),
        ({"tensions": [10**400, 0, 0]}, r"tensions is \[1000.* \.\.\., it must be 3 numbers"),
        ({"duration": 1e-9}, "duration is 1e-09 s, it must be 1e-06 s or more"),
        ({"duration": 1e-4, "every": 1e-10}, "every is 1e-10 s, it must be 1e-06 s or more"),
        ({"path": True}, "path is True, it must be the path of a file"),
        ({"progress": "bar"}, "progress is 'bar', it must be a function"),
    ],
    "simulate by commands": [
        ({}, "tensions is None, and so are displacements and angles"),
        (
            {"tensions": [1, 0, 0], "displacements": [0, 0, 0]},
            "tendon 1 has a tension and a displacement",
        ),
        ({"displacements": [0.01, None, 0]}, "tendon 2 has no command"),
        ({"displacements": [0.01, 0]}, "displacements is .* it must be 3 numbers in m"),
        ({"displacements": "20 mm"}, "displacements is '20 mm', it must be 3 numbers in m"),
        ({"displacements": [0, 0, math.inf]}, "all must be finite numbers"),
        ({"tensions": [-1, None, None], "displacements": [None, 0, 0]}, "a tendon can only pull"),
        ({"tensions": ramp([5, NAN, 0], 0.1)}, "all must be finite numbers"),
        ({"displacements": ramp([0.01, 0], 0.1)}, "the table for displacements has 2 columns"),
        (
            {"displacements": ramp([0.7, 0, 0], 0.1)},
            "0.7 m at 0.1 s, it must be less than the tendon's",
        ),
        (
            {"displacements": lambda t: [0.7 if t else 0, 0, 0]},
            "it must be less than the tendon's length, 0.641 m",
        ),
        ({"displacements": lambda t: [0, 0, NAN]}, "at 0 s: tendon 3 has no command"),
        ({"displacements": lambda t: [0, 0]}, r"returned shape \(2,\)"),
        (
            {"displacements": lambda t: [0, 0, 1 / 0]},
            "function for displacements failed at 0 s: ZeroDivision",
        ),
        (
            {
                "tensions": lambda t: [5, NAN, NAN] if t < 0.05 else [NAN, 5, NAN],
                "displacements": lambda t: [NAN, 0, 0] if t < 0.05 else [0, NAN, 0],
            },
            "tendon 1 changes between a tension and a displacement at 0.05",
        ),
        (
            {"displacements": step([0.01, -0.03, -0.03])},
            "jumps from 0 m to 0.01 m at 0 s, but the tendon is inextensible",
        ),
        (
            {"displacements": step([0, -0.01, 0], 0.05)},
            "tendon 2 jumps from 0 m to -0.01 m at 0.05 s",
        ),
        (
            {"displacements": [0, 0, 0], "initial_displacements": [0.01, 0, 0]},
            "jumps from 0.01 m to 0 m at 0 s",
        ),
        (
            {"displacements": [0, 0, 0], "initial_tensions": [1, 0, 0]},
            "starts with a tension but moves by",
        ),
        (
            {"tensions": [1, 0, 0], "initial_displacements": [0, 0, 0]},
            "starts with a displacement but moves by a",
        ),
        (
            {
                "tensions": [1, None, None],
                "displacements": [None, 0, 0],
                "initial_tensions": [1, None, None],
            },
            "tendon 2 has no start; give its tension",
        ),
        ({"angles": [1, 0, 0]}, "tendon 1 of amouri2019 has no spool_radius"),
        ({"displacements": [0, 0, 0], "tendon_path": "continuous"}, "need straight spans"),
        ({"displacements": [0, 0, 0], "initial_history": OTHER}, "or leave the history out"),
        ({"displacements": [0, 0, 0], "initial_history": [1]}, "this is no history"),
    ],
    "modes": [
        ({"robot": "amouri2019"}, "it must be a Robot"),
        ({"tensions": [True, True, True]}, "tensions must be numbers of shape"),
        ({"tip_force": ["1", "0", "0"]}, "tip_force is .* it must be 3 numbers"),
        ({"gravity": [True, False, False]}, "gravity is .* it must be 3 numbers"),
        ({"count": True}, "count is True, it must be a positive whole number"),
        ({"count": "6"}, "count is '6'"),
    ],
}


@pytest.mark.parametrize(
    ("function", "given", "says"),
    [(function, *row) for function, rows in ARGUMENTS.items() for row in rows],
)
def test_arguments(function: str, given: dict[str, Any], says: str, tmp_path: Path) -> None:
    if function == "simulate by commands":
        given = {**given, "path": tmp_path / "run.nc"}
    refused(says, lambda: FUNCTIONS[function](**given))
    late = any(callable(given.get(name)) for name in ("tensions", "displacements"))
    assert late or not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: bs.solve("amouri2019", [0, 0, 0]), "it must be a Robot"),
        (lambda: bs.sweep("amouri2019", [0, 0, 0]), "it must be a Robot"),
        (lambda: bs.solve_batch("amouri2019", [0, 0, 0]), "it must be a Robot"),
        (lambda: bs.solve(ROBOT, [8, 0, 0]).to_dataset(points=10**9), "points is 1000000000"),
        (lambda: bs.solve(ROBOT, [8, 0, 0]).to_dataset(points="x"), "points is 'x'"),
        (
            lambda: bs.solve(ROBOT, [8, 0, 0], load=bs.Load(tip_force=np.array([0, 0, 1j]))),
            "it must be 3 numbers, in N",
        ),
        (lambda: bs.solve(ROBOT, [True, False, False]), "it must be 3 numbers"),
        (lambda: bs.solve(ROBOT, np.array([True, False, False])), "it must be 3 numbers"),
        (lambda: bs.sweep(ROBOT, [["1", "2", "3"]]), "must be numbers of shape"),
        (lambda: bs.sweep(ROBOT, np.ones((2, 3), bool)), "must be numbers of shape"),
        (
            lambda: bs.sweep(ROBOT, np.ma.masked_array([[80.0, 5, 0]], mask=[[0, 1, 0]])),
            "tension of tendon 2 is NaN N, it must be finite",
        ),
        (lambda: bs.sweep(ROBOT, np.ones((2, 3)), warm="x"), "warm is 'x'"),
        (lambda: bs.solve_batch(ROBOT, np.ones((2, 3)), disks=None), "disks is None"),
        (lambda: bs.solve(ROBOT, load=[80, 0, 0]), "it must be a bowstring.Load"),
        (lambda: bs.solve(ROBOT, [80, 0, 0], model="kirchhoff"), "it must be a bowstring.RodModel"),
        (lambda: bs.solve(ROBOT, [80, 0, 0], load=bs.Load([1, 0, 0])), "give one of them"),
        (lambda: bs.simulate(ROBOT, [8, 0, 0], 0.05, start=bs.Start([1, 0, 0])), "start.load is"),
        (lambda: bs.simulate(ROBOT, [8, 0, 0], 0.05, output="run.nc"), "output is 'run.nc'"),
        (lambda: bs.run_study(ROBOT, loading={"points": 3}), "it must be a Loading"),
        (lambda: bs.run_study(ROBOT, loading=[]), "it must be a Loading"),
        (lambda: bs.run_study(ROBOT, extras="solid"), "it must be an Extras"),
        (lambda: bs.Ramp(modal_damping="x"), "modal_damping is 'x'"),
        (lambda: bs.Loading(tendon=[1, 2]), "the number of a tendon, or a mapping"),
        (
            lambda: bs.solve(ROBOT, [8, 0, 0], history=bs.solve(ROBOT, [8, 0, 0]).history),
            "give what the method history",
        ),
        (lambda: Table([0, True], [[0], [1]]), "takes numbers"),
        (lambda: Table([0, 1], [[0], [True]]), "takes numbers"),
        (lambda: Table(["a"], [[0]]), "takes numbers"),
        (lambda: Table(["0", "1"], [[0], [1]]), "takes numbers"),
        (lambda: Table([0], [[10**400]]), "takes numbers"),
        *(
            (partial(bs.solve(ROBOT, [0, 0, 0]).centerline, points), "points_per_module is")
            for points in (0, -1, 2.5, "8", 10**9, 10**40)
        ),
        # tables of commands
        (lambda: Table([0, 1, 0.5], [[0], [1], [2]]), "must not decrease"),
        (lambda: Table([0, 0, 0], [[0], [1], [2]]), "three times"),
        (
            lambda: Table([0, 0.3, 0.1 + 0.2], [[0], [1], [2]]),
            "5.6e-17 s apart in rows 2 and 3 .* for a jump",
        ),
        (lambda: Table([0, NAN], [[0], [1]]), "not finite in row 2"),
        (lambda: Table([0, 1], [[0], [INF]]), "not finite in row 2$"),
        (
            lambda: Table([0, 1], [[0], [NAN]]),
            "row 2; a tendon with a command of another kind has NaN in all",
        ),
        (lambda: Table([0, 1], [[0]]), "2 times but 1 rows"),
        (lambda: Table([], []), "shapes"),
        (lambda: ramp([True, False, False], 1.0), "values of a ramp are"),
        (lambda: ramp([80, 0, 0], True), "rise is True"),
        (lambda: ramp([80, 0, 0], 1.0, start="x"), "start is 'x', it must be a finite number"),
        (lambda: step([80, 0, 0], start=NAN), "start is nan s"),
        (lambda: step([80, 0, 0], start=-1), "start is -1 s, it must be zero or more"),
        (lambda: simulate(ROBOT, [5, 0, 0], 0.02).tip_at("now"), "times is 'now'"),
        (lambda: simulate(ROBOT, [5, 0, 0], 0.02).tip_at([[0.01]]), r"times has shape \(1, 1\)"),
    ],
)
def test_calls(call: Callable[[], object], says: str) -> None:
    refused(says, call)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda h: None if h.clear() else h, "this is no history"),
        (lambda h: 3, "this is no history"),
        (lambda h: h.update(robot_hash="0"), "is of another robot (amouri2019)"),
        (lambda h: h.update(schema_version=99), "schema_version 99"),
        (lambda h: h.update(theory="kirchhoff"), "made with theory 'kirchhoff'"),
        (lambda h: h.pop("arcs_rad"), "the history is damaged: it has no arcs_rad"),
        (lambda h: h.update(creep_m="x"), "damaged: creep_m must be rows of numbers"),
        (lambda h: h.update(tip_error_m=-1.0), "damaged: tip_error_m"),
        (lambda h: h.update(slips=[[0, 0, 0]]), "the history is damaged"),
        (lambda h: h.update(arcs_rad=[[0, 0]]), "the history is damaged"),
        (lambda h: h.update(tensions_N=[1, 2]), "the history is damaged"),
        (lambda h: h.update(tensions_N=[-1, 2, 3]), "the history is damaged"),
        (lambda h: h.update(tensions_N=[None, 2, 3]), "the history is damaged"),
        (lambda h: h.update(commands=[{"x": 1}] * 3), "the history is damaged"),
        (lambda h: h.update(commands=[{"displacement_m": 1}] * 2), "the history is damaged"),
        (lambda h: h.update(tip_force_N=[1]), "the history is damaged"),
        (lambda h: h.update(gravity_m_per_s2=[10**400, 0, 0]), "gravity_m_per_s2 must be finite"),
        (lambda h: h.update(tip_error_m=10**400), "the history is damaged: tip_error_m"),
        (lambda h: h.update(tensions_N=[True, 0, 0]), "tensions_N must be a list of numbers"),
        (lambda h: h.update(arcs_rad=[[0, 0, 0], [0]]), "arcs_rad must be rows of the same length"),
        (lambda h: h.update(point_loads=5), "the history is damaged: point_loads"),
        (lambda h: h.update(point_loads=[{"force_N": [1, 2, 3]}]), "point_loads[0] has no point_m"),
    ],
)
def test_histories(change: Callable[[dict[str, Any]], Any], says: str) -> None:
    load = bs.Load(displacements=[0.01, -0.01, -0.01])
    history = bs.solve(ROBOT, load=load).history()
    changed = change(history)
    given = changed if changed == 3 else history
    refused(says, lambda: bs.solve(ROBOT, load=load, history=given))
