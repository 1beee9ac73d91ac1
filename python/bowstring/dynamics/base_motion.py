"""Motion of the base of a simulated robot: poses over time, and the accelerations of its frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from bowstring.aliases import Floats
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.validation import numbers, read

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import RotationSpline

_MISFIT: Final = 1e-5  # largest misfit of a cubic over the largest acceleration
_LEAST_PART: Final = 1 / 64  # shortest interval over the time between two poses
_NODES: Final = np.array([0.0, 1.0, 2.0, 3.0]) / 3.0  # shares of an interval to fit a cubic
_OWN: Final = np.array([0.12, 0.5, 0.88])  # shares of an interval to check it
_STILL: Final = np.array([1e-2, 1e-4, 1e-2])  # m/s^2, rad/s, rad/s^2: smaller values count as zero
_LARGEST_TURN: Final = 3.0  # rad between two poses, below the half turn that splines allow


@short_repr
@dataclass(frozen=True, eq=False)
class BaseMotion:
    """Poses of the base over time, joined by smooth curves, for `bowstring.simulate`.

    Positions are joined by a cubic spline and rotations by one of rotations, each with continuous
    acceleration. World axes are those of the base where its rotation is zero; gravity of robot and
    load is in world axes. The robot starts at rest relative to the base.

    Parameters
    ----------
    times : array_like (K,)
        Increasing times in s, at least two, from 0 to the end of the run or beyond.
    positions : array_like (K, 3), optional
        Positions of the base's origin in world axes, m; it does not move if left out.
    rotations : array_like (K, 3), optional
        Rotation vectors, base to world, rad; it does not turn if left out.

    Raises
    ------
    InputError
        If an array does not fit, times do not increase, or the base turns by more than 3 rad
        between two times.

    Examples
    --------
    A base that is moved by 50 mm to the side in half a second:

    >>> import numpy as np
    >>> import bowstring as bs
    >>> times = np.linspace(0, 1, 21)
    >>> way = np.clip(times / 0.5, 0, 1)
    >>> shift = 0.05 * way**3 * (10 - 15 * way + 6 * way**2)
    >>> base = bs.BaseMotion(times, np.outer(shift, [1, 0, 0]))
    >>> robot = bs.load_robot("amouri2019")
    >>> run = bs.simulate(robot, [40, 0, 0], 1.0, load=bs.Load(base=base))
    >>> run.status
    'converged'
    """

    times: ArrayLike
    positions: ArrayLike | None = None
    rotations: ArrayLike | None = None
    _place: CubicSpline | None = field(init=False, repr=False)
    _turn: RotationSpline | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        from scipy.interpolate import CubicSpline
        from scipy.spatial.transform import Rotation, RotationSpline

        times = read("times", self.times, "increasing times (K,) in s")
        if times.ndim != 1 or len(times) < 2 or not np.isfinite(times).all():
            raise InputError(f"times has shape {times.shape}, it must be (K,), two or more, in s")
        if times[0] != 0.0 or (np.diff(times) <= 0.0).any():
            raise InputError("times must begin at 0 s and increase")
        object.__setattr__(self, "times", times)
        place = turn = None
        if self.positions is None and self.rotations is None:
            raise InputError(
                "got neither positions nor rotations, so that the base would stay; give one of them"
            )
        if self.positions is not None:
            positions = numbers("positions", self.positions, (len(times), 3), "m")
            object.__setattr__(self, "positions", positions)
            place = CubicSpline(times, positions)
        if self.rotations is not None:
            rotations = numbers("rotations", self.rotations, (len(times), 3), "rad")
            object.__setattr__(self, "rotations", rotations)
            each = Rotation.from_rotvec(rotations)
            steps = (each[:-1].inv() * each[1:]).magnitude()
            if steps.max() > _LARGEST_TURN:
                k = int(steps.argmax())
                raise InputError(
                    f"the base turns by {steps[k]:.3g} rad from {times[k]:g} to {times[k + 1]:g} "
                    f"s; give poses that are at most {_LARGEST_TURN:g} rad apart"
                )
            turn = RotationSpline(times, each)
        object.__setattr__(self, "_place", place)
        object.__setattr__(self, "_turn", turn)

    def accelerations(self, times: ArrayLike, gravity: ArrayLike) -> Floats:
        """Compute the accelerations of the base's frame, in axes of the base.

        Parameters
        ----------
        times : array_like (n,)
            Times in s.
        gravity : array_like (3,)
            Gravity in world axes, m/s^2.

        Returns
        -------
        ndarray (n, 9)
            Acceleration of the origin in m/s^2, with the change of gravity in axes of the base
            since time zero; angular velocity in rad/s and angular acceleration in rad/s^2.
        """
        at = np.asarray(times, dtype=float)
        out = np.zeros((len(at), 9))
        moved = np.zeros((len(at), 3)) if self._place is None else self._place(at, 2)
        if self._turn is None:
            out[:, :3] = moved
            return out
        back = self._turn(at).inv()
        change = back.apply(np.asarray(gravity, dtype=float)) - self.gravity([0.0], gravity)
        out[:, :3] = back.apply(moved) - change
        out[:, 3:6] = self._turn(at, 1)
        out[:, 6:] = self._turn(at, 2)
        return out

    def gravity(self, times: ArrayLike, gravity: ArrayLike) -> Floats:
        """Compute gravity in axes of the base.

        Parameters
        ----------
        times : array_like (n,)
            Times in s.
        gravity : array_like (3,)
            Gravity in world axes, m/s^2.

        Returns
        -------
        ndarray (n, 3)
            Gravity in axes of the base, m/s^2.
        """
        at, weight = np.asarray(times, dtype=float), np.asarray(gravity, dtype=float)
        if self._turn is None:
            return np.tile(weight, (len(at), 1))
        return np.asarray(self._turn(at).inv().apply(weight))

    @property
    def duration(self) -> float:
        """Last time in s."""
        return float(np.asarray(self.times)[-1])

    def to_dict(self) -> dict[str, Any]:
        """Plain values for a file."""

        def plain(values: ArrayLike | None) -> Any:
            return None if values is None else np.asarray(values).tolist()

        return {
            "times_s": plain(self.times),
            "positions_m": plain(self.positions),
            "rotations_rad": plain(self.rotations),
        }

    @classmethod
    def of_dict(cls, item: Mapping[str, Any]) -> BaseMotion:
        """Make a motion of the plain values of `to_dict`, as the settings of a run have them.

        Parameters
        ----------
        item : mapping
            ``times_s``, ``positions_m`` and ``rotations_rad``; None where there are none.

        Returns
        -------
        BaseMotion
            The same motion.

        Examples
        --------
        >>> import bowstring as bs
        >>> base = bs.BaseMotion([0, 0.1], [[0, 0, 0], [0.01, 0, 0]])
        >>> robot = bs.load_robot("amouri2019")
        >>> run = bs.simulate(robot, [40, 0, 0], 0.1, load=bs.Load(base=base))
        >>> bs.BaseMotion.of_dict(run.settings["base"]).positions.tolist()
        [[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]]
        """
        names = ("times_s", "positions_m", "rotations_rad")
        missing = [name for name in names if name not in item]
        if missing:
            raise InputError(f"a motion of the base has no {missing[0]}; give {', '.join(names)}")
        return cls(*(item[name] for name in names))


class BaseHistory:
    """Accelerations of the base over time, as a load history of 9 columns.

    They are joined by cubics, each through four values. Their ends are poses where these are far
    apart, and lie closer where the base turns fast, so that the cubics are within 1e-5 of the
    largest acceleration.

    Parameters
    ----------
    base : BaseMotion
        Motion of the base.
    gravity : array_like (3,)
        Gravity in world axes, m/s^2.
    duration : float
        Duration of the run, s.
    """

    is_sampled = False

    def __init__(self, base: BaseMotion, gravity: ArrayLike, duration: float) -> None:
        self.base = base
        end = min(duration, base.duration) or base.duration

        def values(times: Floats) -> Floats:
            return base.accelerations(np.minimum(times, end), gravity)

        times = np.asarray(base.times)
        self._starts, self._values, self.misfit = _cubics(
            values, np.append(times[times < end], end)
        )
        self._ends = np.append(self._starts[1:], end)

    def rows(self, times: Floats, *, before: bool = False) -> Floats:
        """Accelerations (K, 9) at several times (K,)."""
        at = np.clip(np.searchsorted(self._starts, times, side="right") - 1, 0, None)
        return _between(self._starts[at], self._ends[at], self._values[at], times)

    def at(self, time: float, *, before: bool = False) -> Floats:
        """Accelerations (9,) at a time."""
        return np.asarray(self.rows(np.array([time]))[0])

    def inside(self, starts: Floats, ends: Floats) -> Floats:
        """Accelerations (K, 27) at one and two thirds of intervals, and at their ends."""
        times = starts[:, None] + (ends - starts)[:, None] * _NODES[1:]
        times[:, -1] = ends
        return self.rows(times.ravel()).reshape(len(ends), -1)

    def knots(self) -> set[float]:
        """Times at which the cubics meet."""
        return {*self._starts.tolist(), float(self._ends[-1])}

    def jumps(self) -> set[float]:
        """No times: the motion is smooth."""
        return set()

    def to_dict(self) -> Any:
        """Poses of the base for a file."""
        return self.base.to_dict()


def _cubics(values: Callable[[Floats], Floats], times: Floats) -> tuple[Floats, Floats, float]:
    """Fit cubics to accelerations; their starts (M,), values (M, 4, 9) and largest misfit.

    Intervals are halved, at a pose as long as there is one inside. The misfit is over the largest
    acceleration, angular velocity and angular acceleration.
    """
    last = len(times) - 1
    poses = np.arange(last + 1.0)
    fine = np.linspace(0.0, last, 2 * last + 1)  # times of the poses, and one between each two
    checks = np.interp(fine, poses, times)
    exact = values(checks)
    scale = np.maximum(_sizes(exact).max(axis=0), _STILL)
    starts, fitted, worst = [], [], 0.0
    a, b = np.zeros(1), np.full(1, float(last))
    while len(a):
        start, end = np.interp(a, poses, times), np.interp(b, poses, times)
        own = start[:, None] + (end - start)[:, None] * np.concatenate([_NODES, _OWN])
        at_own = values(own.ravel()).reshape(len(a), -1, exact.shape[1])
        nodes = at_own[:, : len(_NODES)]
        each = np.repeat(np.arange(len(a)), len(_OWN))
        guess = _between(start[each], end[each], nodes[each], own[:, len(_NODES) :].ravel())
        off = (_sizes(guess - at_own[:, len(_NODES) :].reshape(guess.shape)) / scale).max(axis=1)
        misfit = off.reshape(len(a), -1).max(axis=1)
        of = np.searchsorted(start, checks, side="right") - 1
        seen = (of >= 0) & (checks <= end[of])
        of = of[seen]
        guess = _between(start[of], end[of], nodes[of], checks[seen])
        np.maximum.at(misfit, of, (_sizes(guess - exact[seen]) / scale).max(axis=1))
        halved = (misfit > _MISFIT) & (b - a > _LEAST_PART)
        starts.append(start[~halved])
        fitted.append(nodes[~halved])
        worst = max(worst, float(misfit[~halved].max(initial=0.0)))
        a, b = a[halved], b[halved]
        middle = (a + b) / 2.0
        middle = np.where(b - a > 1.0, np.round(middle), middle)
        a, b = np.stack([a, middle], axis=1).ravel(), np.stack([middle, b], axis=1).ravel()
    order = np.argsort(np.concatenate(starts))
    return np.concatenate(starts)[order], np.concatenate(fitted)[order], worst


def _between(starts: Floats, ends: Floats, nodes: Floats, times: Floats) -> Floats:
    """Values (K, 9) at times by cubics through values (K, 4, 9) at the `_NODES` of intervals."""
    s = (times - starts) / (ends - starts)
    a, b, c = 3.0 * s - 1.0, 3.0 * s - 2.0, s - 1.0
    weights = np.stack(
        [-a * b * c / 2.0, 4.5 * s * b * c, -4.5 * s * a * c, s * a * b / 2.0], axis=1
    )
    return np.asarray(np.einsum("ki,kij->kj", weights, nodes))


def _sizes(accelerations: Floats) -> Floats:
    """Norms (K, 3) of acceleration, angular velocity and angular acceleration."""
    return np.asarray(np.linalg.norm(accelerations.reshape(-1, 3, 3), axis=2))
