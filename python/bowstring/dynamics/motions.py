"""Many motions of one robot side by side, advanced by control periods on all cores.

All values are in SI and in the base frame. N is the number of motions, T that of tendons.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import bowstring._core as _core
from bowstring.aliases import Bools, Floats, Ints
from bowstring.dynamics.integrator import Integrator, with_ratio
from bowstring.dynamics.modal import modes
from bowstring.errors import InputError
from bowstring.robot.laws import OF_DISPLACEMENTS
from bowstring.robot.model import check_robot, check_without_laws
from bowstring.statics.load import Load
from bowstring.statics.model import as_model
from bowstring.validation import choice, instance, is_whole, number, read, row, shown, whole

if TYPE_CHECKING:
    from bowstring._core import RodModel
    from bowstring.robot.model import Robot

Status = Literal["not_started", "moving", "no_equilibrium", "step_failed", "collision"]

DEFAULT_PERIOD: Final = 0.02  # s
_DEFAULT_STEP: Final = 2e-3  # s
_STATUS: Final = np.array(
    ["not_started", "moving", "no_equilibrium", "step_failed", "collision"], dtype=object
)
_MOVING: Final = 1
_REDRAWS: Final = 50
_MOST: Final = 1_000_000


class MotionsState(NamedTuple):
    """State of all motions at the end of a control period; made by `Motions`.

    A motion that has stopped keeps the state before the period in which it failed.
    """

    tip_position: Floats
    """Positions of the tips (N, 3), m."""
    tip_rotation: Floats
    """Rotations of the tips (N, 3, 3), body to base."""
    tip_velocity: Floats
    """Velocities of the tips (N, 3), m/s."""
    tip_angular_velocity: Floats
    """Angular velocities of the tips (N, 3) in base axes, rad/s."""
    tendon_lengths: Floats
    """Lengths of the tendons (N, T), m."""
    tensions: Floats
    """Tensions at the end of the period (N, T), N."""
    kinetic_energy: Floats
    """Kinetic energies (N,), J."""
    elastic_energy: Floats
    """Elastic energies (N,), J."""
    gravity_energy: Floats
    """Energies of gravity (N,), J; zero with all mass at the base."""
    moving: Bools
    """Whether each motion goes on (N,)."""
    status: NDArray[np.object_]
    """Status of each motion (N,): ``"moving"``; ``"step_failed"`` (even the shortest step did not
    converge), ``"collision"`` (two disks met) or ``"no_equilibrium"`` (none to start from) where it
    has stopped; ``"not_started"`` before the first `Motions.reset`."""


class Motions:
    """Many motions of one robot, each under its own tensions.

    All advance together by control periods, with equal steps of the scheme of `bowstring.simulate`
    (theory of dynamics, Many motions) and shorter ones where these fail. Eight or four motions
    share the SIMD lanes of a core; a motion depends on those beside it by rounding errors only.

    Parameters
    ----------
    robot : Robot
        Robot without friction and other laws. Its tendons are tension-controlled.
    count : int
        Number of motions N.
    period : float
        Control period in s.
    between : {"hold", "ramp"}
        Tensions in a period: constant after a jump at its start (zero-order hold), or linear from
        those before.
    load : Load, optional
        Gravity and a constant dead `tip_force`, the same for all motions.
    model : RodModel, optional
        As for `bowstring.simulate`: by default one element in a module.
    integrator : Integrator, optional
        Damping, spectral radius and longest step `dt`, 2 ms by default. The step has no tolerance:
        docs/guide/control.md has its error. A modal damping ratio is about the equilibrium without
        tension.
    threads : int
        Number of threads; 0 takes one for each core. The motions do not depend on it.

    Attributes
    ----------
    robot : Robot
        The robot.
    count : int
        Number of motions.
    load : Load
        Gravity and tip force of all motions.
    model : RodModel
        Model of the rod.

    Raises
    ------
    InputError
        If an argument is wrong, or the robot has friction.

    Examples
    --------
    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019", {"gravity": "0 0 -9.81"})
    >>> motions = bs.dynamics.Motions(robot, 2, integrator=bs.Integrator(modal_damping=0.05))
    >>> start = motions.reset(tensions=[[20, 20, 20], [40, 0, 0]])
    >>> for _ in range(100):
    ...     state = motions.step([[60, 0, 0], [40, 0, 0]])
    >>> abs(state.tip_position[1] - start.tip_position[1]).max() < 1e-6
    True
    """

    def __init__(
        self,
        robot: Robot,
        count: int,
        *,
        period: float = DEFAULT_PERIOD,
        between: Literal["hold", "ramp"] = "hold",
        load: Load | None = None,
        model: RodModel | None = None,
        integrator: Integrator | None = None,
        threads: int = 0,
    ) -> None:
        check_robot(robot)
        check_without_laws(
            robot, ", with which many motions are not computed", but=OF_DISPLACEMENTS
        )
        self.robot, self.count = robot, whole("count", count, 1, _MOST)
        self.period = number("period", period, "s")
        choice("between", between, ("hold", "ramp"))
        integrator = instance("integrator", integrator, Integrator)
        if integrator.tolerance is not None:
            raise InputError("many motions take equal steps: give dt, which tolerance is not")
        step = min(integrator.dt or _DEFAULT_STEP, self.period)
        load, model = instance("load", load, Load), as_model(model)
        model = model.replace(elements=model.elements or 1)
        given = [name for name, value in vars(load).items() if value is not None]
        others = [name for name in given if name not in ("gravity", "tip_force")]
        if others:
            raise InputError(f"load has {others[0]}; many motions take gravity and tip_force only")
        force = np.zeros(3)
        if load.tip_force is not None:
            force = row("tip_force", load.tip_force, 3, "N")
        scheme = integrator.scheme(robot.length, step)._replace(step=step)
        if integrator.modal_damping is not None:
            # modes are about an equilibrium, and that without tension is the simplest
            still = np.zeros(len(robot.tendons.end_disk))
            found = modes(robot, still, load=load, model=model, count=12)
            scheme = with_ratio(scheme, integrator.modal_damping, found.frequency_hz)
        gravity = robot.gravity if load.gravity is None else load.gravity
        self._tendons = len(robot.tendons.end_disk)
        self._least = robot.tendons.least_tension_N
        self.load, self.model = load.replace(gravity=gravity), model
        size = (self.count, whole("threads", threads, 0, 1024))
        control = (self.period, between == "hold")
        self._core = _core.Motions(robot.core, model, gravity, force, scheme, control, size)
        self._tensions = np.zeros((self.count, self._tendons))

    def __repr__(self) -> str:
        return f"<{self.count} motions of {self.robot.name}, period {self.period:g} s>"

    @property
    def steps(self) -> int:
        """Time steps in a period."""
        return self._core.steps

    @property
    def repeated(self) -> int:
        """Periods of single motions that were repeated with shorter steps, all so far."""
        return self._core.repeated

    @property
    def state(self) -> MotionsState:
        """Present state of all motions."""
        position, rotation, velocity, spin, lengths, energies = self._core.observe()
        codes = self._core.status()
        return MotionsState(
            position,
            rotation,
            velocity,
            spin,
            lengths,
            self._tensions.copy(),
            energies[:, 0],
            energies[:, 1],
            energies[:, 2],
            codes == _MOVING,
            _STATUS[codes],
        )

    def reset(
        self, which: ArrayLike | None = None, tensions: ArrayLike | None = None
    ) -> MotionsState:
        """Bring motions to rest in equilibria of tensions.

        Parameters
        ----------
        which : array_like (K,), optional
            Indices of the motions, from 0; all by default.
        tensions : array_like (T,) or (K, T), optional
            Tensions in N, of all of them or of each; zero by default.

        Returns
        -------
        MotionsState
            State of all motions. A motion without an equilibrium has the status
            ``"no_equilibrium"``.

        Raises
        ------
        InputError
            If an argument is wrong.
        """
        chosen = self._which(which)
        rows = self._rows(0.0 if tensions is None else tensions, len(chosen))
        self._core.reset(chosen, rows)
        self._tensions[chosen] = rows
        return self.state

    def reset_at_random(
        self,
        which: ArrayLike | None = None,
        *,
        most: ArrayLike,
        seed: int | np.random.Generator | None = None,
    ) -> MotionsState:
        """Bring motions to rest in equilibria of random tensions.

        Parameters
        ----------
        which : array_like (K,), optional
            Indices of the motions, from 0; all by default.
        most : array_like () or (T,)
            Largest tension in N, of all tendons or of each; tensions are uniform from 0 on.
            Tensions without an equilibrium are drawn again.
        seed : int or numpy.random.Generator, optional
            Seed of the tensions.

        Returns
        -------
        MotionsState
            State of all motions.

        Raises
        ------
        InputError
            If an argument is wrong.
        """
        chosen = self._which(which)
        top = self._rows(most, 1)[0]
        if not (seed is None or isinstance(seed, np.random.Generator) or is_whole(seed)):
            raise InputError.of("seed", shown(seed), "a whole number or a NumPy generator")
        random = np.random.default_rng(seed)
        state = self.state
        for _ in range(_REDRAWS):
            state = self.reset(chosen, random.uniform(0.0, top, (len(chosen), self._tendons)))
            chosen = chosen[~state.moving[chosen]]
            if len(chosen) == 0:
                break
        return state

    def step(self, tensions: ArrayLike) -> MotionsState:
        """Advance all motions that have not stopped by a control period.

        Parameters
        ----------
        tensions : array_like (T,) or (N, T)
            Tensions in N, zero or more, of all motions or of each.

        Returns
        -------
        MotionsState
            State at the end of the period.

        Raises
        ------
        InputError
            If an argument is wrong, or a motion was never reset.
        """
        rows = self._rows(tensions, self.count)
        moving = self._core.status() == _MOVING
        self._core.step(rows)
        moving &= self._core.status() == _MOVING
        self._tensions[moving] = rows[moving]
        return self.state

    def _which(self, which: ArrayLike | None) -> Ints:
        if which is None:
            return np.arange(self.count)
        found = read("which", which, "indices of motions")
        chosen = np.atleast_1d(found).astype(np.int64)
        inside = (chosen == found) & (chosen >= 0) & (chosen < self.count)
        if chosen.ndim != 1 or not inside.all():
            rule = f"indices of motions, whole numbers from 0 to {self.count - 1}"
            raise InputError.of("which", shown(which), rule)
        return chosen

    def _rows(self, tensions: ArrayLike, count: int) -> Floats:
        """Tensions of each of `count` motions."""
        found = read("tensions", tensions, "tensions in N")
        shape = (count, self._tendons)
        if found.shape not in ((), shape[1:], shape):
            raise InputError(
                f"tensions has shape {found.shape}, it must be {shape} or {shape[1:]}, in N"
            )
        least = self._least if found.ndim else self._least.max()
        wrong = np.argwhere(~(np.isfinite(found) & (found >= least)))
        if len(wrong):
            value = found[tuple(wrong[0])]
            where = f" {wrong[0][-1] + 1}" if found.ndim else ""
            whose = f" of motion {wrong[0][0]}" if found.ndim == 2 else ""
            raise InputError(f"tension{where}{whose} is {value:g} N; tensions must be >= 0 N")
        return np.array(np.broadcast_to(found, shape))
