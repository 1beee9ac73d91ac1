"""Do the tendons of a table pull as those of the robot? Swapped tendons, mirrored numbering.

Each candidate for what may have gone wrong (two tendons swapped, numbered the other way round)
predicts by constant curvature where the tip goes. A rigid motion and a gain are fitted, for the
measuring frame need not be the base frame and the robot is not quite an arc; a mirrored order shows
as a motion that would have to mirror. What cannot be told apart is not told.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from bowstring import arc
from bowstring.words import listed, significant

if TYPE_CHECKING:
    from bowstring.measurements import Measurements
    from bowstring.robot import Robot

__all__ = ["TendonCheck", "check_tendons"]

Floats = NDArray[np.float64]
Found = Literal["as_said", "turned", "swapped", "mirrored", "unclear", "unchecked"]

_MOST_ROWS: Final = 400  # enough for a direction, and quick
_FEWEST_ROWS: Final = 4
_MOST_PAIRS: Final = 200
_GAINS: Final = (0.35, 0.5, 0.7, 0.85, 1.0, 1.2)
_CLEARLY: Final = 0.7  # what is left by the better candidate, of what is left as said
_GOOD: Final = 0.4  # what may be left of the motion by a candidate that is believed
_POOR: Final = 0.65  # left as said: an order that explains so little is doubted
_TIE: Final = 1.15
_STILL: Final = 0.005  # of the length: less motion says nothing
_TURNED: Final = np.radians(20)
_WOUND: Final = 4 * 2 * np.pi  # rad by the linear law: no robot is bent so far by its tendons
_UNMOVED: Final = 20.0  # times less bend than motion, which no weight or load makes up for


@dataclass(frozen=True)
class TendonCheck:
    """What the motion of the tip says of the order of the tendons.

    Attributes
    ----------
    found : str
        "as_said"; "turned": as said if the measuring frame is turned about z; "swapped";
        "mirrored"; "unclear": none of these fits, or the tensions are far too large or too small
        for the motion; "unchecked": the data cannot tell.
    sentence : str
    tendons : tuple of int
        The two that look swapped, from 1; empty if none do.
    unexplained : float
        Share of the tip's motion (RMS) that constant curvature leaves with the order as said; NaN
        if unchecked.
    turn : float
        About z, from the base frame to the measuring frame, rad, as said; NaN if unchecked.
    """

    found: Found
    sentence: str
    tendons: tuple[int, ...] = ()
    unexplained: float = np.nan
    turn: float = np.nan

    @property
    def alarm(self) -> bool:
        """Whether something is probably wrong."""
        return self.found in ("swapped", "mirrored", "unclear")

    def __str__(self) -> str:
        return self.sentence


@dataclass(frozen=True)
class _Fit:
    """How well a candidate explains the motion: share left over, and the turn that it takes."""

    left: float
    rotation: Floats

    @property
    def angle(self) -> float:
        """Of the whole rotation, without a mirror, rad."""
        turn = self.rotation
        return float(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))


def check_tendons(robot: Robot, measurements: Measurements) -> TendonCheck:
    """Compare the motion of the tip with that which each tendon should give it.

    Parameters
    ----------
    robot : Robot
    measurements : Measurements
        With as many tendons as the robot.

    Returns
    -------
    TendonCheck
        Two tendons or the sense of numbering are named only where they explain the motion clearly
        better than the order as given.
    """
    if 0 < measurements.without_tip < len(measurements):
        measurements = measurements.select(measurements.seen)
    problem, bends, measured = _data(robot, measurements)
    if problem:
        return TendonCheck("unchecked", f"The order of the tendons is not checked: {problem}.")
    found = _order(robot, measurements, bends, measured)
    doubt = _doubted_tensions(robot, measurements, bends, measured)
    if not doubt or found.found in ("swapped", "mirrored"):
        return found
    # what an order that is unclear would say is no news then
    sentence = doubt if found.found == "unclear" else f"{doubt} {found.sentence}"
    return replace(found, found="unclear", sentence=sentence)


def _order(
    robot: Robot, measurements: Measurements, bends: _Bends, measured: Floats
) -> TendonCheck:
    with_tip = measurements.points.shape[1] > 0
    tool = np.asarray(measurements.tool) if with_tip else np.zeros(3)

    def fit(order: NDArray[np.int64], mirror: bool = False) -> _Fit:
        return _fit(robot, bends(order), measured, tool, mirror, with_tip)

    count = measurements.tendon_count
    same = np.arange(count)
    said = fit(same)
    turn = float(np.arctan2(said.rotation[1, 0], said.rotation[0, 0]))
    swaps = {pair: fit(_swapped(count, pair)) for pair in _pairs(count)}
    mirrored = fit(same, mirror=True)
    best = min([mirrored, *swaps.values()], key=lambda candidate: candidate.left)
    share = f"{100 * said.left:.0f} %"
    if not (best.left < _CLEARLY * said.left and best.left < _GOOD):
        if said.left > _POOR:
            return TendonCheck(
                "unclear",
                f"As the tendons are ordered, constant curvature leaves {share} of the tip's motion"
                " unexplained, and neither two swapped tendons nor the other sense of numbering "
                "explain it: check the order and the sign of all tendons, and the robot.",
                (),
                said.left,
                turn,
            )
        return _agreed(said, swaps, mirrored, turn)
    ties = {pair: f for pair, f in swaps.items() if f.left <= _TIE * best.left}
    # the frame that needs least turning is the likelier, as most are roughly registered
    order = sorted(ties, key=lambda pair: ties[pair].angle)
    named = order[:1]
    if len(order) > 1 and not (
        ties[order[0]].angle < _TURNED and ties[order[1]].angle > 2 * _TURNED
    ):
        named = order
    after = f"{100 * best.left:.0f} %"
    less = f"constant curvature then leaves {after} of the tip's motion unexplained, not {share}"
    if mirrored.left <= _TIE * best.left:
        swap = f", or tendons {_or(named)} are swapped" if named else ""
        return TendonCheck(
            "mirrored",
            "The tip turns the other way round than the tendons do: the measuring frame is "
            f"left-handed, or the tendons are numbered clockwise{swap}; {less}.",
            named[0] if len(named) == 1 else (),
            said.left,
            turn,
        )
    return TendonCheck(
        "swapped",
        f"Tendons {_or(named)} look swapped: {less}.",
        named[0] if len(named) == 1 else (),
        said.left,
        turn,
    )


def _agreed(
    said: _Fit, swaps: dict[tuple[int, int], _Fit], mirrored: _Fit, turn: float
) -> TendonCheck:
    how = "moves" if said.left < _GOOD else "roughly moves"
    text = (
        f"The tip {how} as the tendons say in this order: constant curvature leaves "
        f"{100 * said.left:.0f} % of its motion unexplained"
    )
    alike = [pair for pair, fit in swaps.items() if fit.left <= _TIE * said.left]
    if mirrored.left <= _TIE * said.left:
        text += "; numbered in the other sense they would explain it as well, as in any plane"
    if abs(turn) < _TURNED or said.rotation[2, 2] < np.cos(2 * _TURNED):
        return TendonCheck("as_said", f"{text}.", (), said.left, turn)
    named = [pair for pair in alike if swaps[pair].angle < _TURNED]
    swap = f"tendons {_or(named)} are swapped, " if named else ""
    text += (
        f". That takes a measuring frame turned by {np.degrees(turn):.0f} degrees about z; if it "
        f"is not, {swap}the tendons are numbered from another one, or the sign of the pulls is "
        "wrong"
    )
    return TendonCheck("turned", f"{text}.", named[0] if len(named) == 1 else (), said.left, turn)


def _doubted_tensions(robot: Robot, m: Measurements, bends: _Bends, measured: Floats) -> str:
    """A sentence where the linear law and the motion differ by as much as a wrong unit makes."""
    if np.isnan(m.tensions).any():
        return ""
    bend = float(np.linalg.norm(bends(np.arange(m.tendon_count)), axis=2).max())
    largest = f"{significant(float(m.tensions.max()))} N, the largest tension,"
    advice = "check the unit of the tensions or masses, and E of the robot file."
    if bend > _WOUND:
        turns = significant(bend / (2 * np.pi), 2)
        return f"By the linear law {largest} would wind {robot.name} {turns} times around: {advice}"
    moved = _spread(measured) / (robot.length if m.points.shape[1] else 1.0)
    if moved > _UNMOVED * bend:
        return (
            f"By the linear law {largest} would bend {robot.name} by "
            f"{significant(np.degrees(bend), 2)} degrees only, and the tip moves far more: {advice}"
        )
    return ""


def _or(pairs: list[tuple[int, int]]) -> str:
    return " or ".join(listed([str(a), str(b)]) for a, b in pairs)


def _pairs(count: int) -> Iterator[tuple[int, int]]:
    for pair, _ in zip(combinations(range(1, count + 1), 2), range(_MOST_PAIRS), strict=False):
        yield pair


def _swapped(count: int, pair: tuple[int, int]) -> NDArray[np.int64]:
    order = np.arange(count)
    order[[pair[0] - 1, pair[1] - 1]] = pair[1] - 1, pair[0] - 1
    return order


# -- from data to motion -----------------------------------------------------------------------


def _data(robot: Robot, m: Measurements) -> tuple[str, _Bends, Floats]:
    """Why it cannot be checked, or what bends the segments and where the tip was."""
    nothing = _Bends(np.empty((0, 0)), np.empty((0, 0)))
    none = np.empty((0, 3))
    if m.tendon_count == 0:
        return "the data say of no tendon how it is driven", nothing, none
    if m.tendon_count != len(robot.tendons.angle_rad):
        needed = len(robot.tendons.angle_rad)
        return f"the data have {m.tendon_count} tendons, {robot.name} has {needed}", nothing, none
    if m.points.shape[1]:
        if m.scale is None:
            return "points are in pixels", nothing, none
        if not m.seen.any():
            return "no tip is measured", nothing, none
        measured, size = m.tip, robot.length
    elif m.bend is not None and m.direction is not None:
        across = np.sin(m.bend)
        measured = np.stack(
            [across * np.cos(m.direction), across * np.sin(m.direction), np.cos(m.bend)], axis=1
        )
        size = 1.0
    else:
        return "no point and no direction of bending is measured", nothing, none
    if not np.isnan(m.pulls).any():
        driven, by_tendon = m.pulls, _by_pull(robot)
    elif not np.isnan(m.tensions).any():
        driven, by_tendon = m.tensions, _by_tension(robot)
    else:
        return "some tendons are given by tension and others by pull", nothing, none
    rows = np.unique(np.linspace(0, len(m) - 1, min(len(m), _MOST_ROWS)).round().astype(int))
    rows = rows[np.isfinite(measured[rows]).all(axis=1)]
    if len(rows) < _FEWEST_ROWS:
        return f"it takes {_FEWEST_ROWS} rows or more", nothing, none
    measured = measured[rows]
    if _spread(measured) < _STILL * size:
        return "the tip hardly moves", nothing, none
    return "", _Bends(driven[rows], by_tendon), measured


@dataclass(frozen=True)
class _Bends:
    """Bend vectors of all segments (n, S, 2), rad, from commands (n, T), in any order of tendons.

    By tension they are relative, the largest is a quarter turn.
    """

    driven: Floats
    by_tendon: Floats

    def __call__(self, order: NDArray[np.int64]) -> Floats:
        rows = self.driven[:, order] @ self.by_tendon.T
        return np.asarray(rows.reshape(len(rows), -1, 2))


def _by_pull(robot: Robot) -> Floats:
    """(2 S, T): bends of the segments by pulls, least squares; tendons run parallel.

    What lengthens or shortens a segment's tendons alike does not bend it.
    """
    tendons, count = robot.tendons, len(robot.segments)
    rows = np.zeros((len(tendons.angle_rad), 3 * count))
    for i, (hole, segment) in enumerate(zip(tendons.hole_m, tendons.segment, strict=True)):
        for j in range(segment + 1):
            rows[i, 2 * j : 2 * j + 2] = hole
        rows[i, 2 * count + segment] = np.linalg.norm(hole)
    return np.asarray(np.linalg.pinv(rows, rcond=1e-9)[: 2 * count])


def _by_tension(robot: Robot) -> Floats:
    """(2 S, T): bends of the segments by tensions, the linear law."""
    tendons = robot.tendons
    out = np.zeros((2 * len(robot.segments), len(tendons.angle_rad)))
    for j, segment in enumerate(robot.segments):
        passes = tendons.segment >= j
        law = segment.length / robot.bending_stiffness[j]
        out[2 * j : 2 * j + 2, passes] = law * tendons.hole_m[passes].T
    return out


def _fit(
    robot: Robot, bends: Floats, measured: Floats, tool: Floats, mirror: bool, with_tip: bool
) -> _Fit:
    """The best of the gains, each with the rigid motion that fits it best."""
    largest = float(np.linalg.norm(bends, axis=2).max())
    if largest == 0:
        return _Fit(1.0, np.eye(3))
    # stiffness may be far from that of the file, so tensions wind up or do nothing: a bend at most
    bends = bends * min(1.0, 2.5 / largest)
    fits = []
    for gain in _GAINS:
        position, axis = _tips(robot, gain * bends, tool)
        predicted = position if with_tip else axis
        if mirror:
            predicted = predicted * [1.0, -1.0, 1.0]
        fits.append(_rigid(predicted, measured))
    return min(fits, key=lambda fit: fit.left)


def _tips(robot: Robot, bends: Floats, tool: Floats) -> tuple[Floats, Floats]:
    """Measured point and direction of the tip (n, 3) of segments in series."""
    n = len(bends)
    position, rotation = np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3))
    for j, segment in enumerate(robot.segments):
        x, y = bends[:, j].T
        pose = arc.pose(np.hypot(x, y) / segment.length, np.arctan2(y, x), segment.length)
        position = position + (rotation @ pose.position[..., None])[..., 0]
        rotation = rotation @ pose.rotation
    return position + rotation @ tool, rotation[..., 2]


def _spread(points: Floats) -> float:
    centred = points - points.mean(axis=0)
    return float(np.sqrt((centred**2).sum(axis=1).mean()))


def _rigid(predicted: Floats, measured: Floats) -> _Fit:
    """Least-squares rotation and translation without a mirror (Kabsch 1976)."""
    a = predicted - predicted.mean(axis=0)
    b = measured - measured.mean(axis=0)
    u, _, vt = np.linalg.svd(b.T @ a)
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    left = np.sqrt(((b - a @ turn.T) ** 2).sum(axis=1).mean())
    return _Fit(min(float(left) / _spread(measured), 1.0), turn)
