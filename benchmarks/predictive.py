"""Model-predictive control of a tip: time of a step, and tip error of two models.

    python -m benchmarks.predictive

The three-segment robot crl-ftdcr-v4 is under gravity (modal damping ratio 0.1). Its tip shall
follow a path within 8 s, which statics say it can reach. The controller runs at 50 Hz with a
horizon of ten periods, tensions from 0.2 to 6 N, and changes of at most 20 N/s. In each step it
takes the tip and its derivatives by the tensions at the present tensions from a model, statics of
the physics or constant curvature, and solves a quadratic program (OSQP). The robot is simulated by
`Motions`. With feedback, the measured distance of the tip from that of the model is added to it,
filtered. Times are processor times of one thread, which other work disturbs less.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import osqp
import scipy.sparse as sparse

import bowstring as bs
from bowstring.constant_curvature import RobotArcs
from bowstring.dynamics import Motions

PERIOD = 0.02
HORIZON = 10
LOW, HIGH, RATE = 0.2, 6.0, 20.0
TRACKING, CHANGE, TENSION = 1e5, 1e-2, 1e-3
MEAN = 2.0
FILTER = 0.1
SECONDS = 8.0

Model = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class Controller:
    """The quadratic program over the tensions of all periods of the horizon."""

    def __init__(self, model: Model, tendons: int) -> None:
        self.model, self.tendons = model, tendons
        size = HORIZON * tendons
        changes = sparse.eye(size) - sparse.eye(size, k=-tendons)
        self.smooth = (CHANGE * changes.T @ changes + TENSION * sparse.eye(size)).toarray()
        blocks = np.kron(np.eye(HORIZON), np.ones((tendons, tendons)))
        pattern = sparse.triu(sparse.csc_matrix((self.smooth != 0) + blocks), format="csc")
        self.upper = (pattern.indices, np.repeat(np.arange(size), np.diff(pattern.indptr)))
        pattern.data = (self.smooth + np.eye(size))[self.upper]
        rows = sparse.vstack([sparse.eye(size), changes], format="csc")
        self.low = np.repeat([LOW, -RATE * PERIOD], size)
        self.high = np.repeat([HIGH, RATE * PERIOD], size)
        self.solver = osqp.OSQP()
        self.solver.setup(
            pattern, np.zeros(size), rows, self.low, self.high, verbose=False, eps_abs=1e-4
        )

    def step(self, now: np.ndarray, offset: np.ndarray, path: np.ndarray) -> np.ndarray:
        """Tensions (T,) of the next period, for tips (H, 3) at the ends of the periods."""
        tip, by_tension = self.model(now)
        gain = TRACKING * by_tension.T @ by_tension
        whole = self.smooth + np.kron(np.eye(HORIZON), gain)
        wanted = path - (tip + offset) + by_tension @ now
        linear = -TRACKING * (wanted @ by_tension).ravel() - TENSION * MEAN
        linear[: self.tendons] -= CHANGE * now
        low, high = self.low.copy(), self.high.copy()
        first = slice(HORIZON * self.tendons, (HORIZON + 1) * self.tendons)
        low[first] += now
        high[first] += now
        self.solver.update(q=linear, l=low, u=high, Px=whole[self.upper])
        found = self.solver.solve(raise_error=True).x[: self.tendons]
        # the solver keeps limits to its tolerance only
        change = np.clip(found - now, -RATE * PERIOD, RATE * PERIOD)
        return np.clip(now + change, LOW, HIGH)


def physics(robot: bs.Robot) -> Model:
    """Statics and exact derivatives."""

    def model(tensions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        solution = bs.solve(robot, tensions)
        return solution.tip.position, bs.jacobians(solution).tip_position_by_tension

    return model


def constant_curvature(robot: bs.Robot) -> Model:
    """Arcs by the linear law, and differences."""
    step = 1e-4

    def model(tensions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rows = tensions + np.vstack([np.zeros(len(tensions)), step * np.eye(len(tensions))])
        tips = RobotArcs.from_tensions(robot, rows).tip.position
        return tips[0], (tips[1:] - tips[0]).T / step

    return model


def path_of(robot: bs.Robot) -> tuple[np.ndarray, np.ndarray]:
    """Tensions at the start (T,) and tips (K, 3) that statics give for smooth tensions."""
    phase = np.asarray(robot.tendons.angle_rad)
    size = np.repeat([0.8, 0.6, 0.4], 3)

    def tensions(t: float) -> np.ndarray:
        return MEAN + min(t / 2, 1.0) * size * np.cos(2 * np.pi * t / SECONDS - phase)

    times = PERIOD * np.arange(round(SECONDS / PERIOD) + HORIZON + 1)
    tips = [bs.solve(robot, tensions(t)).tip.position for t in times]
    return tensions(0.0), np.array(tips)


def follow(
    robot: bs.Robot, model: Model, start: np.ndarray, path: np.ndarray, feedback: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the tip (K,) in m, and processor times of the steps (K,) in s."""
    integrator = bs.Integrator(dt=1e-3, modal_damping=0.1)
    plant = Motions(robot, 1, period=PERIOD, between="ramp", integrator=integrator, threads=1)
    controller = Controller(model, len(start))
    tip = plant.reset(tensions=start).tip_position[0]
    now, offset = start, np.zeros(3)
    errors, times = [], []
    for k in range(len(path) - HORIZON):
        begun = time.process_time()
        if feedback:
            offset = offset + FILTER * (tip - model(now)[0] - offset)
        now = controller.step(now, offset, path[k + 1 : k + 1 + HORIZON])
        times.append(time.process_time() - begun)
        tip = plant.step(now).tip_position[0]
        if k + 1 < len(path):
            errors.append(float(np.linalg.norm(tip - path[k + 1])))
    return np.array(errors), np.array(times)


def main() -> None:
    """Print the table."""
    robot = bs.load_robot("crl-ftdcr-v4", {"gravity": "0 0 -9.81"})
    start, path = path_of(robot)
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    print(f"{robot.name}: a path of {1e3 * length:.0f} mm in {SECONDS:g} s")
    print("model                feedback   median ms   p99 ms   mean mm   max mm")
    models = {"physics": physics(robot), "constant curvature": constant_curvature(robot)}
    for name, model in models.items():
        for feedback in (False, True):
            errors, times = follow(robot, model, start, path, feedback)
            print(
                f"{name:21}{feedback!s:8}{1e3 * np.median(times):12.3f}"
                f"{1e3 * np.percentile(times, 99):9.3f}"
                f"{1e3 * errors.mean():10.3f}{1e3 * errors.max():9.3f}"
            )


if __name__ == "__main__":
    main()
