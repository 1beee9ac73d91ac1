"""A robot as a URDF model: links and joints for viewers and planners, no springs or tendons."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Final

import numpy as np

from bowstring._core import __version__
from bowstring.aliases import Floats
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

__all__ = ["check_urdf", "write_urdf"]

_WHAT: Final = "URDF model"
_MARK: Final = b"<!-- Bowstring URDF"
_MOST_ANGLE: Final = 0.5 * math.pi
_EFFORT, _VELOCITY = "1000", "100"


def check_urdf(path: str | Path) -> Path:
    """Check before any work that a model may be written to a ``.urdf`` file; return its path."""
    return check_file(Path(path), _WHAT, (".urdf",), _MARK)


def write_urdf(chain: LinkChain, path: str | Path) -> Path:
    """Write a chain of rigid links as a URDF model.

    URDF knows neither springs nor tendons: the model shows poses, by the angles of
    `LinkChain.angles_of` or `LinkChain.solve`, and does not find them.

    Parameters
    ----------
    chain : LinkChain
        The links to write.
    path : str or Path
        Ends in ``.urdf``; an older model is replaced.

    Returns
    -------
    Path
        The file, absolute.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    file = check_urdf(path)
    comment = f"Bowstring URDF {__version__}: rigid links; URDF has no springs and no tendons"
    return write_xml(_model(chain), comment, file, _WHAT, check_urdf)


def _model(chain: LinkChain) -> ET.Element:
    root = ET.Element("robot", name=chain.robot.name)
    ET.SubElement(root, "link", name="base")
    parent = "base"
    names = joint_names(chain)
    for b, body in enumerate(chain.bodies):
        for k, axis in enumerate(chain.axes[b]):
            last = k == 2
            child = f"link{b + 1}" if last else f"link{b + 1}_hinge{k + 1}"
            link = ET.SubElement(root, "link", name=child)
            if last:
                _fill_link(link, chain, body)
            else:
                _add_inertial(link, np.zeros(3), 0.0, np.zeros((3, 3)))
            joint = ET.SubElement(root, "joint", name=names[b][k], type="revolute")
            ET.SubElement(joint, "parent", link=parent)
            ET.SubElement(joint, "child", link=child)
            ET.SubElement(joint, "origin", xyz=row(body.start if k == 0 else np.zeros(3)))
            ET.SubElement(joint, "axis", xyz=row(axis))
            ET.SubElement(
                joint,
                "limit",
                lower=row([-_MOST_ANGLE]),
                upper=row([_MOST_ANGLE]),
                effort=_EFFORT,
                velocity=_VELOCITY,
            )
            parent = child
    ET.SubElement(root, "link", name="tip")
    joint = ET.SubElement(root, "joint", name="tip", type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link="tip")
    ET.SubElement(joint, "origin", xyz=row([0.0, 0.0, chain.bodies[-1].length]))
    return root


def _fill_link(link: ET.Element, chain: LinkChain, body: Body) -> None:
    _add_inertial(link, body.centre, body.mass, body.inertia)
    _add_cylinder(link, 0.5 * body.length, backbone_radius(chain), body.length)
    if body.disk is not None:
        radius = float(chain.robot.disks.radius_m[body.disk])
        _add_cylinder(link, body.disk_centre, radius, disk_thickness(chain, body))


def _add_cylinder(link: ET.Element, centre: float, radius: float, length: float) -> None:
    visual = ET.SubElement(link, "visual")
    ET.SubElement(visual, "origin", xyz=row([0.0, 0.0, centre]))
    geometry = ET.SubElement(visual, "geometry")
    ET.SubElement(geometry, "cylinder", radius=row([radius]), length=row([length]))


def _add_inertial(link: ET.Element, centre: Floats, mass: float, inertia: Floats) -> None:
    own = inertia + LEAST * np.eye(3)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=row(centre))
    ET.SubElement(inertial, "mass", value=row([max(mass, LEAST)]))
    names = {
        "ixx": (0, 0),
        "ixy": (0, 1),
        "ixz": (0, 2),
        "iyy": (1, 1),
        "iyz": (1, 2),
        "izz": (2, 2),
    }
    ET.SubElement(inertial, "inertia", {name: row([own[at]]) for name, at in names.items()})
