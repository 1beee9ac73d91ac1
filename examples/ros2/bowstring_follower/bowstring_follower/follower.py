"""The logic of the node, without ROS: targets in, commands at a fixed rate out."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

import bowstring as bs

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Command:
    """What the motors hold until the next cycle, and the tip that physics predicts under it.

    Attributes
    ----------
    tensions : ndarray (T,)
        In N.
    tendon_lengths : ndarray (T,)
        From the base hole to the hole of the end disk, in m.
    displacements : ndarray (T,)
        Tendon displacements since the home pose in m, positive where shortened; NaN without one.
    tip_position : ndarray (3,)
        In the base frame, m.
    tip_rotation : ndarray (3, 3)
        Tip frame to base frame.
    distance : float
        From the predicted tip to the present target in m; NaN before the first target.
    """

    tensions: Floats
    tendon_lengths: Floats
    displacements: Floats
    tip_position: Floats
    tip_rotation: Floats
    distance: float


class TipFollower:
    """Moves the tip to the last target along a straight line, by the inverse by physics.

    A target is planned at once as rows of a path (about 0.5 ms a row); a cycle takes the next row.
    A planned position that cannot be reached is replaced by the nearest tip.

    Parameters
    ----------
    robot : str
        Name of a built-in robot, or path of a robot file.
    rate : float
        Cycles in a second, Hz.
    max_tension : float, optional
        Largest tension of all tendons in N. The default is that of `bowstring.inverse_kinematics`.
    max_speed : float
        Largest speed of the tip along the line in m/s.
    max_tension_rate : float
        Largest change of a tension in N/s. It also acts where neighbouring positions have sets of
        tensions that are far apart, and the tip then leaves the line.

    Raises
    ------
    ValueError
        If a number is not positive; `bowstring.errors.InputError`, which is one, if the robot is
        wrong.
    """

    def __init__(
        self,
        robot: str,
        rate: float = 50.0,
        max_tension: float | None = None,
        max_speed: float = 0.05,
        max_tension_rate: float = 20.0,
    ) -> None:
        given = {"rate": rate, "max_speed": max_speed, "max_tension_rate": max_tension_rate}
        if max_tension is not None:
            given["max_tension"] = max_tension
        for name, value in given.items():
            if not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} is {value}; it must be positive and finite")
        self.robot = bs.load_robot(robot)
        self.max_tension = max_tension
        self._step = max_speed / rate
        self._tension_step = max_tension_rate / rate
        self._target: Floats | None = None
        self._rows: deque[Floats] = deque()
        start = np.array(self.robot.tendons.pretension_N, dtype=float)
        self.command = self._under(start if max_tension is None else np.minimum(start, max_tension))

    @property
    def names(self) -> list[str]:
        """Names of the tendons: tendon_1 and so on, in the order of the robot file."""
        return [f"tendon_{i + 1}" for i in range(len(self.command.tensions))]

    def set_target(self, position: ArrayLike) -> str:
        """Plan the way from the present tip to a position.

        Parameters
        ----------
        position : array_like (3,)
            In the base frame, m.

        Returns
        -------
        str
            Empty if the whole way can be reached, otherwise what to know, as a sentence.

        Raises
        ------
        bowstring.errors.InputError
            If it is no position, or one that no tip can have; the last target stays.
        """
        target = np.array(position, dtype=float)
        if target.shape != (3,) or not np.isfinite(target).all():
            raise bs.errors.InputError(f"the target is {target.tolist()}; it must be x, y, z in m")
        start = self.command.tip_position
        count = max(1, int(np.ceil(np.linalg.norm(target - start) / self._step)))
        way = start + np.linspace(0.0, 1.0, count + 1)[:, None] * (target - start)
        limits = bs.ActuationLimits(max_tension=self.max_tension)
        found = bs.inverse_kinematics(self.robot, way, limits=limits)
        usable = np.isfinite(found.tensions).all(axis=1)
        if not usable[-1]:
            raise bs.errors.InputError(found.message(count))
        self._target = target
        self._rows = deque(found.tensions[1:][usable[1:]])
        missed = int((~found.reached[1:]).sum())
        return "" if not missed else f"{missed} of {count} positions: {found.message(count)}"

    def step(self) -> Command:
        """Make one cycle.

        Returns
        -------
        Command
            The next command; the last one again where the target was reached.

        Raises
        ------
        bowstring.errors.NoSolutionError
            If the next tensions have no stable equilibrium; the last command stays.
        """
        now = self.command.tensions
        wanted = self._rows[0] if self._rows else now
        change = wanted - now
        largest = float(np.abs(change).max())
        arrives = largest <= self._tension_step
        # otherwise all tensions change by the same share of their way
        tensions = wanted if arrives else now + change * (self._tension_step / largest)
        self.command = self._under(tensions)
        if arrives and self._rows:
            self._rows.popleft()
        return self.command

    def _under(self, tensions: Floats) -> Command:
        """Command of these tensions, with the equilibrium under them."""
        found = bs.solve(self.robot, tensions).raise_for_status()
        displacements = found.displacements()
        tip = found.tip.position
        distance = np.nan if self._target is None else float(np.linalg.norm(tip - self._target))
        return Command(
            tensions=np.asarray(tensions),
            tendon_lengths=np.asarray(found.tendon_lengths),
            displacements=np.full(len(tensions), np.nan)
            if displacements is None
            else np.asarray(displacements),
            tip_position=np.asarray(tip),
            tip_rotation=np.asarray(found.tip.rotation),
            distance=distance,
        )
