"""Equations 1 to 5 of the source study and their two corrections, with a robot's numbers.

Each equation is built once as MathML from terms, which are first symbols and then numbers. Numbers
are rounded to the digits that are shown before they are put in, except for results: what is printed
behind the last equals sign comes from the program, not from the rounded numbers before it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.constant_curvature import RobotArcs
from bowstring.errors import BowstringError
from bowstring.formatting import in_mm, listed, significant
from bowstring.study.first_segment import FirstSegment, first_segment

if TYPE_CHECKING:
    from bowstring.study.study import Study

_ELL, _ALPHA = "\N{SCRIPT SMALL L}", "\N{GREEK SMALL LETTER ALPHA}"
_MOST_TENDONS: Final = 6  # lengths that are written out without a closed form


@dataclass(frozen=True)
class Equation:
    """Numbered equation of the source study, or a correction of it."""

    name: str
    """Number, such as ``"Eq. 1"``."""
    what: str
    """Result in words."""
    lines: tuple[str, ...]
    """MathML of each line, with symbols and then with numbers."""
    note: str = ""
    """Notes in sentences."""


@dataclass(frozen=True)
class SegmentArc:
    """Arc of one segment in usual units."""

    phi_deg: float
    """Direction of bending from x towards y, deg, in the frame of the segment's start."""
    theta_deg: float
    """Bend angle, deg."""
    kappa_per_m: float
    """Curvature, 1/m."""
    length_mm: float
    """Arc length, mm."""


@dataclass(frozen=True)
class StudyEquations:
    """Equations at one load."""

    intro: tuple[str, ...]
    """Load and source of the lengths, in sentences."""
    equations: tuple[Equation, ...]
    """Equations of the segment at the base; empty if it is straight."""
    arcs: tuple[SegmentArc, ...]
    """Arcs of all segments."""


def study_equations(study: Study) -> StudyEquations:
    """Evaluate the equations of the source study at the largest load of a study.

    Returns
    -------
    StudyEquations
        Of the segment at the base, and the arcs of all segments. Equations 2 to 5 are the closed
        form of three tendons of equal pitch radius at 120 degrees; for other tendons the equation
        that they solve is shown in their place.
    """
    segment = first_segment(study)
    arcs = segment.arcs
    shown = tuple(
        SegmentArc(*(float(v) + 0.0 for v in row))
        for row in zip(
            np.degrees(arcs.phi),
            np.degrees(arcs.theta),
            arcs.kappa,
            arcs.length * 1e3,
            strict=True,
        )
    )
    return StudyEquations(_intro(study, segment), tuple(_equations(study, segment)), shown)


def _intro(study: Study, segment: FirstSegment) -> tuple[str, ...]:
    many = len(study.robot.segments) > 1
    out = [
        f"All numbers are those of {study.settings.actuated} at {significant(segment.tension)} N, "
        "the largest load of the sweep that has an equilibrium. Lengths without a unit are in mm."
    ]
    if many:
        tendons = [str(t + 1) for t in segment.tendons]
        own = f"tendons {listed(tendons)} end" if tendons else "no tendon ends"
        out.append(
            "The equations are those of one segment, here segment 1, at whose end disk "
            f"{own}. An outer segment is computed in the same way from what the arcs before it "
            "leave of its tendons' lengths."
        )
    if segment.from_lengths:
        out.append("The tendon lengths are those of the robot by statics.")
    else:
        scale = study.model.arc_scale
        at = f" at {significant(scale * segment.tension)} N" if scale < 1.0 else ""
        out.append(
            f"The tendon lengths give no arc ({segment.without_lengths}); the arc in Eq. 1 is that "
            f"of the linear law{at}."
        )
    if segment.straight:
        out.append("The segment is straight at this load, so there is nothing to put in.")
    else:
        place = ", ".join(_fixed(v * 1e3, 3) for v in segment.tip)
        out.append(f"By statics {_end(study)} is at ({place}) mm.")
    return tuple(out)


def _equations(study: Study, segment: FirstSegment) -> list[Equation]:
    if segment.straight:
        return []
    out = []
    ring = ring_of(study, segment) if segment.from_lengths else None
    if ring is not None:
        out += [_direction(study, segment, ring), _arc(study, segment, ring)]
    elif segment.from_lengths:
        out.append(_least_squares(study, segment))
    out.append(_tip(segment, _beside(study, segment, segment.arcs)))
    if ring is not None:
        out.append(_tip_from_lengths(study, segment, ring))
        out += _chords(study, segment, ring)
    return out + _forces(study, segment)


def ring_of(study: Study, segment: FirstSegment) -> NDArray[np.intp] | None:
    """The three tendons at 120 degrees on one circle, counter-clockwise from the first one."""
    tendons = study.robot.tendons
    if len(segment.tendons) != 3:
        return None
    first = segment.tendons[0]
    turns = (tendons.angle_rad[segment.tendons] - tendons.angle_rad[first]) % math.tau
    order = np.argsort(np.where(math.tau - turns < 1e-6, 0.0, turns))
    radii = tendons.pitch_radius_m[segment.tendons]
    even = np.allclose(turns[order], math.tau / 3 * np.arange(3), rtol=0.0, atol=1e-6)
    if not even or np.ptp(radii) > 1e-9 * radii.max():
        return None
    return np.asarray(segment.tendons[order])


def _end(study: Study) -> str:
    return "the tip" if len(study.robot.segments) == 1 else "the end disk of segment 1"


def _beside(study: Study, segment: FirstSegment, arcs: RobotArcs) -> str:
    """End of the arc, and its distance from the end of the robot."""
    end = arcs.disk_positions[len(segment.stations) - 1]
    away = float(np.linalg.norm(end - segment.tip))
    place = ", ".join(_fixed(v * 1e3, 3) for v in end)
    return f"The arc ends at ({place}) mm, {in_mm(away)} from {_end(study)} by statics."


# -- the equations -----------------------------------------------------------------------------


def _direction(study: Study, segment: FirstSegment, ring: NDArray[np.intp]) -> Equation:
    lengths = _lengths(study, segment, ring)
    first = math.remainder(float(study.robot.tendons.angle_rad[ring[0]]), math.tau)

    def terms(l1: str, l2: str, l3: str) -> str:
        two = _n("2") + (_DOT if "<mn>" in l1[:4] else "") + l1
        high = _sqrt(_n("3")) + _group(l3, _MINUS, l2)
        return _function("atan2", _group(high, _op(","), l2, _PLUS, l3, _MINUS, two))

    start = abs(first) > 1e-9
    lead = (_sub(_ALPHA, ring[0] + 1) + _PLUS) if start else ""
    lead_number = (_n(_degrees(first)) + _PLUS) if start else ""
    note = (
        "The study prints an arctangent of the quotient of the two, which loses the quadrant; "
        "atan2 keeps it."
    )
    if start:
        note += f" The angle is counted from x; tendon {ring[0] + 1} is not at 0 degrees."
    whole = first + math.remainder(segment.phi - first, math.tau)  # as the two terms add up
    phi = [_n(_degrees(whole))]
    if _degrees(whole) != _degrees(segment.phi):  # the same direction, less a full turn
        phi.append(_n(_degrees(segment.phi)))
    symbols = _math(_i("φ"), _EQ, lead, terms(*(_sub("l", t + 1) for t in ring)))
    numbers = _math(_i("φ"), _EQ, lead_number, terms(*map(_n, lengths)), _EQ, _EQ.join(phi))
    return Equation("Eq. 2", "direction of bending", (symbols, numbers), note)


def _arc(study: Study, segment: FirstSegment, ring: NDArray[np.intp]) -> Equation:
    lengths = _lengths(study, segment, ring)
    radius = float(study.robot.tendons.pitch_radius_m[ring[0]])
    l1, l2, l3 = study.statics.tendon_lengths[segment.load, ring] * 1e3
    q = float(l1**2 + l2**2 + l3**2 - l1 * l2 - l1 * l3 - l2 * l3)

    def radicand(a: str, b: str, c: str) -> str:
        squares = _PLUS.join(_sup(x, _n("2")) for x in (a, b, c))
        return squares + "".join(_MINUS + x + _DOT + y for x, y in ((a, b), (a, c), (b, c)))

    names = [_sub("l", t + 1) for t in ring]
    mean = _frac(_PLUS.join(names), _n("3"))
    mean_number = _frac(_PLUS.join(map(_n, lengths)), _n("3"))
    size = _mm(segment.length)
    bend = _frac(_n("2") + _sqrt(_i("q")), _n("3") + _i("r"))
    r, root = _n(_mm(radius)), _sqrt(_n(f"{q:.6g}"))
    bend_number = _frac(_n("2") + _DOT + root, _n("3") + _DOT + r)
    curve = _frac(_i("θ"), _i(_ELL))
    metres = _n(significant(segment.length, 6)) + _unit("m")
    curve_number = _frac(_n(_radians(segment.theta)), metres)
    kappa, radius_of_arc = segment.theta / segment.length, segment.length / segment.theta
    lines = (
        _math(_i(_ELL), _EQ, mean, _EQ, mean_number, _EQ, _n(size), _unit("mm")),
        _math(_i("q"), _EQ, radicand(*names)),
        _math(_i("q"), _EQ, radicand(*map(_n, lengths)), _EQ, _n(f"{q:.6g}"), _unit("mm²")),
        _math(
            *(_i("θ"), _EQ, bend, _EQ, bend_number, _EQ),
            *(_n(_radians(segment.theta)), _unit("rad"), _EQ, _n(_degrees(segment.theta))),
        ),
        _math(
            *(_i("κ"), _EQ, curve, _EQ, curve_number, _EQ),
            *(_n(significant(kappa, 6)), _unit("1/m")),
        ),
    )
    what = f"length, bend angle and curvature of the arc; its radius is {in_mm(radius_of_arc)}"
    return Equation("Eqs. 3 and 4", what, lines, "The pitch radius of the tendons is r.")


def _least_squares(study: Study, segment: FirstSegment) -> Equation:
    """Equation of the lengths for tendons without a closed form."""
    tendons = study.robot.tendons
    symbols = _math(
        *(_sub("l", "i"), _EQ, _i(_ELL), _MINUS, _i("θ"), _sub("r", "i")),
        _function("cos", _group(_i("φ"), _MINUS, _sub(_ALPHA, "i"))),
    )
    lines = [symbols]
    for t in segment.tendons[:_MOST_TENDONS]:
        r, alpha = float(tendons.pitch_radius_m[t]), float(tendons.angle_rad[t])
        fitted = segment.length - segment.theta * r * math.cos(segment.phi - alpha)
        angles = _group(_n(_degrees(segment.phi)), _MINUS, _n(_degrees(alpha)))
        lines.append(
            _math(
                *(_n(_mm(segment.length)), _MINUS, _n(_radians(segment.theta))),
                *(_DOT, _n(_mm(r)), _function("cos", angles), _EQ, _n(_mm(fitted))),
                *(_unit("mm"), _op("&#x2248;"), _sub("l", t + 1), _EQ),
                *(_n(_mm(float(study.statics.tendon_lengths[segment.load, t]))), _unit("mm")),
            )
        )
    left_out = len(segment.tendons) - _MOST_TENDONS
    note = (
        "Eqs. 2 to 5 are the closed form of three tendons at 120 degrees on one circle. This "
        "segment has others, so that length, bend angle and direction are the least-squares "
        f"solution of this equation: bend angle {_degrees(segment.theta)}, direction "
        f"{_degrees(segment.phi)}, length {_mm(segment.length)} mm; the lengths are "
        f"{in_mm(float(segment.arcs.misfit[0]))} from it (RMS)."
    )
    if len(segment.tendons) < 3:
        note += (
            " Its tendons are fewer than three, so that the backbone keeps its length or bends in "
            "their plane."
        )
    if left_out > 0:
        note += f" {left_out} more tendons are not written out."
    return Equation("In the place of Eqs. 2 to 4", "the arc of any tendons", tuple(lines), note)


def _tip(segment: FirstSegment, note: str) -> Equation:
    radius = _frac(_i(_ELL), _i("θ"))
    value = _frac(_n(_mm(segment.length)), _n(_radians(segment.theta)))
    lines = _components(segment, (radius, _i("θ"), _i("φ")), (value, _n(_radians(segment.theta))))
    return Equation("Eq. 1", "end of the arc", lines, note)


def _tip_from_lengths(study: Study, segment: FirstSegment, ring: NDArray[np.intp]) -> Equation:
    lengths = _lengths(study, segment, ring)
    r = _n(_mm(float(study.robot.tendons.pitch_radius_m[ring[0]])))
    root = _n(_mm(_root(study, segment)))

    def terms(r: str, lengths: list[str], q: str, dot: str) -> tuple[str, str]:
        radius = _frac(r + dot + _group(_PLUS.join(lengths)), _n("2") + dot + q)
        return radius, _group(_n("2"), dot, q, _op("/"), _group(_n("3"), dot, r))

    names = [_sub("l", t + 1) for t in ring]
    lines = _components(
        segment,
        (*terms(_i("r"), names, _sqrt(_i("q")), ""), _i("φ")),
        terms(r, [_n(v) for v in lengths], root, _DOT),
    )
    note = (
        "This is Eq. 1 with Eqs. 3 and 4 put in, and so the same point. As printed by Amouri "
        "(2019), its z is twice this: the straight robot would have its tip at twice its length."
    )
    return Equation("Eq. 5", "end of the arc from the tendon lengths", lines, note)


def _components(
    segment: FirstSegment, symbols: tuple[str, str, str], values: tuple[str, str]
) -> tuple[str, ...]:
    """Lines for x, y and z of the end: symbols (radius, angle, direction), numbers, result."""
    point = segment.arcs.disk_positions[len(segment.stations) - 1]

    def parts(radius: str, theta: str, phi: str) -> tuple[str, str, str]:
        rise = radius + _group(_n("1"), _MINUS, _function("cos", theta))
        return (
            rise + _function("cos", phi),
            rise + _function("sin", phi),
            radius + _function("sin", theta),
        )

    rows = zip(
        "xyz", parts(*symbols), parts(*values, _n(_degrees(segment.phi))), point, strict=True
    )
    return tuple(
        _math(
            *(_i(axis), _EQ, symbol, _EQ, number, _EQ),
            *(_n(_fixed(float(v) * 1e3, 3)), _unit("mm")),
        )
        for axis, symbol, number, v in rows
    )


def _root(study: Study, segment: FirstSegment) -> float:
    """Square root of the radicand of Eq. 4, m."""
    return 1.5 * float(study.robot.tendons.pitch_radius_m[segment.tendons[0]]) * segment.theta


def _chords(study: Study, segment: FirstSegment, ring: NDArray[np.intp]) -> list[Equation]:
    if not segment.equal_modules:
        return []
    robot, n = study.model.robot, len(segment.stations)
    try:
        arcs = RobotArcs.from_lengths(robot, study.statics.tendon_lengths[segment.load], "chord")
    except BowstringError:
        return []
    theta, length = float(arcs.theta[0]), float(arcs.length[0])
    radius = float(study.robot.tendons.pitch_radius_m[ring[0]])
    mean = float(study.statics.tendon_lengths[segment.load, ring].mean())
    share = _frac(_sqrt(_i("q")), _n("3") + _i("r n"))
    below = _DOT.join((_n("3"), _n(_mm(radius)), _n(str(n))))
    share_number = _frac(_n(_mm(_root(study, segment))), below)
    a, dot = theta / n, _DOT
    half, half_number = _frac(_i("a"), _n("2")), _n(_radians(a / 2))

    def ratio(x: str) -> str:
        return _frac(x, _function("sin", x))

    lines = (
        _math(
            *(_i("a"), _EQ, _n("2"), _function("arcsin", share), _EQ, _n("2")),
            *(_function("arcsin", share_number), _EQ, _n(_radians(a)), _unit("rad")),
        ),
        _math(
            *(_i("θ"), _EQ, _i("n a"), _EQ, _n(str(n)), dot, _n(_radians(a)), _EQ),
            *(_n(_radians(theta)), _unit("rad"), _EQ, _n(_degrees(theta))),
        ),
        _math(
            *(_i(_ELL), _EQ, _frac(_PLUS.join(_sub("l", t + 1) for t in ring), _n("3"))),
            *(ratio(half), _EQ, _n(_mm(mean)), dot, ratio(half_number), _EQ),
            *(_n(_mm(length)), _unit("mm")),
        ),
    )
    note = f"Insert these into Eq. 1 in place of Eqs. 3 and 4. {_beside(study, segment, arcs)}"
    what = f"from lengths with straight spans, n = {n} modules, a the bend angle of one"
    return [Equation("First correction", what, lines, note)]


def _forces(study: Study, segment: FirstSegment) -> list[Equation]:
    """Linear law and its correction (theory Eq. 1.7 and 1.10)."""
    model, n = study.model, len(segment.stations)
    robot = model.robot
    tensions = model.tensions(np.array([segment.tension]))[0]
    centre = robot.tension_centre_m[0]
    both = tensions @ (robot.tendons.mean_hole_m[0] - centre)  # all tendons pass segment 1
    moment = float(np.linalg.norm(both))
    force, stiffness = float(tensions.sum()), float(robot.bending_stiffness[0])
    length, dot = float(robot.segments[0].length), _DOT
    if moment < 1e-9 * force * float(robot.tendons.arm_m.max()):
        return []  # the tensions balance each other
    if not robot.bends_alike:  # the stiffness in the direction of this moment
        bend = robot.bend_by_moment[0] @ both
        stiffness = moment * float(robot.segments[0].length) / float(np.linalg.norm(bend))
    arcs = RobotArcs.from_tensions(robot, tensions)
    theta = float(arcs.theta[0])
    alone = study.settings.actuated_alone
    arm = _i("F r") if alone else _i("M")
    newton_metres = _n(significant(moment, 6))
    symbols = _frac(arm + _i(_ELL), _i("E I"))
    values = (newton_metres, _n(significant(length, 6)), _n(significant(stiffness, 6)))
    line = _math(
        *(_i("θ"), _EQ, symbols, _EQ, _frac(values[0] + dot + values[1], values[2])),
        *(_EQ, _n(_radians(theta)), _unit("rad"), _EQ, _n(_degrees(theta))),
    )
    by = (
        f"F r = {significant(force)} N times {in_mm(moment / force)}"
        if alone
        else "M, the size of the sum of the tensions times the places of their holes,"
    )
    is_moment = f"{by} {'=' if alone else 'is'} {significant(moment, 6)} N m"
    given = f"{is_moment}; E I = {significant(stiffness, 6)} N m²; {_ELL} = {_mm(length)} mm"
    if centre.any():
        x, y = (significant(1e3 * float(c)) for c in centre)
        given += f"; the moment is about the section's tension centre at ({x}, {y}) mm"
    note = f"{given}. Numbers are in N and m. {_beside(study, segment, arcs)}"
    out = [Equation("Linear law", "bend angle from force", (line,), note)]
    if not segment.equal_modules:
        return out
    try:
        better = RobotArcs.from_tensions(robot, tensions, "arm")
    except BowstringError:
        return out
    bent = float(better.theta[0])
    a = bent / n

    def law(size: str, stiff: str, lever: str, total: str, module: str, x: str, times: str) -> str:
        second = total + times + module + times + _frac(x, _n("12"))
        third = _frac(lever + times + _sup(x, _n("2")), _n("8"))
        return _frac(size, stiff) + _group(lever, _PLUS, second, _MINUS, third)

    spans = _frac(_i(_ELL), _i("n"))
    one = law(_i(_ELL), _i("E I"), arm, _i("F"), spans, _i("a"), "")
    numbers = law(
        *(values[1], values[2], newton_metres, _n(significant(force, 6))),
        *(_n(significant(length / n, 6)), _n(_radians(a)), dot),
    )
    lines = (
        _math(_i("θ"), _EQ, one, _op(","), _i("a"), _EQ, _frac(_i("θ"), _i("n"))),
        _math(
            *(_i("θ"), _EQ, numbers, _EQ, _n(_radians(bent)), _unit("rad"), _EQ),
            _n(_degrees(bent)),
        ),
    )
    note = (
        "The equation is solved for θ: a on its right side is that of the solution. "
        f"{_beside(study, segment, better)}"
    )
    what = f"from force with the mean lever arm of straight spans, n = {n}"
    out.append(Equation("Second correction", what, lines, note))
    return out


# -- numbers ------------------------------------------------------------------------------------


def _fixed(value: float, digits: int) -> str:
    text = f"{value:.{digits}f}"
    return text[1:] if text.startswith("-") and not float(text) else text


def _mm(metres: float) -> str:
    """Write a length to a micrometre, without trailing zeros."""
    return _fixed(metres * 1e3, 3).rstrip("0").rstrip(".")


def _radians(angle: float) -> str:
    return f"{angle:.6g}"


def _degrees(angle: float) -> str:
    return f"{_fixed(math.degrees(angle), 3).rstrip('0').rstrip('.')}°"


def _lengths(study: Study, segment: FirstSegment, ring: NDArray[np.intp]) -> list[str]:
    """Write lengths in mm to a micrometre, or as precisely as their differences in Eq. 4 need."""
    differences = 1.5e3 * float(study.robot.tendons.pitch_radius_m[ring[0]]) * segment.theta
    digits = min(9, max(3, math.ceil(-math.log10(5e-5 * differences))))
    lengths = study.statics.tendon_lengths[segment.load, ring] * 1e3
    return [_fixed(float(v), digits) for v in lengths]


# -- MathML -------------------------------------------------------------------------------------


_EQ, _PLUS, _DOT, _MINUS = "<mo>=</mo>", "<mo>+</mo>", "<mo>&#x22C5;</mo>", "<mo>&#x2212;</mo>"


def _math(*parts: str) -> str:
    return f'<math display="block"><mrow>{"".join(parts)}</mrow></math>'


def _i(name: str) -> str:
    return "".join(f"<mi>{part}</mi>" for part in name.split())


def _n(text: str) -> str:
    """MathML of a number, with a proper minus sign."""
    return f"<mn>{text.replace('-', '&#x2212;')}</mn>"


def _op(text: str) -> str:
    return f"<mo>{text}</mo>"


def _function(name: str, of: str) -> str:
    """MathML of a function; a number gets parentheses."""
    inner = _group(of) if of.startswith("<mn>") else of
    thin = '<mspace width="0.15em"></mspace>'
    return f"<mrow>{thin}<mi>{name}</mi><mo>&#x2061;</mo>{thin}{inner}</mrow>"


def _unit(text: str) -> str:
    return f'<mspace width="0.25em"></mspace><mtext>{text}</mtext>'


def _sub(name: str, index: object) -> str:
    tag = "mn" if str(index).isdigit() else "mi"
    return f"<msub><mi>{name}</mi><{tag}>{index}</{tag}></msub>"


def _sup(base: str, power: str) -> str:
    return f"<msup><mrow>{base}</mrow>{power}</msup>"


def _frac(high: str, low: str) -> str:
    return f"<mfrac><mrow>{high}</mrow><mrow>{low}</mrow></mfrac>"


def _sqrt(inner: str) -> str:
    return f"<msqrt>{inner}</msqrt>"


def _group(*parts: str) -> str:
    return f"<mrow><mo>(</mo>{''.join(parts)}<mo>)</mo></mrow>"
