"""A robot as an MJCF model for MuJoCo: links, springs, and tendons with a motor each."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np

from bowstring._core import __version__
from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.files.atomic_io import check_file
from bowstring.integrations.rigid_links.chain import Body, LinkChain
from bowstring.integrations.rigid_links.xml_file import (
    LEAST,
    backbone_radius,
    disk_thickness,
    joint_names,
    row,
    write_xml,
)
from bowstring.inverse.limits import default_max_tension
from bowstring.statics.load import Load

__all__ = ["check_mjcf", "write_mjcf"]

_WHAT: Final = "MJCF model"
_MARK: Final = b"<!-- Bowstring MJCF"
_DAMPING_TIME: Final = 0.01
_LONGEST_STEP: Final = 0.002  # s
_GREY, _DARK, _RED = "0.45 0.45 0.45 0.6", "0.15 0.15 0.15 1", "0.75 0.2 0.15 1"


def check_mjcf(path: str | Path) -> Path:
    """Check before any work that a model may be written to a ``.xml`` file; return its path."""
    return check_file(Path(path), _WHAT, (".xml",), _MARK)


def write_mjcf(
    chain: LinkChain,
    path: str | Path,
    *,
    load: Load | None = None,
    damping_time: float = _DAMPING_TIME,
) -> Path:
    """Write a chain of rigid links as an MJCF model for MuJoCo.

    The joints have the springs of the chain; each tendon has a motor ``tendon1``, ... whose control
    is its tension in N, and passes all holes without friction. Lengths are in m, the base frame is
    that of the robot.

    Parameters
    ----------
    chain : LinkChain
        The links to write.
    path : str or Path
        Ends in ``.xml``; an older model is replaced.
    load : Load, optional
        Its equilibrium is the key frame ``loaded`` of the model, which starts unloaded; gravity is
        that of the load. Loads at the tip are not in the file.
    damping_time : float
        Damping of each hinge over its stiffness, s.

    Returns
    -------
    Path
        The file, absolute.

    Raises
    ------
    InputError
        If the file cannot be written, or an argument is wrong.
    NoSolutionError
        If the chain has no equilibrium under the load.
    """
    file = check_mjcf(path)
    if not (damping_time > 0.0 and math.isfinite(damping_time)):
        raise InputError(f"damping_time is {damping_time}, it must be above 0 s")
    root = _model(chain, load, damping_time)
    comment = f"Bowstring MJCF {__version__}: rigid links with springs, which approximate the rod"
    return write_xml(root, comment, file, _WHAT, check_mjcf)


def _model(chain: LinkChain, load: Load | None, damping_time: float) -> ET.Element:
    robot = chain.robot
    gravity = robot.gravity if load is None or load.gravity is None else load.gravity
    root = ET.Element("mujoco", model=robot.name)
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    # the springs are explicit and their damping is implicit: stable up to twice the damping time
    step = min(_LONGEST_STEP, 0.5 * damping_time)
    ET.SubElement(
        root, "option", timestep=row([step]), integrator="implicitfast", gravity=row(gravity)
    )
    sites = _sites(chain)
    parent = ET.SubElement(root, "worldbody")
    _add_sites(parent, sites, -1)
    names = joint_names(chain)
    for b, body in enumerate(chain.bodies):
        parent = ET.SubElement(parent, "body", name=f"link{b + 1}", pos=row(body.start))
        for k, axis in enumerate(chain.axes[b]):
            ET.SubElement(
                parent,
                "joint",
                name=names[b][k],
                type="hinge",
                axis=row(axis),
                stiffness=row([chain.stiffness[b, k]]),
                damping=row([chain.stiffness[b, k] * damping_time]),
            )
        _add_inertial(parent, body)
        _add_shapes(parent, chain, body)
        _add_sites(parent, sites, b)
        if b == len(chain.bodies) - 1:
            ET.SubElement(parent, "site", name="tip", pos=row([0.0, 0.0, body.length]), size="1e-4")
    tendons = ET.SubElement(root, "tendon")
    motors = ET.SubElement(root, "actuator")
    width = 0.01 * float(robot.disks.radius_m.min())
    for i, most in enumerate(default_max_tension(robot)):
        spatial = ET.SubElement(
            tendons, "spatial", name=f"tendon{i + 1}", width=row([width]), rgba=_RED
        )
        for name, _, _ in sites[i]:
            ET.SubElement(spatial, "site", site=name)
        # a tension shortens the tendon
        ET.SubElement(
            motors,
            "motor",
            name=f"tendon{i + 1}",
            tendon=f"tendon{i + 1}",
            gear="-1",
            ctrlrange=row([0.0, most]),
        )
    if load is not None:
        keys = ET.SubElement(root, "keyframe")
        tensions = np.zeros(len(sites)) if load.tensions is None else load.tensions
        ET.SubElement(
            keys, "key", name="loaded", qpos=row(chain.solve(load).ravel()), ctrl=row(tensions)
        )
    return root


_Site = tuple[str, int, Floats]
"""Name, body, and position in it."""


def _sites(chain: LinkChain) -> list[list[_Site]]:
    """Holes of each tendon."""
    return [
        [(f"hole{i + 1}_{j}", body, place) for j, (body, place) in enumerate(path)]
        for i, path in enumerate(chain.tendon_points)
    ]


def _add_sites(parent: ET.Element, sites: Iterable[Iterable[_Site]], body: int) -> None:
    for path in sites:
        for name, own, place in path:
            if own == body:
                ET.SubElement(parent, "site", name=name, pos=row(place), size="1e-4")


def _add_inertial(parent: ET.Element, body: Body) -> None:
    own = body.inertia + LEAST * np.eye(3)
    six = [own[0, 0], own[1, 1], own[2, 2], own[0, 1], own[0, 2], own[1, 2]]
    ET.SubElement(
        parent,
        "inertial",
        pos=row(body.centre),
        mass=row([max(body.mass, LEAST)]),
        fullinertia=row(six),
    )


def _add_shapes(parent: ET.Element, chain: LinkChain, body: Body) -> None:
    """Add the visible shapes, which do not collide."""
    seen: dict[str, Any] = {"contype": "0", "conaffinity": "0", "mass": "0"}
    ET.SubElement(
        parent,
        "geom",
        type="capsule",
        fromto=row([0, 0, 0, 0, 0, body.length]),
        size=row([backbone_radius(chain)]),
        rgba=_DARK,
        **seen,
    )
    if body.disk is not None:
        size = [chain.robot.disks.radius_m[body.disk], 0.5 * disk_thickness(chain, body)]
        ET.SubElement(
            parent,
            "geom",
            type="cylinder",
            pos=row([0.0, 0.0, body.disk_centre]),
            size=row(size),
            rgba=_GREY,
            **seen,
        )
