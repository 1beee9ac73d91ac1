"""Parameters of a fit by name: initial values, limits, and effect.

A parameter is a path of the robot file, such as ``segments.0.backbone.E`` (with ``*``, or as a
short name such as ``E``, for one value shared by all), or one of the actuation and the frames,
which no robot file has. All values are in SI.
"""

from __future__ import annotations

import copy
import difflib
import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from bowstring.aliases import Bools, Floats
from bowstring.errors import InputError
from bowstring.formatting import significant
from bowstring.robot.fields import number_fields, quantity_of
from bowstring.robot.laws import LAWS, MEMORIES
from bowstring.robot.model import Robot, with_drives, without_laws
from bowstring.robot.parts import TendonRing
from bowstring.robot.paths import example_path, find
from bowstring.robot.stiffness import entry_of
from bowstring.statics.actuation import driven
from bowstring.units import read_number, unit_of_size
from bowstring.validation import shown

_DEG: Final = np.pi / 180.0
#: Parameters outside the robot file: start, natural step, least value; usual unit, its SI value
_EXTRA: Final[dict[str, tuple[float, float, float, str, float]]] = {
    **dict.fromkeys(("base.x", "base.y", "base.z"), (0.0, 1e-3, -np.inf, "mm", 1e-3)),
    **dict.fromkeys(("base.rx", "base.ry", "base.rz"), (0.0, 0.02, -np.inf, "deg", _DEG)),
    **dict.fromkeys(("tool.x", "tool.y", "tool.z"), (0.0, 1e-3, -np.inf, "mm", 1e-3)),
    "marker": (0.0, 1e-3, -np.inf, "mm", 1e-3),
    "delay": (0.0, 0.05, -np.inf, "s", 1.0),
    "initial_displacement": (0.0, 1e-3, -np.inf, "mm", 1e-3),
    "initial_tension": (0.0, 1.0, -np.inf, "N", 1.0),
    "gain": (1.0, 0.02, 0.0, "", 1.0),
    "offset": (0.0, 1e-4, -np.inf, "mm", 1e-3),
    "offset of tensions": (0.0, 0.1, -np.inf, "N", 1.0),
    "backlash": (0.0, 1e-4, 0.0, "mm", 1e-3),
    "hole_angle": (0.0, 0.02, -np.inf, "deg", _DEG),
    "pitch_radius": (1.0, 0.01, 0.01, "", 1.0),
    "bend_gain": (1.0, 0.02, 0.0, "", 1.0),
}
_FRAMES: Final = {"base": ("x", "y", "z", "rx", "ry", "rz"), "tool": ("x", "y", "z")}
#: Offset of a measured point below the tip, all three coordinates or one.
_MARKER: Final = re.compile(r"marker\.(0|[1-9][0-9]{0,5})(?:\.([xyz]))?")
#: Commands before the first row of a path, of all its tendons or one.
_INITIAL: Final = re.compile(
    r"initial_(displacement|tension)(?:\.(0|[1-9][0-9]{0,5})(?:\.(0|[1-9][0-9]{0,5}))?)?"
)
#: Parameters of holes, which are fields of the robot file by other names.
_OF_HOLES: Final = ("hole_angle", "pitch_radius")
#: Whether a parameter may be common to all, one per segment, or one per tendon.
_EACH: Final = {
    **dict.fromkeys(("gain", "offset", "backlash"), ("", "segments", "tendons")),
    **dict.fromkeys(("hole_angle", "pitch_radius", "bend_gain"), ("", "segments")),
}
#: Natural steps of fields that may be zero; the step of other fields is a share of their value.
_STEP: Final = {
    **{size: law.step for law in LAWS.values() for size in law.sizes},
    "wrap_angle": 0.2,
    "compliance": 1e-5,
    "pretension": 0.2,
    "clamped_length": 5e-4,
    "hole_length": 5e-4,
    "free_length": 1e-2,
    "angle": 0.02,
    "first_angle": 0.02,
    "nu": 0.05,
    "gravity": 1.0,
    "hysteresis_play": 0.05,
}
#: Fields of the robot file that make a memory where they are above zero.
_OF_MEMORIES: Final = frozenset(size for law in MEMORIES.values() for size in law.sizes)
#: How a value is judged to be possible: by its size in SI, its distance from the initial value, its
#: ratio to that, or its share of a length of the robot.
_Scale = Literal["size", "distance", "ratio", "length", "pitch_radius"]
#: Least and largest value that is physically possible, and its scale; wide, so that noise alone
#: does not leave them. Gravity is that of Earth, by its size. Angles of holes may have any value,
#: as the measuring frame has.
_POSSIBLE: Final[dict[str, tuple[float, float, _Scale]]] = {
    "gravity": (9.3, 10.3, "size"),
    "E": (1e3, 1.2e12, "size"),
    "G": (3e2, 5e11, "size"),
    "density": (0.0, 2.3e4, "size"),
    "friction": (0.0, 1.5, "size"),
    **dict.fromkeys(("gain", "bend_gain"), (0.2, 5.0, "size")),
    "rest_twist": (-np.pi / 3, np.pi / 3, "distance"),
    "rest_bend": (-np.pi / 2, np.pi / 2, "distance"),
    "turns": (-0.25, 0.25, "distance"),
    **dict.fromkeys(("pitch_radius", "end_pitch_radius", "length"), (0.5, 2.0, "ratio")),
    **dict.fromkeys(("diameter", "end_diameter", "width", "end_width"), (0.5, 2.0, "ratio")),
    **dict.fromkeys(("height", "end_height", "thickness", "radius"), (0.5, 2.0, "ratio")),
    "offset": (-0.5, 0.5, "length"),
    "backlash": (0.0, 0.5, "length"),
    "hole_clearance": (0.0, 1.0, "pitch_radius"),
    **dict.fromkeys(("tool", "marker", "centre"), (-1.0, 1.0, "length")),
}
_WEIGHTLESS: Final = 0.1  # m/s^2
_SHARE: Final = 0.05
#: The same for fields of a payload, in kg and m.
_PAYLOAD_STEP: Final = {"mass": 5e-3, "centre": 5e-3}
#: Parameters that change only the effective displacement.
TENDON_PROPERTIES: Final = frozenset(
    {"compliance", "axial_stiffness", "free_length", "pretension"}
    | {"hole_clearance", "mount_compliance"}
)


@dataclass(frozen=True)
class Unknown:
    """One parameter to fit.

    Attributes
    ----------
    name : str
    unit : str
        Usual unit; ``per_unit`` is its value in SI.
    start, step, low, high : float
        Initial value, natural step and limits, in SI.
    paths : tuple of str
        Paths in the robot file that it sets; empty for parameters of actuation and frames.
    """

    name: str
    unit: str
    per_unit: float
    start: float
    step: float
    low: float
    high: float
    paths: tuple[str, ...] = ()

    @property
    def leaf(self) -> str:
        """Name of the field in the robot file."""
        return self.paths[0].rsplit(".", 1)[-1] if self.paths else ""

    @property
    def kind(self) -> str:
        """Field of the robot file, or first word of the name."""
        return _field_of_payload(*self.paths[:1]) or self.leaf or self.name.partition(".")[0]


@dataclass(frozen=True)
class Setting:
    """Robot, actuation and frames for given values of the parameters, in SI.

    Attributes
    ----------
    robot : Robot
    gain, offset, backlash, delay : ndarray (T,)
        The effective displacement is gain x (displacement after delay and backlash) + offset in m.
        A delay, s, is negative where the clocks differ and the tips are ahead of the commands.
    tension_gain : ndarray (T,)
        Gain of a tension, without that of the drives in the robot file.
    tension_offset : ndarray (T,)
        Offset of a tension, N, where all commands are tensions.
    position, turn : ndarray (3,)
        Position (m) and rotation vector (rad) of the robot's base in the measuring frame.
    tool : ndarray (3,)
        Offset of the last measured point, the tip, in the frame of its disk, m.
    markers : dict from int to ndarray (3,)
        Offsets of the points below the tip that are not zero, in the frames of their disks, m.
    bend_gain : ndarray (S,)
        Factor on the bends of constant curvature.
    initial : dict from int to ndarray (2, T)
        Of paths that do not begin in the home pose, by number: displacements (m) and tensions (N)
        at which the robot rested before, less those of the first row, NaN where not given. Tensions
        of tendons with a displacement there are those at rest.
    """

    robot: Robot
    gain: Floats
    offset: Floats
    backlash: Floats
    delay: Floats
    tension_gain: Floats
    tension_offset: Floats
    position: Floats
    turn: Floats
    tool: Floats
    markers: Mapping[int, Floats]
    bend_gain: Floats
    initial: Mapping[int, Floats]

    def in_frames_of(self, other: Setting) -> Setting:
        """Return this setting with the base and the offsets of the points of another one."""
        names = ("position", "turn", "tool", "markers")
        return replace(self, **{name: getattr(other, name) for name in names})

    def before(
        self, path: int, by_displacement: Bools, first: Floats
    ) -> tuple[Bools, Floats] | None:
        """Effective commands (T,) before the first ones of a path; None from the home pose.

        First which of them are displacements.
        """
        given = self.initial.get(path)
        if given is None:
            return None
        displacement, tension = np.nan_to_num(given)
        displacement = displacement - np.clip(displacement, -self.backlash, self.backlash)
        moved = np.where(by_displacement, self.gain * displacement, 0.0)
        values = first + np.where(
            by_displacement, driven(self.robot, moved), self.tension_gain * tension
        )
        at_tension = by_displacement & np.isfinite(given[1])
        held = by_displacement & ~at_tension
        least = self.robot.tendons.least_tension_N
        return held, np.where(
            held, values, np.maximum(np.where(at_tension, tension, values), least)
        )

    def offsets(self, count: int) -> Floats:
        """Offsets (M, 3) of `count` measured points in the frames of their disks, m."""
        none = np.zeros(3)
        return np.stack([*(self.markers.get(k, none) for k in range(count - 1)), self.tool])


class Unknowns:
    """Parameters to fit, and fixed values of others.

    Parameters
    ----------
    robot : Robot
        Robot with the initial values of its file's parameters.
    names : sequence of str
        Names; groups such as ``"base"`` or ``"gain.tendons"`` stand for all their members.
    start : mapping from name to float
        Initial values of fitted parameters, and fixed values of actuation and frames, in SI.
    by_tension : bool
        Whether all commands are tensions, so that offsets are in N.

    Raises
    ------
    InputError
        For names that are unknown, duplicate or without an initial value.
    """

    def __init__(
        self,
        robot: Robot,
        names: Sequence[str],
        start: Mapping[str, float] | None = None,
        *,
        by_tension: bool = False,
    ) -> None:
        self.by_tension = by_tension
        own = robot.tendons
        #: Fields of the drives in the robot file; they are fitted beside, by names of their own.
        self._drives = {"gain": own.gain, "zero": own.zero_m, "delay": own.delay_s}
        robot = without_laws(robot, *(key for key in robot.laws if key not in self._drives))
        self.robot = robot
        if isinstance(names, str) or not all(isinstance(name, str) for name in names):
            raise InputError(
                f"parameters is {shown(names)}, it must be a list of names of parameters"
            )
        fields = number_fields(robot.model_dump(mode="json", exclude_none=True))
        self._leaves = {k: v for k, v in fields if k.rpartition(".")[2] not in self._drives}
        self._count = {"segments": len(robot.segments), "tendons": len(robot.tendons.segment)}
        self._held: dict[str, float] = {}
        self._robots: dict[object, Robot] = {}
        self._from_home = False
        begin = {name: _finite(name, value) for name, value in (start or {}).items()}
        if own.backlash_m.any() and any(n.startswith("backlash") for n in (*names, *begin)):
            raise InputError(
                f"parameter backlash would add to the backlash of the drives in {robot.name}: fit "
                "segments.*.tendons.backlash, or set that to 0 mm",
                argument="parameters",
            )
        given = {each: value for name, value in begin.items() for each in self._expand(name)}
        fitted = [each for name in names for each in self._expand(name)]
        if twice := [each for each in fitted if fitted.count(each) > 1]:
            raise InputError(f"parameter {twice[0]} is named twice", argument="parameters")
        overrides: dict[str, float] = {}
        for name, value in given.items():
            if name in fitted:
                continue
            if paths := self._paths(name):
                overrides.update(dict.fromkeys(paths, value))
            else:
                self._held[name] = value
        if overrides:
            self.robot = robot.with_(overrides)
            self._leaves.update(overrides)  # a shared start value applies to each member
        self.items = [self._unknown(each, given) for each in fitted]
        self._check_overlap()

    @property
    def names(self) -> list[str]:
        """Names of the unknowns."""
        return [item.name for item in self.items]

    @property
    def has_delay(self) -> bool:
        """Whether a delay is fitted or fixed, beside that of the robot file."""
        return "delay" in (*self.names, *self._held)

    @property
    def start(self) -> Floats:
        """Start values (P,) in SI."""
        return np.array([item.start for item in self.items])

    def start_at(self, values: Floats) -> None:
        """Replace the start values."""
        starts = zip(self.items, values.tolist(), strict=True)
        self.items[:] = [replace(item, start=value) for item, value in starts]

    def refuse_without_effect(self, name: str, *, arcs: bool) -> None:
        """Raise `InputError` for a parameter that is known to have no effect."""
        if why := self._why_without_effect(name, arcs=arcs):
            raise InputError(
                f"parameter {name} is not identifiable: {why}, or leave the parameter out",
                argument="parameters",
            )

    def _why_without_effect(self, name: str, *, arcs: bool) -> str:
        """Reason why a parameter of a payload or of an initial state has no effect.

        Empty for others and if unknown. `arcs` is True for constant curvature.
        """
        if initial_of(name):
            fitted = {item.leaf for item in self.items}
            backlash = any(each.startswith("backlash") for each in (*self.names, *self._held))
            of_backlash = backlash and name.startswith("initial_displacement")
            if of_backlash or (not arcs and (self.robot.has_memory or fitted & _OF_MEMORIES)):
                return ""
            return "it is the state of a memory, and this model has none: fit backlash or another"
        paths = self._paths(name)
        field = _field_of_payload(*paths[:1])
        if not field:
            return ""
        if arcs:
            return "constant curvature knows no weight, fit statics instead"
        if not any(self.robot.gravity):
            return (
                f"{self.robot.name} has no gravity, so that payloads have no weight: give the "
                "robot its gravity"
            )
        loaded = [self.robot.payloads[int(path.split(".")[1])].mass for path in paths]
        if field == "centre" and not any(loaded):
            return "the payload has a mass of 0 kg, give it one to begin with"
        return ""

    @property
    def friction_paths(self) -> list[str]:
        """Paths in the robot file of all friction coefficients."""
        return [path for path in self._leaves if path.endswith(".friction")]

    def setting(self, values: Floats) -> Setting:
        """Make the setting of parameter values (P,) in SI.

        Raises
        ------
        InputError
            If the robot would be invalid.
        """
        extra = dict(self._held)
        overrides: dict[str, float] = {}
        for item, value in zip(self.items, values.tolist(), strict=True):
            if item.paths:
                overrides.update(dict.fromkeys(item.paths, value))
            else:
                extra[item.name] = value

        def each(name: str, kind: str) -> Floats:
            neutral = _EXTRA[name][0]
            combine = np.multiply if neutral else np.add

            def own(kind: str) -> list[float]:
                count = range(self._count[kind])
                return [extra.get(f"{name}.{kind}.{i}", neutral) for i in count]

            found = combine(extra.get(name, neutral), own("segments"))
            if kind == "tendons":
                found = combine(found[self.robot.tendons.segment], own("tendons"))
            return np.asarray(found)

        angle, radius = each("hole_angle", "segments"), each("pitch_radius", "segments")
        gain, own = each("gain", "tendons"), self._drives
        base, tool = (
            np.array([extra.get(f"{name}.{member}", 0.0) for member in members])
            for name, members in _FRAMES.items()
        )
        return Setting(
            robot=self._made(overrides, angle, radius),
            gain=gain * own["gain"],
            offset=own["zero"] + each("offset", "tendons"),
            backlash=each("backlash", "tendons"),
            delay=own["delay"] + extra.get("delay", 0.0),
            tension_gain=gain,
            tension_offset=each("offset", "tendons"),
            position=base[:3],
            turn=base[3:],
            tool=tool,
            markers=_markers(extra),
            bend_gain=each("bend_gain", "segments"),
            initial={} if self._from_home else _initial(extra, self._count["tendons"]),
        )

    def impossible(self, values: Floats, asked: Bools) -> list[str]:
        """Values (P,) in SI of the `asked` parameters (P,) that are not physically possible.

        Each as text with its possible range.
        """
        found, gravity = [], []
        radius = float(self.robot.tendons.arm_m.max())
        for item, value, is_asked in zip(self.items, values.tolist(), asked, strict=True):
            if not is_asked:
                continue
            if item.name.startswith("gravity"):
                gravity.append(item.name)
            elif item.kind in _POSSIBLE and item.unit != "N":
                low, high, scale = _POSSIBLE[item.kind]
                if scale == "ratio":
                    low, high = (end * item.start for end in (low, high))
                elif scale == "distance":
                    low, high = (item.start + end for end in (low, high))
                elif scale != "size":
                    size = radius if scale == "pitch_radius" else self.robot.length
                    low, high = (end * size for end in (low, high))
                if low < high and not low <= value <= high:
                    found.append(_beyond(item.name, value, low, high, item.unit, item.per_unit))
        if gravity:
            size = float(np.linalg.norm(self.setting(values).robot.gravity))
            low, high, _ = _POSSIBLE["gravity"]
            least = low if len(gravity) == 3 and size > _WEIGHTLESS else 0.0
            if not least <= size <= high:
                found.insert(0, _beyond("the size of gravity", size, low, high, "m/s^2", 1.0))
        return found

    def from_home(self) -> Unknowns:
        """Return the same for another recording, whose paths begin in the home pose."""
        other = copy.copy(self)
        other._from_home = True
        return other

    def _made(self, overrides: Mapping[str, float], angle: Floats, radius: Floats) -> Robot:
        """Make the robot of given overrides; cached, as most differences do not change it."""
        key = *overrides.values(), *angle.tolist(), *radius.tolist()
        robot = self._robots.get(key)
        if robot is None:
            robot = self.robot.with_(overrides) if overrides else self.robot
            if angle.any() or (radius != 1.0).any():
                robot = robot.with_(_moved_holes(robot, angle, radius))
            if len(self._robots) > 8:
                self._robots.clear()
            self._robots[key] = robot
        return robot

    def calibrated(self, values: Floats, *, by_displacement: bool) -> tuple[Robot, tuple[str, ...]]:
        """Return the robot of values (P,) in SI, and the parameters that its drives have.

        They have delays, and gain and offset where they are commanded by displacement alone, if a
        robot file can have these values.
        """
        setting, drives = self.setting(values), tuple[str, ...]()
        robot = with_drives(setting.robot, **self._drives)
        with suppress(InputError):
            robot, drives = with_drives(robot, delay=setting.delay), ("delay",)
        if by_displacement:
            with suppress(InputError):
                robot = with_drives(robot, gain=setting.gain, zero=setting.offset)
                drives = (*drives, "gain", "offset")
        return robot, drives

    def is_in_file(self, name: str, *, drives: tuple[str, ...]) -> bool:
        """Whether the robot of `calibrated` has a parameter or group; `drives` is its answer."""
        if name.partition(".")[0] in (*_OF_HOLES, *drives):
            return True
        return any(self._paths(each) for each in self._expand(name))

    def outside_file(self, values: Floats, *, drives: tuple[str, ...]) -> dict[str, float]:
        """Return fitted and fixed values that the robot of `calibrated` does not have, in SI.

        Those of the initial state belong to a recording, and are left out.
        """
        known = {**self._held, **dict(zip(self.names, values.tolist(), strict=True))}
        return {
            name: value
            for name, value in known.items()
            if initial_of(name) is None and not self.is_in_file(name, drives=drives)
        }

    # -- names -----------------------------------------------------------------------------

    def _expand(self, name: str) -> list[str]:
        """Expand a name to single parameters."""
        head, _, rest = name.partition(".")
        paths = self._paths(name)
        if name in _FRAMES:
            return [f"{name}.{member}" for member in _FRAMES[name]]
        if name == "delay" or (head in _FRAMES and name in _EXTRA):
            return [name]
        if name == "hole_clearance.segments":
            return [f"{name}.{i}" for i in range(self._count["segments"])]
        if (initial := _INITIAL.fullmatch(name)) and int(initial[3] or 0) < self._count["tendons"]:
            path, count = f"initial_{initial[1]}.{initial[2] or 0}", self._count["tendons"]
            return [name] if initial[3] else [f"{path}.{t}" for t in range(count)]
        if marker := _MARKER.fullmatch(name):
            return [name] if marker[2] else [f"{name}.{axis}" for axis in "xyz"]
        if head in _EACH:
            kind, _, index = rest.partition(".")
            if kind in _EACH[head]:
                if not kind:
                    return [head]
                if not index:
                    return [f"{name}.{i}" for i in range(self._count[kind])]
                if index.isdecimal() and int(index) < self._count[kind]:
                    return [name]
        elif _field_of_payload(*paths[:1] or [name]) == "inertia":
            raise InputError(
                f"parameter {name} is a moment of inertia, which does not act on a robot at rest: "
                "tips do not identify it",
                argument="parameters",
            )
        elif paths:
            return [name]
        elif _field_of_payload(name) == "centre" and (
            each_axis := [each for i in range(3) for each in self._paths(f"{name}.{i}")]
        ):
            return each_axis
        raise self._no_such(name)

    def _paths(self, name: str) -> tuple[str, ...]:
        """Paths in the robot file, as maps find them; none of the parameters outside it."""
        if name in _EXTRA:
            return ()
        head, of_segment, segment = name.partition(".segments.")
        if head == "hole_clearance" and of_segment:
            name = f"segments.{segment}.tendons.{head}"
        with suppress(InputError):
            return tuple(path for path in find(self.robot, name, ())[1] if path in self._leaves)
        return ()

    def _no_such(self, name: str) -> InputError:
        if re.match(r"payloads\b", name) and not self.robot.payloads:
            return InputError(
                f"parameter {name} needs a payload, and {self.robot.name} has none: add it to the "
                "robot with a mass to begin with",
                argument="parameters",
            )
        if re.fullmatch(r"segments\b.*\.tendons\b.*\.axial_stiffness", name):
            return InputError(
                f"parameter {name} has no value to begin with: give the robot an "
                "axial_stiffness, or fit the tendons' compliance",
                argument="parameters",
            )
        known = [
            *self._leaves,
            *(name for name in _EXTRA if name not in ("marker", "offset of tensions")),
            *_FRAMES,
            "marker.0",
        ]
        known += [f"{name}.{kind}" for name, kinds in _EACH.items() for kind in kinds if kind]
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
        hint = f"did you mean {near[0]}? It" if near else "it"
        return InputError(
            f"there is no parameter {shown(name)}; {hint} must be a number of the robot "
            f"file, as {example_path(self.robot)}, or one of "
            f"{', '.join([*_FRAMES, 'marker.0', 'delay', *_EACH])}",
            argument="parameters",
        )

    def _check_overlap(self) -> None:
        seen: dict[str, str] = {}
        for item in self.items:
            for path in item.paths:
                if path in seen:
                    raise InputError(
                        f"parameters {seen[path]} and {item.name} both set {path}",
                        argument="parameters",
                    )
                seen[path] = item.name

    # -- single parameters -----------------------------------------------------------------

    def _unknown(self, name: str, given: Mapping[str, float]) -> Unknown:
        if paths := self._paths(name):
            leaf = "gravity" if name.startswith("gravity") else paths[0].rsplit(".", 1)[-1]
            values = [self._leaves[path] for path in paths]
            start = given.get(name, float(np.mean(values)))
            quantity = quantity_of(self.robot, paths[0])
            unit, per_unit, low, high = "", 1.0, -np.inf, np.inf
            if quantity is not None:
                low, high = (read_number(end, quantity.si) for end in (quantity.low, quantity.high))
            if quantity is not None and quantity.si:
                unit = unit_of_size(start, quantity.si, quantity.example.rpartition(" ")[2])
                per_unit = read_number(f"1 {unit}", quantity.si)
            natural = _STEP.get(leaf, 0.0)
            if (entry := entry_of(paths[0])) is not None:
                natural, low, high = self._of_matrix(paths, *entry)
            if field := _field_of_payload(paths[0]):
                natural = _PAYLOAD_STEP[field]
            step = max(natural, _SHARE * abs(start))
            return Unknown(name, unit, per_unit, start, step or 1.0, low, high, paths)
        key = name if name in _EXTRA else name.partition(".")[0]
        if key == "offset" and self.by_tension:
            key = "offset of tensions"
        start, step, low, unit, per_unit = _EXTRA[key]
        return Unknown(name, unit, per_unit, given.get(name, start), step, low, np.inf)

    def _of_matrix(self, paths: Sequence[str], row: int, column: int) -> tuple[float, float, float]:
        """Natural step, least and largest value of an entry of stiffness matrices."""
        sizes = []
        for path in paths:
            matrix = path.rsplit(".", 2)[0]
            both = (self._leaves[f"{matrix}.{i}.{i}"] for i in (row, column))
            sizes.append(math.sqrt(math.prod(both)))
        if row == column:
            return _SHARE * min(sizes), 0.0, math.inf
        return (
            _SHARE * min(sizes),
            -min(sizes),
            min(sizes),
        )  # beyond, no matrix is positive definite


def _beyond(name: str, value: float, low: float, high: float, unit: str, per_unit: float) -> str:
    """Write a value and its possible range, given in SI, in a unit."""
    at, *ends = (f"{significant(each / per_unit)}" for each in (value, low, high))
    unit = f" {unit}" if unit else ""
    return f"{name} is {at}{unit} ({ends[0]} to {ends[1]}{unit})"


def zero_is_fitted(parameters: Sequence[str]) -> bool:
    """Whether a fit of these parameters finds the zeros of commands."""
    return any(name.partition(".")[0] == "offset" for name in parameters)


def marker_of(name: str) -> int | None:
    """Index of the point below the tip whose offset a parameter is; None for other parameters."""
    found = _MARKER.fullmatch(name)
    return int(found[1]) if found else None


def initial_of(name: str) -> tuple[int, int, bool] | None:
    """Path and tendon, from 0, whose initial command a parameter is; None for other parameters.

    The last entry is True for a displacement and False for a tension.
    """
    found = _INITIAL.fullmatch(name)
    return None if found is None else (int(found[2]), int(found[3]), found[1] == "displacement")


def _initial(extra: Mapping[str, float], tendons: int) -> dict[int, Floats]:
    """Displacements and tensions (2, T) before paths, by their numbers; NaN where not given."""
    found: dict[int, Floats] = {}
    for name, value in extra.items():
        if initial := initial_of(name):
            path, tendon, by_displacement = initial
            found.setdefault(path, np.full((2, tendons), np.nan))
            found[path][int(not by_displacement), tendon] = value
    return found


def _markers(extra: Mapping[str, float]) -> dict[int, Floats]:
    """Offsets (3,) of markers by their numbers from 0."""
    found: dict[int, Floats] = {}
    for name, value in extra.items():
        if marker := _MARKER.fullmatch(name):
            found.setdefault(int(marker[1]), np.zeros(3))["xyz".index(marker[2])] = value
    return found


def _field_of_payload(name: str = "") -> str:
    """Field of a payload that a parameter is: mass, centre or inertia; else empty."""
    found = re.fullmatch(r"payloads(?:\.|\[)(?:\d+|\*)\]?\.(mass|centre|inertia)\b.*", name)
    return found[1] if found else ""


def _finite(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        raise InputError(f"start of {name} is {shown(value)}, it must be a number, in SI")
    if not np.isfinite(value):
        raise InputError(f"start of {name} is {value}, it must be finite")
    return float(value)


def _moved_holes(robot: Robot, angle: Floats, radius: Floats) -> dict[str, float]:
    """Overrides that rotate the holes of segments and scale their pitch radii."""
    overrides: dict[str, float] = {}
    for i, segment in enumerate(robot.segments):
        where, ring = f"segments.{i}.tendons", segment.tendons
        holes: dict[str, Any] = (
            {f"{where}.first_angle": ring}
            if isinstance(ring, TendonRing)
            else {f"{where}.{j}.angle": tendon for j, tendon in enumerate(ring)}
        )
        for path, part in holes.items():
            above, _, name = path.rpartition(".")
            turned = getattr(part, name) + angle[i]
            overrides[path] = float(np.remainder(turned + np.pi, 2 * np.pi) - np.pi)
            overrides[f"{above}.pitch_radius"] = float(part.pitch_radius * radius[i])
    return overrides
