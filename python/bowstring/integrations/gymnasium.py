"""Environments for Gymnasium: a robot in motion whose tip must reach a point.

Needs the extra ``gymnasium`` (``pip install 'bowstring[gymnasium]'``). Importing this module
registers ``bowstring/Reach-v0``. All values are in SI and in the base frame; T is the number of
tendons.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Bools, Floats, Ints
from bowstring.dynamics.integrator import Integrator
from bowstring.dynamics.motions import DEFAULT_PERIOD, Motions, MotionsState
from bowstring.errors import InputError
from bowstring.optional import load_extra
from bowstring.robot.model import check_robot
from bowstring.robot.reader import load_robot
from bowstring.statics.rod import solve_batch
from bowstring.validation import choice, instance, number, read, shown, whole

load_extra("gymnasium")

from gymnasium import Env, registry, spaces  # noqa: E402
from gymnasium.envs.registration import register  # noqa: E402
from gymnasium.utils import EzPickle, seeding  # noqa: E402
from gymnasium.vector import AutoresetMode, VectorEnv  # noqa: E402
from gymnasium.vector.utils import batch_space  # noqa: E402

if TYPE_CHECKING:
    from bowstring._core import RodModel
    from bowstring.robot.model import Robot
    from bowstring.statics.load import Load

__all__ = ["REACH", "MotionSettings", "ReachEnv", "ReachVectorEnv"]

Observations = NDArray[Any]

#: Id of the environment in the registry of Gymnasium.
REACH: Final = "bowstring/Reach-v0"

_SECONDS: Final = 4.0  # duration of an episode
_TOLERANCE: Final = 0.01  # distance of success over the length
_REDRAWS: Final = 100
_TENSION_BEND: Final = 1.0  # bend by the default of max_tension, rad
_DAMPED: Final = Integrator(modal_damping=0.05)


@dataclass(frozen=True, eq=False)
class MotionSettings:
    """Settings of the motion of an environment's robot.

    Parameters
    ----------
    period : float
        Control period in s.
    between : {"hold", "ramp"}
        As for `bowstring.dynamics.Motions`.
    integrator : Integrator
        As for `bowstring.dynamics.Motions`; a modal damping ratio of 0.05 by default.
    load : Load, optional
        As for `bowstring.dynamics.Motions`.
    model : RodModel, optional
        As for `bowstring.dynamics.Motions`.
    """

    period: float = DEFAULT_PERIOD
    between: Literal["hold", "ramp"] = "hold"
    integrator: Integrator = _DAMPED
    load: Load | None = None
    model: RodModel | None = None


class _Task:
    """The task, its spaces, and the motions of `count` environments."""

    def __init__(
        self,
        count: int,
        robot: Robot | str,
        max_tension: float | None,
        max_episode_steps: int | None,
        dtype: str,
        motion: MotionSettings | None,
        threads: int,
    ) -> None:
        if isinstance(robot, str):
            robot = load_robot(robot, {"gravity": "0 0 -9.81"})
        check_robot(robot)
        choice("dtype", dtype, ("float32", "float64"))
        self.robot, self.dtype = robot, np.dtype(dtype)
        self.top = _default_tension(robot) if max_tension is None else max_tension
        self.top = number("max_tension", self.top, "N")
        motion = instance("motion", motion, MotionSettings)
        self.motions = Motions(robot, count, threads=threads, **vars(motion))
        if max_episode_steps is None:
            max_episode_steps = max(1, round(_SECONDS / self.motions.period))
        self.longest = whole("max_episode_steps", max_episode_steps, 1, 1_000_000_000)
        self.tendons = len(robot.tendons.end_disk)
        self.targets = np.zeros((count, 3))
        self.taken = np.zeros(count, dtype=np.int64)
        self.action_space = spaces.Box(0.0, self.top, (self.tendons,), self.dtype.type)
        self.observation_space = self._observation_space()

    def _observation_space(self) -> spaces.Box:
        reach, endless = 2.0 * self.robot.length, np.inf
        tips = [reach] * 3 + [1.0 + 1e-6] * 9 + [endless] * 6
        low = [-x for x in tips] + [0.0] * self.tendons + [0.0] * self.tendons + [-reach] * 3
        high = [*tips, *([endless] * self.tendons), *([self.top] * self.tendons), *([reach] * 3)]
        kind: Any = self.dtype.type
        return spaces.Box(np.array(low, kind), np.array(high, kind), dtype=kind)

    def reset(self, which: Ints, randoms: Sequence[np.random.Generator]) -> None:
        """Draw start and target of some environments, each from its own generator."""

        def begins(left: Ints, rows: list[Floats]) -> Bools:
            return self.motions.reset(left, rows).moving[left]

        def with_target(left: Ints, rows: list[Floats]) -> Bools:
            found = solve_batch(
                self.robot, rows, load=self.motions.load, model=self.motions.model, disks=False
            )
            good: Bools = found.converged & np.array([bool(stable) for stable in found.stable])
            self.targets[left[good]] = found.tip_position[good]
            return good

        for reached in (begins, with_target):
            left = which
            for _ in range(_REDRAWS):
                rows = [randoms[i].uniform(0.0, self.top, self.tendons) for i in left]
                left = left[~reached(left, rows)]
                if len(left) == 0:
                    break
            else:
                raise InputError(
                    f"{self.robot.name} has hardly any stable equilibrium at tensions up to "
                    f"{self.top:g} N; give a smaller max_tension"
                )
        self.taken[which] = 0

    def tensions(self, actions: Any, shape: tuple[int, ...]) -> Floats:
        """Tensions of actions, limited to the action space."""
        found = read("action", actions, "tensions in N")
        if found.shape != shape:
            raise InputError(f"action has shape {found.shape}, it must be {shape}, tensions in N")
        if not np.isfinite(found).all():
            raise InputError(f"action is {shown(found.tolist())}, all must be finite numbers, in N")
        return np.clip(found, 0.0, self.top)

    def observe(self, state: MotionsState) -> Observations:
        """Observations (N, 21 + 2 T)."""
        count = len(state.moving)
        rows = np.concatenate(
            [
                state.tip_position,
                state.tip_rotation.reshape(count, 9),
                state.tip_velocity,
                state.tip_angular_velocity,
                state.tendon_lengths,
                state.tensions,
                self.targets,
            ],
            axis=1,
        ).astype(self.dtype)
        # a tension of float64 may round to one above the limit in float32
        space = self.observation_space
        limited: Observations = np.clip(rows, space.low, space.high)
        return limited

    def distance(self, state: MotionsState) -> Floats:
        """Distances (N,) of the tips from their targets, m."""
        return np.asarray(np.linalg.norm(state.tip_position - self.targets, axis=1))


def _default_tension(robot: Robot) -> float:
    """Tension (N) that alone bends the robot by about a radian, by the linear law."""
    radius = float(np.max(robot.tendons.arm_m))
    return float(_TENSION_BEND * np.max(robot.bending_stiffness) / (radius * robot.length))


class ReachEnv(Env[Observations, Observations], EzPickle):
    """Bring the tip of a robot to a point by the tensions of its tendons.

    An episode starts at rest in the equilibrium of random tensions. The target is the tip in
    another equilibrium: it can be reached. Tensions are held, or change linearly, over a control
    period.

    Actions are tensions (T,) in N from 0 to `max_tension`; those outside are limited to that range.
    An observation (21 + 2 T,) has the position of the tip (3, m), its rotation, body to base, row
    by row (9), its velocity (3, m/s) and angular velocity (3, rad/s), the lengths of the tendons
    (T, m), their tensions (T, N), and the target (3, m). The reward of a step is minus the distance
    of the tip from the target over the length of the robot.

    An episode is truncated after `max_episode_steps`. It is terminated where the motion cannot be
    computed further: ``info["status"]`` is then ``"step_failed"`` or ``"collision"``, and the
    observation is that before. ``info`` also has ``distance_m`` and ``is_success``, whether the
    distance is at most 1 % of the length.

    Parameters
    ----------
    robot : Robot or str
        Robot without friction and other laws, or the name or path of one, which is then under
        gravity along the base frame's -z.
    max_tension : float, optional
        Largest tension in N. By default the one that alone bends the robot by about a radian.
    max_episode_steps : int, optional
        Control periods in an episode; 4 s by default.
    dtype : {"float32", "float64"}
        Numbers in actions and observations.
    motion : MotionSettings, optional
        Control period, integrator, load and rod model.
    render_mode : None
        There is no picture.

    Raises
    ------
    InputError
        If an argument is wrong, or the robot has friction.

    Examples
    --------
    >>> from bowstring.gymnasium import ReachEnv
    >>> env = ReachEnv("amouri2019", max_tension=40)
    >>> observation, info = env.reset(seed=1)
    >>> observation.shape
    (27,)
    >>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    >>> terminated, truncated
    (False, False)
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - of Gymnasium

    def __init__(
        self,
        robot: Robot | str = "amouri2019",
        *,
        max_tension: float | None = None,
        max_episode_steps: int | None = None,
        dtype: str = "float32",
        motion: MotionSettings | None = None,
        render_mode: None = None,
    ) -> None:
        if render_mode is not None:
            raise InputError.of("render_mode", shown(render_mode), "None: there is no picture")
        settings: dict[str, Any] = {
            "max_tension": max_tension,
            "max_episode_steps": max_episode_steps,
            "dtype": dtype,
            "motion": motion,
        }
        EzPickle.__init__(self, robot, **settings)  # a copy begins with reset
        self.render_mode = None
        self._task = _Task(1, robot, threads=1, **settings)
        self.action_space = self._task.action_space
        self.observation_space = self._task.observation_space
        self._ended = True

    @property
    def motions(self) -> Motions:
        """The motion, one of `bowstring.dynamics.Motions`."""
        return self._task.motions

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Start an episode.

        Parameters
        ----------
        seed : int, optional
            Seed of start and target, and of those of later episodes.
        options : dict, optional
            Not used.

        Returns
        -------
        observation : ndarray (21 + 2 T,)
            Observation at rest.
        info : dict
            As of `step`.
        """
        super().reset(seed=seed)
        self._task.reset(np.zeros(1, dtype=np.int64), [self.np_random])
        self._ended = False
        state = self.motions.state
        return self._task.observe(state)[0], self._info(state)

    def step(self, action: Observations) -> tuple[Observations, float, bool, bool, dict[str, Any]]:
        """Advance by a control period.

        Parameters
        ----------
        action : array_like (T,)
            Tensions in N.

        Returns
        -------
        observation : ndarray (21 + 2 T,)
            Observation at the end of the period.
        reward : float
            Minus the distance from the target over the length of the robot.
        terminated : bool
            Whether the motion could not be computed further.
        truncated : bool
            Whether the time is over.
        info : dict
            ``distance_m``, ``is_success`` and ``status``.

        Raises
        ------
        InputError
            If the action is no tensions, or the episode has ended.
        """
        if self._ended:
            raise InputError("the episode has not begun or has ended; call reset first")
        task = self._task
        state = self.motions.step(task.tensions(action, (task.tendons,)))
        task.taken += 1
        terminated = not bool(state.moving[0])
        truncated = bool(task.taken[0] >= task.longest) and not terminated
        self._ended = terminated or truncated
        reward = -float(task.distance(state)[0]) / task.robot.length
        return task.observe(state)[0], reward, terminated, truncated, self._info(state)

    def _info(self, state: MotionsState) -> dict[str, Any]:
        distance = float(self._task.distance(state)[0])
        return {
            "distance_m": distance,
            "is_success": distance <= _TOLERANCE * self._task.robot.length,
            "status": str(state.status[0]),
        }


class ReachVectorEnv(VectorEnv[Observations, Observations, NDArray[Any]], EzPickle):
    """Many environments of `ReachEnv`, whose motions are computed together on all cores.

    Each behaves as a `ReachEnv` that was reset with the seed plus its index. An environment whose
    episode has ended is reset in the next step, in which its action is ignored
    (`gymnasium.vector.AutoresetMode.NEXT_STEP`).

    Parameters
    ----------
    num_envs : int
        Number of environments.
    robot, max_tension, max_episode_steps, dtype, motion : object
        As for `ReachEnv`.
    threads : int
        Number of threads; 0 takes one for each core.
    render_mode : None
        There is no picture.

    Raises
    ------
    InputError
        If an argument is wrong, or the robot has friction.

    Examples
    --------
    >>> from bowstring.gymnasium import ReachVectorEnv
    >>> envs = ReachVectorEnv(16, "amouri2019", max_tension=40)
    >>> observations, info = envs.reset(seed=1)
    >>> observations, rewards, terminated, truncated, info = envs.step(envs.action_space.sample())
    >>> observations.shape, rewards.shape
    ((16, 27), (16,))
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - of Gymnasium
        "render_modes": [],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        robot: Robot | str = "amouri2019",
        *,
        max_tension: float | None = None,
        max_episode_steps: int | None = None,
        dtype: str = "float32",
        motion: MotionSettings | None = None,
        threads: int = 0,
        render_mode: None = None,
    ) -> None:
        if render_mode is not None:
            raise InputError.of("render_mode", shown(render_mode), "None: there is no picture")
        settings: dict[str, Any] = {
            "max_tension": max_tension,
            "max_episode_steps": max_episode_steps,
            "dtype": dtype,
            "motion": motion,
            "threads": threads,
        }
        EzPickle.__init__(self, num_envs, robot, **settings)  # a copy begins with reset
        self._task = _Task(whole("num_envs", num_envs, 1, 1_000_000), robot, **settings)
        self.render_mode = None
        self.num_envs = int(num_envs)
        self.single_action_space = self._task.action_space
        self.single_observation_space = self._task.observation_space
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._randoms: list[np.random.Generator] = []
        self._ended = np.zeros(self.num_envs, dtype=bool)

    @property
    def motions(self) -> Motions:
        """The motions."""
        return self._task.motions

    def reset(
        self,
        *,
        seed: int | Sequence[int] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observations, dict[str, Any]]:
        """Start an episode in every environment.

        Parameters
        ----------
        seed : int or sequence of int, optional
            Seed of the first environment, the next one has that plus 1; or the seed of each.
        options : dict, optional
            Not used.

        Returns
        -------
        observations : ndarray (N, 21 + 2 T)
            Observations at rest.
        infos : dict
            As of `step`.
        """
        if seed is not None or not self._randoms:
            if seed is None or isinstance(seed, int | np.integer):
                super().reset(seed=None if seed is None else int(seed))
                first = self.np_random_seed or 0
                seeds = [first + i for i in range(self.num_envs)]
            else:
                seeds = [int(one) for one in seed]
            if len(seeds) != self.num_envs:
                raise InputError(f"there are {len(seeds)} seeds for {self.num_envs} environments")
            self._randoms = [seeding.np_random(one)[0] for one in seeds]
        self._task.reset(np.arange(self.num_envs), self._randoms)
        self._ended[:] = False
        state = self.motions.state
        return self._task.observe(state), self._infos(state)

    def step(
        self, actions: Observations
    ) -> tuple[Observations, Floats, Bools, Bools, dict[str, Any]]:
        """Advance all environments by a control period; reset those that have ended.

        Parameters
        ----------
        actions : array_like (N, T)
            Tensions in N.

        Returns
        -------
        observations : ndarray (N, 21 + 2 T)
            Observations at the end of the period, or at rest.
        rewards : ndarray (N,)
            Rewards; 0 where an environment was reset.
        terminated, truncated : ndarray of bool (N,)
            As for `ReachEnv.step`.
        infos : dict
            ``distance_m``, ``is_success`` and ``status``, arrays (N,).

        Raises
        ------
        InputError
            If the actions are no tensions, or there was no reset.
        """
        if not self._randoms:
            raise InputError("the environments were never reset; call reset first")
        task, again = self._task, self._ended.copy()
        state = self.motions.step(task.tensions(actions, (self.num_envs, task.tendons)))
        task.taken += 1
        if again.any():
            task.reset(np.flatnonzero(again), self._randoms)
            state = self.motions.state
        terminated = ~state.moving
        truncated = (task.taken >= task.longest) & ~terminated
        self._ended = terminated | truncated
        rewards = np.where(again, 0.0, -task.distance(state) / task.robot.length)
        return task.observe(state), rewards, terminated, truncated, self._infos(state)

    def _infos(self, state: MotionsState) -> dict[str, Any]:
        distance, every = self._task.distance(state), np.ones(self.num_envs, dtype=bool)
        found: dict[str, Any] = {
            "distance_m": distance,
            "is_success": distance <= _TOLERANCE * self._task.robot.length,
            "status": state.status,
        }
        return {**found, **{f"_{name}": every for name in found}}


def _register() -> None:
    if REACH not in registry:
        register(
            id=REACH,
            entry_point="bowstring.gymnasium:ReachEnv",
            vector_entry_point="bowstring.gymnasium:ReachVectorEnv",
        )


_register()
