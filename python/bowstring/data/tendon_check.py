"""Check of the tendon order in measurements: swapped tendons, mirrored numbering, shifted clocks.

Each candidate error (two tendons swapped, reversed sense of numbering) predicts the tips by
constant curvature. A rigid motion and a gain are fitted, because the measuring frame may differ
from the base frame and the robot is not exactly an arc. A mirrored order shows as a fitted motion
that would have to contain a reflection. Candidates that explain the data equally well are not
distinguished. Clocks of commands and tips that are apart look like any wrong order, and are judged
first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations, islice, pairwise
from typing import TYPE_CHECKING, Annotated, Final, Literal

import numpy as np

from bowstring.aliases import Floats, Ints
from bowstring.constant_curvature import Arc, RobotArcs
from bowstring.data.channels import advice, likely_zero, spikes
from bowstring.data.rigid import align
from bowstring.errors import BowstringError
from bowstring.formatting import in_mm, listed, significant
from bowstring.results import Key, Result
from bowstring.robot.model import check_robot
from bowstring.statics import actuation
from bowstring.validation import check_is_read

if TYPE_CHECKING:
    from bowstring.data.measurements import Measurements
    from bowstring.robot.model import Robot

Found = Literal["as_stated", "turned", "swapped", "mirrored", "unclear", "unchecked"]

_MOST_ROWS: Final = 400  # enough for a direction, and fast
_FEWEST_ROWS: Final = 4
_MOST_PAIRS: Final = 200
_GAINS: Final = (0.35, 0.5, 0.7, 0.85, 1.0, 1.2)
_NEAR: Final = (0.6, 0.8, 1.0, 1.2, 1.5)  # gains over the best one of the stated order
_CLEARLY: Final = 0.7  # residual of a better candidate over that of the stated order
_GOOD: Final = 0.4  # residual over motion up to which a candidate is accepted
_ROUNDING: Final = 1e-6  # residual over motion that is rounding, of synthetic data
_POOR: Final = 0.65  # residual over motion above which the stated order is doubtful
_TIE: Final = 1.15
_STILL: Final = 0.005  # motion over length that is too small for the check
_TURNED: Final = np.radians(20)
_WOUND: Final = 4 * 2 * np.pi  # rad by the linear law; more than tendons can bend a robot
_TURN: Final = 2 * np.pi
_MOST_BENT: Final = 4.0  # rad
_MOST_SOLVED: Final = 60  # rows
_FACTOR: Final = 6.0  # between errors of an uncalibrated stiffness and those of a wrong unit
_LESS_BY_FAR: Final = 50.0
_HARD: Final = 3.0  # tension over that of half a turn, beyond which tendons do not co-contract
_ALL: Final = 0.05  # share of rows that may be without a common displacement
_CONSTANT: Final = 0.5  # least common displacement over the largest, above which it is constant
_ABOVE: Final = 0.05  # reading without load over the range, above which it is a zero
_SAME: Final = 0.03  # difference of unexplained shares that says nothing
_STRAIGHT: Final = 0.01  # distance of a tip from that of the straight robot over its length
_LATE: Final = 1 / 3  # unexplained share with the clocks shifted over that without
_IN_TIME: Final = 0.1  # unexplained share up to which a shift of the clocks is no alarm
_NEARLY: Final = 0.05  # and up to which none is searched
_MOST_SAMPLES: Final = 16_384  # of an even grid of times
_MOST_PEAKS: Final = 9
_ALIKE: Final = 0.05  # unexplained share below which shifts are equally good
_PLAYS: Final = (0.02, 0.05, 0.1, 0.2, 0.4)  # widths of backlash over the largest bend
_FEWEST_SHIFTED: Final = 20  # rows
_MOST_BALANCES: Final = 5_000  # sets of tendons
_BALANCED: Final = 1e-6
_SHORTER: Final = 0.03  # shortening over the length that a tip at its place without load disproves
_UNITS: Final = "check the unit of the tensions or masses, and E of the robot file."
_UNMOVED: Final = 20.0  # ratio of motion to bend that no weight or load explains


@dataclass(frozen=True)
class TendonCheck(Result):
    """Result of the check of the tendon order against the motion of the tip."""

    found: Annotated[Found, Key()]
    """``as_stated``: the stated order. ``turned``: the stated order, if the measuring frame is
    turned about z. ``swapped``: two tendons are interchanged. ``mirrored``: the tendons are
    numbered in the opposite direction. ``unclear``: none of these; or tips, tensions or
    displacements are several times too large or small, as in another unit. ``unchecked``: the data
    do not allow the check."""
    sentence: Annotated[str, Key()]
    """Result as a sentence."""
    tendons: Annotated[tuple[int, ...], Key()] = ()
    """Numbers of the two tendons that look swapped, from 1; empty if none do."""
    unexplained: Annotated[float, Key()] = np.nan
    """Share of the tip's motion (RMS) that constant curvature does not explain in the stated order;
    NaN if unchecked."""
    turn: Annotated[float, Key("turn_rad")] = np.nan
    """Angle about z of the base frame in the measuring frame in the stated order, rad; NaN if
    unchecked."""

    remark: Annotated[str, Key()] = ""
    """Question that the data leave open, as part of the sentence: tensions that never come near
    zero are a pretension, or load cells with another zero. Empty without one."""

    @property
    def alarm(self) -> bool:
        """Whether an error is probable."""
        return self.found in ("swapped", "mirrored", "unclear")

    def __str__(self) -> str:
        return self.sentence


@dataclass(frozen=True)
class _Fit:
    """Fit of a candidate to the motion: unexplained share, and rotation of the frame."""

    left: float
    rotation: Floats

    @property
    def angle(self) -> float:
        """Angle of the rotation without reflection, rad."""
        turn = self.rotation
        return float(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))


def check_tendons(
    robot: Robot,
    measurements: Measurements,
    *,
    zero_is_fitted: bool = False,
    delay_is_fitted: bool = False,
) -> TendonCheck:
    """Check the order of the tendons against the measured motion of the tip.

    Parameters
    ----------
    robot : Robot
        The robot that was measured.
    measurements : Measurements
        Measurements with as many tendons as the robot.
    zero_is_fitted : bool
        Whether a fit finds the zeros of tensions, so that they are no doubt: the likely ones are
        taken off.
    delay_is_fitted : bool
        Whether a fit finds the delay of the tips, so that clocks that are apart are no doubt.

    Returns
    -------
    TendonCheck
        Result; it names two tendons or the sense of numbering only if they explain the motion
        clearly better than the stated order.
    """
    check_robot(robot)
    check_is_read(measurements)
    if 0 < measurements.without_tip < len(measurements):
        measurements = measurements.select(measurements.seen)
    is_whole = measurements.tendon_count == len(robot.tendons.pushes)
    if zero_is_fitted and is_whole and not np.isnan(measurements.tensions).any():
        zeros = np.nan_to_num(likely_zeros(measurements.tensions, robot))
        loads = np.maximum(measurements.tensions - zeros, robot.tendons.least_tension_N)
        measurements = replace(measurements, tensions=loads)
    problem, motion = _motion(robot, measurements)
    if problem and motion is not None and (doubt := _doubted_size(motion)):
        return TendonCheck("unclear", doubt)
    if problem or motion is None:
        unchecked = f"The order of the tendons is not checked: {problem}."
        if doubt := _doubted_displacements(robot, measurements):
            return TendonCheck("unclear", f"{doubt} {unchecked}")
        return TendonCheck("unchecked", unchecked)
    found = _timed_order(motion, delay_is_fitted)
    doubted, remark = _unloaded(motion)
    doubt = _doubted_commands(motion) or doubted or _doubted_size(motion)
    if remark:
        found = replace(
            found,
            remark=f"{found.remark} {remark}".strip(),
            sentence=f"{found.sentence} {remark}",
        )
    if not doubt or found.found in ("swapped", "mirrored"):
        return found
    # an unclear order adds nothing to the doubt
    sentence = doubt if found.found == "unclear" else f"{doubt} {found.sentence}"
    return replace(found, found="unclear", sentence=sentence)


def _timed_order(motion: _Motion, delay_is_fitted: bool) -> TendonCheck:
    """Judge the order of the tendons, after the clocks of commands and tips."""
    found = _order(motion)
    if found.unexplained <= _NEARLY or motion.m.time is None:
        return found
    delay = _delay(motion)
    late = motion.delayed(delay) if delay else None
    if late is None:
        return found
    order = _order(late)
    wrong = ("swapped", "mirrored")
    less = found.unexplained**2 - order.unexplained**2
    is_late = found.unexplained > _IN_TIME and (
        order.found in wrong or order.unexplained <= _LATE * found.unexplained
    )
    # arcs fit less well than a regression, and must gain as much by the shift
    gain = motion.unexplained() ** 2 - late.unexplained() ** 2
    is_proven = not {found.found, order.found} & {*wrong} and less > max(_NEARLY**2, 0.5 * gain)
    if order.found == "unclear" or not (is_late or is_proven):
        return found
    if delay_is_fitted:
        return order
    share = f"{100 * found.unexplained:.0f} %"
    if motion.m.join is None:
        seconds = significant(abs(delay))
        say = f"The tips are {seconds} s {'behind' if delay > 0 else 'ahead of'} the commands"
        cure = "shift the column of one of them, or fit the delay (--parameter delay)"
    else:
        joined = motion.m.join
        shift = joined.shift + (delay if joined.has_commands else -delay)
        say = f"The clocks of commands and tips are {significant(abs(delay))} s apart"
        cure = f"write shift: {significant(shift)} s in the mapping's join"
    if not is_late:
        remark = (
            f"{say}: {cure}. Constant curvature then leaves {100 * order.unexplained:.0f} % of "
            f"{motion.called} unexplained, not {share}."
        )
        return replace(found, remark=remark, sentence=f"{found.sentence} {remark}")
    sentence = (
        f"{say}, which leaves {share} of {motion.called} unexplained: {cure}. Then: "
        f"{order.sentence}"
    )
    return replace(order, found="unclear", sentence=sentence)


def _delay(motion: _Motion) -> float:
    """Delay of the tips behind the commands that explains them best, s; 0 if none is better.

    Peaks of the cross-correlation of the tips with the bends by the linear law, in any order and
    frame; the best peak is refined by regression. Hysteresis is late too: a delay must explain what
    backlashes of several widths do not.
    """
    time, tips = motion.m.time, motion.every
    assert time is not None
    seen = np.isfinite(tips).all(axis=1)
    if seen.sum() < 2 * _FEWEST_SHIFTED or not (np.diff(time) > 0).all():
        return 0.0
    time, tips, bends = time[seen], tips[seen], motion.every_command[seen] @ motion.by_tendon.T
    # a grid as fine as the samples, as far as their number allows
    span, step = float(time[-1] - time[0]), float(np.median(np.diff(time)))
    count = int(min(max(span / step, len(time)), _MOST_SAMPLES)) + 1
    even, step = np.linspace(time[0], time[-1], count, retstep=True)
    b, y = (
        np.stack([np.interp(even, time, column) for column in given.T]) for given in (bends, tips)
    )
    b, y = (each - each.mean(axis=1, keepdims=True) for each in (b, y))
    size = 2 * count
    by_lag = np.fft.irfft(np.fft.rfft(y, size)[:, None] * np.fft.rfft(b, size).conj(), size)
    half = count // 2
    lags = np.arange(-half, half + 1)
    overlap = count - np.abs(lags)
    common = by_lag[..., lags] / overlap
    explained = np.einsum("yan,ab,ybn->n", common, np.linalg.pinv(b @ b.T / count), common)
    peaks = 1 + np.flatnonzero(
        (explained[1:-1] >= explained[:-2]) & (explained[1:-1] >= explained[2:])
    )
    peaks = peaks[np.argsort(-explained[peaks])][:_MOST_PEAKS]

    def left(delay: float, plays: Sequence[float] = ()) -> float:
        late = motion.delayed(delay)
        return np.inf if late is None else late.unexplained(plays)

    if not len(peaks):
        return 0.0

    def refined(delay: float, width: float) -> float:
        return float(min(delay + width * np.linspace(-1, 1, 11), key=left))

    tried = [refined(delay, step) for delay in lags[peaks] * step]
    tried.append(refined(0.0, span / 20))  # of a periodic motion the peaks may be others
    least = min(map(left, tried))
    # a periodic motion has several, of which the smallest is the most probable
    best = min((delay for delay in tried if left(delay) <= max(_TIE * least, _ALIKE)), key=abs)
    wide = refined(best, span / 20)  # the correlation of a single ramp has its peak aside
    best = wide if left(wide) < _CLEARLY * left(best) else best
    width = span / 100
    while width > 0.01 * step:
        best = refined(best, width)
        width /= 5
    is_proven = all(left(best, plays) < _CLEARLY * left(0.0, plays) for plays in ((), _PLAYS))
    is_sure = min(left(0.75 * best), left(1.25 * best)) > _TIE * left(best)
    return float(best) if is_proven and is_sure else 0.0


def _order(motion: _Motion) -> TendonCheck:
    count = motion.m.tendon_count
    same = np.arange(count)
    # gravity or a wrong unit may bend the robot far less than the tendons alone
    gain, _ = _best_gain(motion, motion.bends(same), motion.measured)
    within = _capped(motion.bends(same))
    usual = within * min(_GAINS) <= gain <= within * max(_GAINS)
    gains = [] if usual else [gain * factor for factor in _NEAR]

    def fit(order: Ints, mirror: bool = False) -> _Fit:
        return _fit(motion, motion.bends(order), mirror, gains)

    def check(found: Found, sentence: str, pairs: Sequence[tuple[int, int]] = ()) -> TendonCheck:
        named = pairs[0] if len(pairs) == 1 else ()
        return TendonCheck(found, sentence, named, said.left, turn)

    said = fit(same)
    turn = float(np.arctan2(said.rotation[1, 0], said.rotation[0, 0]))
    pairs = islice(combinations(range(1, count + 1), 2), _MOST_PAIRS)
    swaps = {pair: fit(_swapped(count, pair)) for pair in pairs}
    mirrored = fit(same, mirror=True)
    best = min([mirrored, *swaps.values()], key=lambda candidate: candidate.left)
    share = f"{100 * said.left:.0f} %"
    if not (best.left < _CLEARLY * said.left and best.left < _GOOD and said.left > _ROUNDING):
        if said.left > _POOR:
            return check(
                "unclear",
                f"As the tendons are ordered, constant curvature leaves {share} of {motion.called}"
                " unexplained, and neither two swapped tendons nor the reversed numbering "
                "explain it: check the order and the sign of all tendons, the clocks of commands "
                "and tips if two tables are joined, and the robot.",
            )
        return check(*_agreed(motion.called, said, swaps, mirrored, turn))
    ties = {pair: f for pair, f in swaps.items() if f.left <= _TIE * best.left}
    # the smallest rotation of the frame is the most probable: most are roughly aligned
    order = sorted(ties, key=lambda pair: ties[pair].angle)
    named = order[:1]
    if len(order) > 1 and not (
        ties[order[0]].angle < _TURNED and ties[order[1]].angle > 2 * _TURNED
    ):
        named = order
    less = (
        f"constant curvature then leaves {100 * best.left:.0f} % of {motion.called} unexplained, "
        f"not {share}"
    )
    if mirrored.left <= _TIE * best.left:
        swap = f", or tendons {_or(named)} are swapped" if named else ""
        return check(
            "mirrored",
            "The tip turns the other way round than the tendons do: the measuring frame is "
            f"left-handed, or the tendons are numbered clockwise{swap}; {less}.",
            named,
        )
    return check("swapped", f"Tendons {_or(named)} look swapped: {less}.", named)


def _agreed(
    called: str, said: _Fit, swaps: dict[tuple[int, int], _Fit], mirrored: _Fit, turn: float
) -> tuple[Found, str, list[tuple[int, int]]]:
    """Result for a stated order that explains the motion: kind, message, and possible swaps."""
    how = "agrees" if said.left < _GOOD else "roughly agrees"
    text = (
        f"{called.capitalize()} {how} with the tendon order: constant curvature leaves "
        f"{100 * said.left:.0f} % of it unexplained"
    )
    alike = [pair for pair, fit in swaps.items() if fit.left <= _TIE * said.left]
    if mirrored.left <= _TIE * said.left:
        text += "; a planar motion cannot distinguish the reversed numbering"
    if abs(turn) < _TURNED or said.rotation[2, 2] < np.cos(2 * _TURNED):
        return "as_stated", f"{text}.", []
    named = [pair for pair in alike if swaps[pair].angle < _TURNED]
    swap = f"tendons {_or(named)} are swapped, " if named else ""
    others = "the tendons are numbered from another one"
    sign = "the sign of the displacements is wrong"
    is_half = abs(turn) > np.pi - _TURNED
    errors = f"{sign}, {swap}or {others}" if is_half else f"{swap}{others}, or {sign}"
    text += (
        f". That takes a base turned by {np.degrees(turn):.0f} degrees about z in the measuring "
        f"frame; if it is not, {errors}"
    )
    return "turned", f"{text}.", named


def _doubted_commands(motion: _Motion) -> str:
    """Warn if tensions or displacements are wrong by a factor, as from a wrong unit."""
    robot, m = motion.robot, motion.m
    bends = np.linalg.norm(motion.bends(), axis=2)
    if motion.by_displacement:
        return _wound(robot, m, bends) or _shifted(motion)
    if wound := wound_by_tensions(robot, motion.commands):
        return wound
    bend = float(bends.max())
    largest = f"{significant(float(m.tensions.max()))} N, the largest tension,"
    moved = _spread(motion.measured) / motion.size
    if moved > _UNMOVED * bend:
        return (
            f"By the linear law {largest} would bend {robot.name} by "
            f"{significant(np.degrees(bend), 2)} degrees only, and the tip {motion.move}s far "
            f"more: {_UNITS}"
        )
    return ""


def wound_by_tensions(robot: Robot, tensions: Floats) -> str:
    """Warn of tensions (n, T) in N that wind a robot around, as of a wrong unit; else empty."""
    if robot.is_coupled:
        return ""
    bends = (tensions @ _by_tension(robot).T).reshape(len(tensions), -1, 2)
    bend = float(np.linalg.norm(bends, axis=2).max())
    if bend <= _WOUND:
        return ""
    return (
        f"By the linear law {significant(float(tensions.max()))} N, the largest tension, would "
        f"wind {robot.name} {significant(bend / _TURN, 2)} times around: {_UNITS}"
    )


def _doubted_displacements(robot: Robot, m: Measurements) -> str:
    """Warn of displacements of a wrong size, one by one, where other tendons have tensions."""
    if m.tendon_count != len(robot.tendons.angle_rad) or np.isnan(m.displacements).all():
        return ""
    arm = robot.tendons.arm_m
    return _wound(robot, m, np.abs(m.displacements) / np.where(arm > 0, arm, np.inf))


def _unloaded(motion: _Motion) -> tuple[str, str]:
    """Doubt, or else remark, on tensions that read well above zero without load.

    It is a doubt if the tips in the axes of the base fit better without these readings; a
    pretension would fit worse. What does not change the fit may be either.
    """
    m = motion.m
    span = np.ptp(m.tensions, axis=0)
    if motion.by_displacement or not span.any():
        return "", ""
    zeros = likely_zeros(m.tensions, motion.robot)
    is_shifted = (np.abs(zeros) > _ABOVE * span) & (span > 0.0)
    if not is_shifted.any():
        return "", ""
    without = replace(motion, commands=motion.commands - np.where(is_shifted, zeros, 0.0))
    as_read, mended = (
        _best_gain(each, each.bends(), motion.measured, _in_base)[1] for each in (motion, without)
    )
    tendons = listed([str(k + 1) for k in np.flatnonzero(is_shifted)])
    least = listed([significant(zero) for zero in zeros[is_shifted]])
    named = f"tendon {tendons} reads" if is_shifted.sum() == 1 else f"tendons {tendons} read"
    if mended < min(_CLEARLY * as_read, _GOOD):
        shares = (f"{100 * left:.0f} %" for left in (mended, as_read))
        return (
            f"Without load {named} {least} N, as load cells with another zero do: without it "
            f"constant curvature leaves {' and not '.join(shares)} of {motion.called} "
            f"unexplained.{_named_zeros(m, zeros)}"
        ), ""
    is_same = abs(mended - as_read) < _SAME or min(mended, as_read) > _GOOD
    if is_same and is_shifted.sum() > 1 and is_shifted[span > 0.0].all():
        return "", (
            f"No tendon comes near zero: {named} {least} N at least. If that is no pretension, the "
            f"load cells have another zero.{_named_zeros(m, zeros)}"
        )
    return "", ""


def likely_zeros(tensions: Floats, robot: Robot) -> Floats:
    """Readings (T,) of tensions (K, T) without load; NaN without one, and for what pushes."""
    found = [likely_zero(column) for column in tensions.T]
    return np.where(robot.tendons.pushes, np.nan, found)


def _named_zeros(m: Measurements, si: Floats) -> str:
    """Advice, after a blank, by zeros (T,) in SI or NaN; empty without columns of a table."""
    if not m.columns:
        return ""
    zeros = [
        (column.name, column.reading(value))
        for column, value in zip(m.columns, si.tolist(), strict=True)
    ]
    return f" {advice(zeros)}"


def _shifted(motion: _Motion) -> str:
    """Warn of a displacement common to all tendons, or of signs that make it one."""
    doubt = _common(motion)
    if not doubt:
        return ""
    as_read, turned = (
        _best_gain(motion, sign * motion.bends(), motion.measured, _in_base)[1] for sign in (1, -1)
    )
    if not turned < min(_CLEARLY * as_read, _GOOD):
        return doubt
    sign = (
        f"The sign of the displacements looks turned: with it constant curvature leaves "
        f"{100 * as_read:.0f} % of {motion.called} unexplained, and {100 * turned:.0f} % without. "
        "Write positive: lengthened in the mapping's tendons."
    )
    # zeros, where the others have one besides
    return f"{sign} {doubt}" if _common(replace(motion, commands=-motion.commands)) else sign


def _common(motion: _Motion) -> str:
    """Warn of a displacement common to all tendons of a segment that its backbone cannot follow.

    Constant curvature bends by the differences of displacements alone, and hides it. The backbone
    shortens by the displacement that is common; tendons that are all lengthened are slack.
    """
    robot, tendons = motion.robot, motion.robot.tendons
    # tension of one tendon that bends the robot by half a turn
    half_turn = np.pi / max(float(np.abs(_by_tension(robot)).max()), 1e-300)
    softness = np.array([s.length for s in robot.segments]) / robot.axial_stiffness
    for segment in range(len(robot.segments)):
        own = tendons.segment == segment
        holes = np.concatenate(tendons.mean_hole_m[: segment + 1, own], axis=1)
        balances = _balances(holes)
        if not len(balances):  # bends by a single tendon have it too
            continue
        given = motion.commands[:, own]
        slack = given.max(axis=1)
        shift = (given @ balances.T).max(axis=1)
        common, most = np.quantile(shift, [_ALL, 1.0 - _ALL]).tolist()
        passing = [float((tendons.segment >= j).sum()) for j in range(segment + 1)]
        give = tendons.compliance_m_per_N[own].max() + float(passing @ softness[: segment + 1])
        give += robot.length / float(tendons.axial_stiffness_N[own].min())
        give += float(tendons.mount_compliance_m_per_N[own].max()) * len(tendons.segment)
        where = f" of segment {segment + 1}" if len(robot.segments) > 1 else ""
        zeros = np.where(own, np.median(shift), np.nan)
        away = np.linalg.norm(motion.measured - motion.tips(0.0 * motion.bends()[:1]), axis=1)
        row = int(np.argmin(away))
        is_straight = away[row] < _STRAIGHT * motion.size
        if is_straight:  # also where each tendon has a zero of its own
            zeros = np.where(own, motion.commands[row], np.nan)
        cure = (
            "The commands are not displacements from the straight robot: take those of the "
            f"straight robot off all rows.{_named_zeros(motion.m, zeros)}"
        )
        if (slack < 0.0).mean() > 1.0 - _ALL:
            least = in_mm(float(-np.quantile(slack, 1.0 - _ALL)))
            return (
                f"All tendons{where} are lengthened by {least} or more in all rows, which would "
                f"leave them slack. {cure}"
            )
        # no constant where the others lengthen less than one is shortened
        if common > max(_HARD * half_turn * give, _CONSTANT * most):
            force = f"{significant(common / give)} N in each"
            return (
                f"The displacements{where} have {in_mm(common)} or more in common in all rows, and "
                f"{robot.name} cannot shorten by that (it would take {force} tendon). {cure}"
            )
        is_longer = shift[row] > _SHORTER * robot.length and not _is_elastic(robot)
        if is_straight and motion.with_tip and is_longer:
            line = int(motion.m.line[motion.rows[row]])
            return (
                f"In line {line} the displacements{where} have {in_mm(float(shift[row]))} in "
                f"common, by which {robot.name} would be shorter, and the tip is where the "
                f"straight robot has it. {cure}"
            )
    return ""


def _balances(holes: Floats) -> Floats:
    """Weights (V, T) of few tendons whose sum no bend changes, none negative, in sum 1.

    The backbone is at least as much shorter as the displacements by the weights are in sum, because
    a tendon may be slack, and not too short. `holes` (T, 2 S) are those of each segment.
    """
    given = np.column_stack([holes / max(float(np.abs(holes).max()), 1e-300), np.ones(len(holes))])
    sums, found = np.r_[np.zeros(holes.shape[1]), 1.0], []
    sizes = range(1, int(np.linalg.matrix_rank(given, tol=1e-9)) + 1)
    few = chain.from_iterable(combinations(range(len(holes)), size) for size in sizes)
    for tendons in islice(few, _MOST_BALANCES):
        weights = np.linalg.lstsq(given[list(tendons)].T, sums)[0]
        is_exact = np.abs(weights @ given[list(tendons)] - sums).max() < _BALANCED
        if is_exact and weights.min() > _BALANCED:
            found.append(np.zeros(len(holes)))
            found[-1][list(tendons)] = weights
    return np.array(found)


def _wound(robot: Robot, m: Measurements, bends: Floats) -> str:
    bend = float(np.nanmax(bends))
    if bend <= _TURN or _is_elastic(robot):
        return ""
    return (
        f"{in_mm(float(np.nanmax(np.abs(m.displacements))))}, the largest displacement, would wind "
        f"{robot.name} {significant(bend / _TURN, 2)} times around: check the unit of the "
        "displacements, and the pitch radius of the robot file."
    )


def _doubted_size(motion: _Motion) -> str:
    """Warn if the motion is several times larger or smaller than that of the robot file.

    The same arcs are fitted to the measured motion and to the expected one, by geometry from
    displacements and by statics from tensions; their gains are compared.
    """
    robot, m, measured = motion.robot, motion.m, motion.measured
    reach = robot.length + float(np.linalg.norm(motion.tool))
    middle = np.median(measured, axis=0)
    if motion.with_tip and np.linalg.norm(measured - middle, axis=1).max() > 2 * reach:
        return (
            f"The tips lie farther apart than {robot.name} reaches, which is {in_mm(robot.length)} "
            "long: check the unit of the tip's columns."
        )
    expected, rows = _expected(motion)
    if len(rows) < _FEWEST_ROWS:
        return ""
    measured, bent = measured[rows], motion.bends()[rows]
    still = _STILL * motion.size
    if not bent.any() or max(_spread(measured), _spread(expected)) < still:
        return ""
    moved = _spread(measured) / max(_spread(expected), 1e-12 * still)
    if moved > 1 / _LESS_BY_FAR:  # otherwise the motion is too small to fit an arc
        gains = [_best_gain(motion, bent, points) for points in (measured, expected)]
        if max(left for _, left in gains) > _POOR:
            return ""
        moved = gains[0][0] / gains[1][0]
    if 1 / _FACTOR < moved < _FACTOR:
        return ""
    if motion.by_displacement:
        what, rest = "displacements", "the pitch radius"
        shown = in_mm(float(np.abs(m.displacements).max()))
    else:
        what, rest = "tensions or masses", "E and gravity"
        shown = f"{significant(float(np.abs(m.tensions).max()))} N"
    move, columns = motion.move, "tip's columns" if motion.with_tip else "angles"
    if moved < 1e-6:
        how = f"does not {move}, though"
    else:
        more = "more" if moved > 1 else "less"
        how = f"{move}s {significant(max(moved, 1 / moved), 2)} times {more} than"
    return (
        f"The tip {how} {robot.name} would by these {what} (up to {shown}): check the unit of the "
        f"{columns} and of the {what}, and {rest} of the robot file."
    )


def _expected(motion: _Motion) -> tuple[Floats, Ints]:
    """Expected tips, and the rows for which they are known."""
    from bowstring.statics import rod
    from bowstring.statics.load import Load

    arcs = motion.bends()
    rows = np.flatnonzero(np.linalg.norm(arcs, axis=2).max(axis=1) <= _TURN / 2)
    if len(rows) < _FEWEST_ROWS or not arcs[rows].any():  # strong bends inform less
        rows = np.arange(len(arcs))
    some = np.linspace(0, len(rows) - 1, min(len(rows), _MOST_SOLVED)).round().astype(int)
    rows = rows[np.unique(some)]
    if motion.by_displacement and not _is_elastic(motion.robot):
        return motion.tips(arcs[rows]), rows
    load = Load(
        **{"displacements" if motion.by_displacement else "tensions": motion.commands[rows]}
    )
    try:
        found = rod.solve_batch(motion.robot, load=load, disks=False)
    except BowstringError:
        return np.empty((0, 3)), rows[:0]
    good = np.asarray(found.converged)
    return motion.seen(found.tip_position[good], found.tip_rotation[good]), rows[good]


def _is_elastic(robot: Robot) -> bool:
    """Whether a tendon, its transmission or its holes take up a part of a displacement."""
    tendons = robot.tendons
    takes = (
        np.isfinite(tendons.axial_stiffness_N),
        tendons.compliance_m_per_N,
        tendons.mount_compliance_m_per_N,
        tendons.hole_clearance_m,
    )
    return any(each.any() for each in takes)


def _best_gain(
    motion: _Motion,
    bends: Floats,
    measured: Floats,
    unexplained: Callable[[Floats, Floats], float] | None = None,
) -> tuple[float, float]:
    """Factor on all bends with the best fit of arcs to the motion, and the unexplained share."""
    unexplained = unexplained or (lambda predicted, tips: _rigid(predicted, tips).left)
    largest = float(np.linalg.norm(bends, axis=2).max())
    if largest == 0 or _spread(measured) == 0:
        return 1.0, 1.0
    bent = np.logspace(-5, np.log10(_MOST_BENT), 40)

    def left(angle: float) -> float:
        return unexplained(motion.tips(bends * (angle / largest)), measured)

    for _ in range(2):
        at = int(np.argmin(found := [left(angle) for angle in bent]))
        best = (float(bent[at]), found[at])
        bent = np.geomspace(bent[max(0, at - 1)], bent[min(len(bent) - 1, at + 1)], 12)
    return best[0] / largest, best[1]


def _or(pairs: list[tuple[int, int]]) -> str:
    return " or ".join(listed([str(a), str(b)]) for a, b in pairs)


def _swapped(count: int, pair: tuple[int, int]) -> Ints:
    order = np.arange(count)
    order[[pair[0] - 1, pair[1] - 1]] = pair[1] - 1, pair[0] - 1
    return order


# -- from data to motion -----------------------------------------------------------------------


@dataclass(frozen=True)
class _Motion:
    """Actuation of a robot and measured tips (n, 3), in some of the rows."""

    robot: Robot
    m: Measurements
    commands: Floats
    """Displacements or tensions (n, T)."""
    by_tendon: Floats
    """Derivatives (2 S, T) of the segments' bends by these, rad per m or N."""
    measured: Floats
    """Tips or, if no point is measured, directions of the tip."""
    rows: Ints
    """Indices of these rows in the measurements."""
    every: Floats
    """Tips or directions in all rows."""
    every_command: Floats
    """Displacements or tensions in all rows, after the delays of the drives."""

    def delayed(self, delay: float) -> _Motion | None:
        """Motion whose tips are some time behind the commands, s; None with too few rows."""
        time = self.m.time
        assert time is not None
        asked = time[self.rows] - delay
        inside = (asked >= time[0]) & (asked <= time[-1])
        if inside.sum() < max(_FEWEST_SHIFTED, len(self.rows) / 3):
            return None
        commands = np.stack(
            [np.interp(asked[inside], time, column) for column in self.every_command.T], axis=1
        )
        measured, rows = self.measured[inside], self.rows[inside]
        return replace(self, commands=commands, measured=measured, rows=rows)

    def unexplained(self, plays: Sequence[float] = ()) -> float:
        """Share of the motion that no polynomial of degree 2 in the bends explains.

        With `plays`, widths of backlash over the largest bend, hysteresis is explained too.
        """
        bends = self.commands @ self.by_tendon.T
        bends = bends / max(float(np.abs(bends).max()), 1e-300)
        pairs = [bends[:, i] * bends[:, j] for i in range(bends.shape[1]) for j in range(i + 1)]
        played = [_played(bends, width) for width in plays]
        given = np.column_stack([np.ones(len(bends)), bends, *pairs, *played])
        left = self.measured - given @ np.linalg.lstsq(given, self.measured, rcond=None)[0]
        free = max(len(given) - given.shape[1], 1) / len(given)
        return float(np.sqrt((left**2).sum(axis=1).mean() / free)) / _spread(self.measured)

    @property
    def by_displacement(self) -> bool:
        return not np.isnan(self.m.displacements).any()

    @property
    def with_tip(self) -> bool:
        return bool(self.m.points.shape[1])

    @property
    def move(self) -> str:
        """Verb of the measured motion."""
        return "move" if self.with_tip else "turn"

    @property
    def called(self) -> str:
        """Measured motion in words."""
        return "the tip's motion" if self.with_tip else "the tip's rotation"

    @property
    def tool(self) -> Floats:
        return np.asarray(self.m.tool) if self.with_tip else np.zeros(3)

    @property
    def size(self) -> float:
        """Reference size of a motion."""
        return self.robot.length if self.with_tip else 1.0

    def bends(self, order: Ints | None = None) -> Floats:
        """Bend vectors of all segments (n, S, 2), rad, for an order of the tendons.

        Those by tension are relative; the largest is a quarter turn.
        """
        commands = self.commands if order is None else self.commands[:, order]
        return np.asarray((commands @ self.by_tendon.T).reshape(len(commands), -1, 2))

    def seen(self, position: Floats, rotation: Floats) -> Floats:
        """Measured quantity (n, 3) of tips: the tool's position or the direction."""
        return position + rotation @ self.tool if self.with_tip else rotation[..., 2]

    def tips(self, bends: Floats) -> Floats:
        """Measured quantity (n, 3) of segments in series with given bends."""
        length = [segment.length for segment in self.robot.segments]
        x, y = np.moveaxis(bends, -1, 0)
        arcs = RobotArcs(self.robot, Arc(np.hypot(x, y) / length, np.arctan2(y, x), length))
        return self.seen(arcs.tip.position, arcs.tip.rotation)


def _played(values: Floats, width: float) -> Floats:
    """Values (n, D) behind a backlash of a width, in the order of the rows."""
    out: Floats = values.copy()
    for before, now in pairwise(out):  # rows are views
        np.clip(before, now - width / 2, now + width / 2, out=now)
    return out


def _motion(robot: Robot, m: Measurements) -> tuple[str, _Motion | None]:
    """Reason against a check, or "", and the motion as far as it is known."""
    if m.tendon_count == 0:
        return "the data have no command of any tendon", None
    if m.tendon_count != len(robot.tendons.angle_rad):
        needed = len(robot.tendons.angle_rad)
        return f"the data have {m.tendon_count} tendons, {robot.name} has {needed}", None
    if robot.is_coupled:
        return "constant curvature does not know the coupled strains of the backbone", None
    if m.points.shape[1]:
        if m.scale is None:
            return "points are in pixels", None
        if not m.seen.any():
            return "no tip is measured", None
        measured = m.tip
    elif m.bend is not None and m.direction is not None:
        across = np.sin(m.bend)
        measured = np.stack(
            [across * np.cos(m.direction), across * np.sin(m.direction), np.cos(m.bend)], axis=1
        )
    else:
        return "no point and no direction of bending is measured", None
    by_displacement = not np.isnan(m.displacements).any()
    if by_displacement:
        coupling, commands = robot.displacement_coupling, m.displacements
        commands = commands if coupling is None else commands @ coupling.T
        by_tendon = _by_displacement(robot)
    elif not np.isnan(m.tensions).any():
        commands, by_tendon = m.tensions, _by_tension(robot)
    else:
        return "some tendons are given by tension and others by displacement", None
    if m.time is not None and (np.diff(m.time) > 0).all():
        kinds = np.full(commands.shape, by_displacement)
        commands = actuation.delayed(kinds, commands, m.time, robot.tendons.delay_s)
    rows = np.unique(np.linspace(0, len(m) - 1, min(len(m), _MOST_ROWS)).round().astype(int))
    rows = rows[np.isfinite(measured[rows]).all(axis=1)]
    if m.faults:  # the doubt of the table names the spikes
        columns = (*commands.T, *np.nan_to_num(measured).T)
        rows = np.setdiff1d(rows, np.concatenate([spikes(column) for column in columns]))
    if len(rows) < _FEWEST_ROWS:
        return f"it takes {_FEWEST_ROWS} rows or more", None
    motion = _Motion(robot, m, commands[rows], by_tendon, measured[rows], rows, measured, commands)
    still = _spread(motion.measured) < _STILL * motion.size
    return f"the tip hardly {motion.move}s" if still else "", motion


def _by_displacement(robot: Robot) -> Floats:
    """Bends of the segments by displacements (2 S, T), least squares of theory Eq. 1.3.

    A displacement that is common to all tendons of a segment does not bend it.
    """
    tendons, count = robot.tendons, len(robot.segments)
    rows = np.zeros((len(tendons.angle_rad), 3 * count))
    for i, segment in enumerate(tendons.segment):
        rows[i, : 2 * (segment + 1)] = tendons.mean_hole_m[: segment + 1, i].ravel()
        rows[i, 2 * count + segment] = np.linalg.norm(tendons.hole_m[i])
    return np.asarray(np.linalg.pinv(rows, rcond=1e-9)[: 2 * count])


def _by_tension(robot: Robot) -> Floats:
    """Bends of the segments by tensions (2 S, T), linear law (theory Eq. 1.7)."""
    tendons = robot.tendons
    out = np.zeros((2 * len(robot.segments), len(tendons.angle_rad)))
    for j, by_moment in enumerate(robot.bend_by_moment):
        passes = tendons.segment >= j
        holes = tendons.mean_hole_m[j, passes] - robot.tension_centre_m[j]
        out[2 * j : 2 * j + 2, passes] = by_moment @ holes.T
    return out


def _fit(motion: _Motion, bends: Floats, mirror: bool, gains: Sequence[float]) -> _Fit:
    """Best of the gains, each with its best rigid motion."""
    largest = float(np.linalg.norm(bends, axis=2).max())
    if largest == 0:
        return _Fit(1.0, np.eye(3))
    cap = _capped(bends)
    fits = []
    for gain in (*(cap * gain for gain in _GAINS), *gains):
        predicted = motion.tips(gain * bends) * ([1.0, -1.0, 1.0] if mirror else 1.0)
        fits.append(_rigid(predicted, motion.measured))
    return min(fits, key=lambda fit: fit.left)


def _capped(bends: Floats) -> float:
    """Factor that limits the largest bend, as the stiffness may differ much from the file's."""
    return min(1.0, 2.5 / max(float(np.linalg.norm(bends, axis=2).max()), 1e-300))


def _spread(points: Floats) -> float:
    centred = points - points.mean(axis=0)
    return float(np.sqrt((centred**2).sum(axis=1).mean()))


def _in_base(predicted: Floats, measured: Floats) -> float:
    """Unexplained share if the measuring frame is that of the base."""
    left = np.sqrt(((predicted - measured) ** 2).sum(axis=1).mean())
    return min(float(left) / _spread(measured), 1.0)


def _rigid(predicted: Floats, measured: Floats) -> _Fit:
    """Fit the best rigid motion."""
    frame = align(predicted, measured)
    left = np.sqrt(((frame.apply(predicted) - measured) ** 2).sum(axis=1).mean())
    return _Fit(min(float(left) / _spread(measured), 1.0), frame.rotation)
