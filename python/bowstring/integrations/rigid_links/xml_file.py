"""Names, sizes and writing of the XML files of a chain."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from bowstring.files.atomic_io import write_whole_file
from bowstring.integrations.rigid_links.chain import Body, LinkChain

__all__ = ["LEAST", "backbone_radius", "disk_thickness", "joint_names", "row", "write_xml"]

_NAMES: Final = ("bend1", "bend2", "twist")
#: Least mass in kg and moment of inertia in kg m^2: simulators move no body without inertia.
LEAST: Final = 1e-12


def joint_names(chain: LinkChain) -> list[list[str]]:
    """Names of the hinges of each joint, in the order of `LinkChain.order`.

    Parameters
    ----------
    chain : LinkChain
        The links.

    Returns
    -------
    list of list of str
        Three for each joint, such as ``["bend1_1", "bend2_1", "twist_1"]``.
    """
    return [[f"{_NAMES[k]}_{b + 1}" for k in row] for b, row in enumerate(chain.order)]


def row(values: Iterable[float]) -> str:
    """Numbers as an attribute."""
    return " ".join(f"{float(v) + 0.0:.12g}" for v in values)  # + 0.0: no -0


def backbone_radius(chain: LinkChain) -> float:
    """Radius with which the backbone is shown, m."""
    diameters = [s.backbone.diameter for s in chain.robot.segments]
    known = [d for d in diameters if d is not None]
    if len(known) == len(diameters):
        return 0.5 * max(known)
    return 0.05 * float(chain.robot.disks.radius_m.min())


def disk_thickness(chain: LinkChain, body: Body) -> float:
    """Thickness with which the disk of a body is shown, m."""
    assert body.disk is not None
    return max(float(chain.robot.disks.thickness_m[body.disk]), 2e-3 * chain.robot.length)


def write_xml(
    root: ET.Element, comment: str, file: Path, what: str, check: Callable[[Path], Path]
) -> Path:
    """Write a file whole or not at all; the comment stands first, and marks it as ours."""
    ET.indent(root)
    text = f"<!-- {comment} -->\n{ET.tostring(root, encoding='unicode')}\n"

    def fill(new: Path) -> None:
        new.write_text(text, "utf-8")

    write_whole_file(file, what, fill, lambda: check(file))
    return file
