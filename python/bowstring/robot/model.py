"""Robot: file with units, checks, and numbers in SI as arrays.

A robot is read from YAML (`load_robot`), checked as a whole, and immutable; `Robot.with_` returns
a changed copy. All stored numbers are in SI and radians.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from bowstring.aliases import Floats
from bowstring.display import html_table
from bowstring.errors import InputError
from bowstring.robot.arrays import RobotArrays
from bowstring.robot.laws import LAWS
from bowstring.robot.messages import build, build_changed
from bowstring.robot.overrides import check_mapping, expand_all, fill, override
from bowstring.robot.parts import Backbone, Disks, Tendon, TendonProperties, TendonRing
from bowstring.robot.picture import picture
from bowstring.robot.plausibility import implausible
from bowstring.units import number_with_unit
from bowstring.validation import shown


class Robot(RobotArrays):
    """Cable-driven continuum robot, checked and immutable; every number is SI.

    `load_robot` makes one, `with_` a changed copy.
    """

    def __repr__(self) -> str:
        return f"<Robot {self.name}: {self._summary}>"

    def _repr_html_(self) -> str:
        rows = [
            (
                segment.name or f"segment {j}",
                number_with_unit(segment.length, "m"),
                number_with_unit(segment.backbone.outer_diameter, "m"),
                "" if (e := segment.backbone.E) is None else number_with_unit(e, "Pa"),
                int((self.disks.segment == j - 1).sum()),
                int((self.tendons.segment == j - 1).sum()),
            )
            for j, segment in enumerate(self.segments, 1)
        ]
        header = ("", "length", "diameter", "E", "disks", "tendons")
        from bowstring.robot.rest_shape import rest_frames

        drawn = picture(self, *rest_frames(self, self.disks.station_m))
        return drawn + html_table(f"{self.name}: {self._summary}", rows, header)

    @property
    def _summary(self) -> str:
        counts = [
            (len(self.segments), "segment"),
            (len(self.disks.station_m), "disk"),
            (len(self.tendons.angle_rad), "tendon"),
        ]
        named = ", ".join(f"{n} {what}{'' if n == 1 else 's'}" for n, what in counts)
        return f"{number_with_unit(self.length, 'm')}, {named}"

    # Caches are in __dict__; the core's object cannot be pickled, and is built again at first use.
    def __getstate__(self) -> dict[Any, Any]:
        state = super().__getstate__()
        state["__dict__"] = self._fields()
        return state

    def __copy__(self) -> Robot:
        return Robot.model_construct(set(self.model_fields_set), **self._fields())

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> Robot:
        return self.__copy__()

    def _fields(self) -> dict[str, Any]:
        return {name: self.__dict__[name] for name in Robot.model_fields}

    def with_(self, overrides: Mapping[str, Any]) -> Robot:
        """Return a changed copy, checked again as a whole.

        Parameters
        ----------
        overrides : mapping from path to value
            New values, such as ``{"segments.0.disks.clamped_length": "3 mm"}``. A string may have
            a unit; numbers without one are SI. In a path ``*`` stands for every index of a list,
            as in ``segments.*.backbone.E``. None removes a field. Setting one of ``G`` and
            ``nu``, or of ``count`` and ``positions``, removes the other. An entry of a stiffness
            matrix, such as ``segments.0.backbone.stiffness.0.2``, sets the mirrored one too.

        Returns
        -------
        Robot
            Changed copy; this robot stays as it is.

        Raises
        ------
        InputError
            If a path does not exist or the changed robot is not valid.
        """
        check_mapping(overrides)

        def make(changes: Mapping[str, Any]) -> Robot:
            # Fields that the file leaves out stay left out, unless a part of them is set.
            tree = self.model_dump(mode="json", exclude_none=True, exclude_unset=True)
            whole = self.model_dump(mode="json", exclude_none=True)
            changes = expand_all(whole, changes)
            for path in changes:
                fill(tree, whole, str(path).split("."))
            return build(Robot, override(tree, changes), self.name)

        return build_changed(make, overrides)

    @cached_property
    def definition(self) -> str:
        """Robot as JSON text, every number in SI."""
        return json.dumps(self.model_dump(mode="json", exclude_none=True))

    @property
    def has_matrix(self) -> bool:
        """Whether the section of any segment is given by its stiffness matrix."""
        return any(segment.backbone.stiffness is not None for segment in self.segments)

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the robot's physics, as hex.

        It covers every physical field in SI, with disk positions, G and single tendons, so that
        it does not depend on how the file is written. Names and descriptions do not count.
        """

        import hashlib  # 7 ms, and most runs need no hash

        def exact(value: float) -> str:
            return (value + 0.0).hex()  # + 0.0 makes -0.0 the same as 0.0

        def tendon(t: Tendon) -> list[Any]:
            # Unused fields are left out, so that a new field does not change existing hashes.
            properties: dict[str, Any] = {
                name: value if isinstance(value := getattr(t, name), str) else exact(value)
                for name, field in TendonProperties.model_fields.items()
                if getattr(t, name) != field.default and name not in ("diameter", "material")
            }
            for name in ("angles", "pitch_radii"):
                if (values := getattr(t, name)) is not None:
                    properties[name] = [exact(value) for value in values]
            return [exact(t.angle), exact(t.pitch_radius), *([properties] if properties else [])]

        def weight(disks: Disks) -> dict[str, str]:
            if disks.density is None or disks.hole_diameter is None:
                assert disks.mass is not None
                return {"disk_mass": exact(disks.mass)}
            density, hole = exact(disks.density), exact(disks.hole_diameter)
            return {"disk_density": density, "hole_diameter": hole}

        def section(backbone: Backbone) -> dict[str, str]:
            names = [name for name in Backbone.model_fields if name.startswith("end_")]
            names += ["diameter", "width", "height"]
            sizes = {name: getattr(backbone, name) for name in names}
            if backbone.width is not None:
                sizes["width_direction"] = backbone.width_direction
            return {name: exact(size) for name, size in sizes.items() if size is not None}

        def material(backbone: Backbone) -> dict[str, Any]:
            if backbone.stiffness is not None:
                return {
                    "stiffness": [[exact(x) for x in row] for row in backbone.stiffness],
                    "mass_per_length": exact(backbone.mass_per_length or 0.0),
                    "rotary_inertia": exact(backbone.rotary_inertia or 0.0),
                }
            assert backbone.density is not None
            return {
                "inner_diameter": exact(backbone.inner_diameter),
                "E": exact(backbone.young),
                "G": exact(backbone.shear_modulus),
                "density": exact(backbone.density),
            }

        def rest(backbone: Backbone) -> dict[str, str]:
            names = ("rest_bend", "rest_direction", "rest_twist")
            if not any(getattr(backbone, name) for name in names):
                return {}
            return {name: exact(getattr(backbone, name)) for name in names}

        content: dict[str, Any] = {
            "format": 1,
            "gravity": [exact(g) for g in self.gravity],
            "segments": [
                {
                    "length": exact(s.length),
                    **({} if s.tendons_in == "disks" else {"tendons_in": s.tendons_in}),
                    **section(s.backbone),
                    **material(s.backbone),
                    **rest(s.backbone),
                    "disk_positions": [exact(p) for p in s.disk_positions],
                    **weight(s.disks),
                    "disk_radius": exact(s.disks.radius),
                    "disk_thickness": exact(s.disks.thickness),
                    "clamped_length": exact(s.disks.clamped_length),
                    **({"hole_length": exact(hole)} if (hole := s.disks.hole_length) else {}),
                    "tendons": [tendon(t) for t in s.tendon_list],
                }
                for s in self.segments
            ],
        }
        if self.payloads:
            rows = self.payload_numbers.tolist()
            content["payloads"] = [[exact(number) for number in row] for row in rows]
        text = json.dumps(content, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode("ascii")).hexdigest()

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Plausibility warnings: a sentence for each valid but implausible number."""
        return tuple(implausible(self))

    @cached_property
    def core(self) -> Any:
        """Robot of the Rust core (``bowstring._core.Robot``), built at the first use."""
        import bowstring._core as _core

        return _core.Robot(self)


def with_fields(
    robot: Robot, part: str, values: Mapping[str, Any], *, missing: bool = False
) -> Robot:
    """Set fields of a part of all segments, or only where a field is missing.

    A list has one value for each segment. The robot itself where nothing changes.
    """
    changes = {}
    for k, segment in enumerate(robot.segments):
        where = f"segments.{k}.{part}"
        owners = {where: getattr(segment, part)}
        if part == "tendons" and not isinstance(segment.tendons, TendonRing):
            owners = {f"{where}.{i}": tendon for i, tendon in enumerate(segment.tendon_list)}
        for path, owner in owners.items():
            for name, value in values.items():
                chosen, now = value[k] if isinstance(value, list) else value, getattr(owner, name)
                if now != chosen and not (missing and now):
                    changes[f"{path}.{name}"] = chosen
    return robot.with_(changes) if changes else robot


def with_tendons(robot: Robot, values: Mapping[str, float | None], missing: bool = False) -> Robot:
    """Set fields of all tendons of a robot, or only where a field is missing."""
    return with_fields(robot, "tendons", values, missing=missing)


def with_drives(robot: Robot, **values: Floats) -> Robot:
    """Set fields of the drives, such as `gain`, for each tendon (T,), in SI.

    A ring whose drives differ becomes a list. The robot itself where nothing changes.
    """
    changes: dict[str, Any] = {}
    for k, segment in enumerate(robot.segments):
        own = np.flatnonzero(robot.tendons.segment == k)
        drives = [{name: float(each[i]) for name, each in values.items()} for i in own]
        now = [{name: getattr(t, name) for name in values} for t in segment.tendon_list]
        if drives == now:
            continue
        where = f"segments.{k}.tendons"
        if isinstance(segment.tendons, TendonRing) and all(each == drives[0] for each in drives):
            changes |= {f"{where}.{name}": value for name, value in drives[0].items()}
        else:
            tendons = (
                t.model_dump(mode="json", exclude_defaults=True) for t in segment.tendon_list
            )
            changes[where] = [{**t, **each} for t, each in zip(tendons, drives, strict=True)]
    return robot.with_(changes) if changes else robot


def check_parallel(robot: Robot, what: str) -> None:
    """Refuse a robot whose tendons are not parallel to the backbone."""
    if not robot.is_parallel:
        raise InputError(
            f"{what} takes tendons parallel to the backbone only; set turns, end_pitch_radius, "
            "angles and pitch_radii of the tendons aside"
        )


def check_straight(robot: Robot, what: str) -> None:
    """Refuse a robot whose backbone is curved or twisted without load."""
    if robot.rest_curvature.any():
        raise InputError(
            f"{what} takes a backbone that is straight without load only; leave rest_bend and "
            "rest_twist out"
        )


def check_round(robot: Robot, what: str, instead: str = "") -> None:
    """Refuse a robot with a backbone that is not round, or whose shape is not known.

    `instead` is what such a robot can have, as the end of the sentence.
    """
    if robot.has_matrix:
        raise InputError(
            f"{what} needs shape and material of the section, which a backbone by its stiffness "
            f"matrix does not have; give diameter, E, nu and density in place of stiffness{instead}"
        )
    if not robot.is_round:
        raise InputError(
            f"{what} takes round backbones only; give diameter, not width and height{instead}"
        )


def check_tendons(robot: Robot, what: str) -> None:
    """Refuse a bare rod, a robot without tendons."""
    if not len(robot.tendons.segment):
        raise InputError(
            f"{what} needs tendons, and {robot.name} has none; solve, simulate and modes take a "
            "bare rod"
        )


def check_disks(robot: Robot, what: str) -> None:
    """Refuse a robot whose tendons run in its body."""
    if robot.is_embedded:
        raise InputError(f"{what} takes tendons in disks only, not tendons_in body")


def check_without_laws(
    robot: Robot, consequence: str, argument: str = "", *, but: tuple[str, ...] = ()
) -> None:
    """Refuse a robot with laws of `bowstring.robot.laws.LAWS`, where these are not modelled.

    Parameters
    ----------
    robot : Robot
    consequence : str
        End of the first clause of the message, such as ", which no linear model has".
    argument : str, optional
        Name of the argument that is wrong.
    but : tuple of str, optional
        Laws that are modelled.

    Raises
    ------
    InputError
        If it has a law other than these.
    """
    for key in robot.laws:
        if key not in but:
            raise InputError(LAWS[key].refusal(robot.name, consequence), argument=argument)


def without_laws(robot: Robot, *but: str) -> Robot:
    """Return the robot without the laws of `bowstring.robot.laws.LAWS`, but for some."""
    for key in robot.laws:
        if key not in but:
            law = LAWS[key]
            robot = with_fields(robot, law.part, dict.fromkeys(law.sizes, law.none))
    return robot


def check_robot(robot: object) -> None:
    """Refuse an object that is not a robot, such as its name."""
    if not isinstance(robot, Robot):
        raise InputError(
            f"robot is {shown(robot)}, it must be a Robot, as bowstring.load_robot gives it"
        )
