"""A robot as a flat description in SI for the C library, which reads no robot files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.errors import InputError
from bowstring.inverse.limits import default_max_tension
from bowstring.robot.laws import OF_MOTION
from bowstring.robot.model import check_robot, check_without_laws
from bowstring.statics.actuation import compliances

if TYPE_CHECKING:
    from bowstring.robot.model import Robot

FORMAT: Final = "bowstring compiled robot"
FORMAT_VERSION: Final = 1


def compile_robot(robot: Robot) -> dict[str, Any]:
    """Describe a robot by plain numbers in SI, with all defaults and units resolved.

    The C library (``bowstring.h``) reads this as JSON. It has what statics need: sections, disks,
    routing of the tendons, payloads and gravity; and for each tendon its compliance from motor to
    end disk, its pretension and the default of its largest tension in inverse kinematics.

    Parameters
    ----------
    robot : Robot
        Robot without friction.

    Returns
    -------
    dict
        ``format, format_version, tendon_path, segments, disks, tendons, payloads,
        gravity_m_per_s2``, ready for `json.dumps`; docs/reference/json.md has all keys.

    Raises
    ------
    InputError
        If the robot has a law of `bowstring.robot.laws`, such as friction, or rods or chambers,
        which the library does not model.

    Examples
    --------
    >>> import bowstring as bs
    >>> found = bs.compile_robot(bs.load_robot("amouri2019"))
    >>> len(found["disks"]), found["tendons"][1]["end_disk"]
    (9, 8)
    """
    check_robot(robot)
    check_without_laws(
        robot,
        ", which the C library does not model",
        but=OF_MOTION,
    )
    if robot.tendons.pushes.any():
        raise InputError(
            f"{robot.name} has rods or chambers that push, which the C library does not model; set "
            "their kind to tendon"
        )
    disks, tendons = robot.disks, robot.tendons
    given = ~np.isnan(robot.section_stiffness[:, 0, 0])
    segments = [
        {
            # one section where all five are equal
            "sections": sections[:1].tolist()
            if coupled or (sections == sections[0]).all()
            else sections.tolist(),
            "stiffness": stiffness.tolist() if coupled else None,
        }
        for sections, stiffness, coupled in zip(
            robot.sections, robot.section_stiffness, given, strict=True
        )
    ]
    per_tendon = zip(
        tendons.holes_m.tolist(),
        tendons.end_disk.tolist(),
        compliances(robot).tolist(),
        tendons.pretension_N.tolist(),
        default_max_tension(robot).tolist(),
        strict=True,
    )
    return {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "tendon_path": "embedded" if robot.is_embedded else "straight",
        "segments": segments,
        "disks": [
            {
                "station_m": float(disks.station_m[k]),
                "clamped_length_m": float(disks.clamped_length_m[k]),
                "hole_length_m": float(disks.hole_length_m[k]),
                "mass_kg": float(disks.mass_kg[k]),
                "inertia_kg_m2": disks.inertia_kg_m2[k].tolist(),
                "segment": int(disks.segment[k]),
            }
            for k in range(len(disks.station_m))
        ],
        "tendons": [
            {
                "holes_m": holes[: end + 2],
                "end_disk": end,
                "compliance_m_per_N": compliance,
                "pretension_N": pretension,
                "max_tension_N": most,
            }
            for holes, end, compliance, pretension, most in per_tendon
        ],
        "payloads": [
            {
                "disk": int(row[0]),
                "mass_kg": float(row[1]),
                "centre_m": row[2:5].tolist(),
                "inertia_kg_m2": row[5:8].tolist(),
            }
            for row in np.asarray(robot.payload_numbers, dtype=float)
        ],
        "gravity_m_per_s2": [float(g) for g in robot.gravity],
    }
