"""The figures and tables of the source study, each with its counterpart in a report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from bowstring.errors import InputError
from bowstring.robot.model import check_round

if TYPE_CHECKING:
    from bowstring.study.study import Study

_SOLID: Final = "run the study with --solid, which needs the extra cad"
_DATA: Final = "run the study with --measurements FILE, measurements of this robot"


@dataclass(frozen=True)
class Counterpart:
    """A figure or table of the source study (Amouri 2019), and its counterpart in the report."""

    source: str
    """Number in the source study, such as ``"Fig. 1"``."""
    shows: str
    """Content in words."""
    anchor: str | None
    """Anchor of the figure or section in the report; None without a counterpart."""
    title: str
    """Title of the figure or section."""
    missing: str
    """Why there is no counterpart, or how to get it."""


_ALL: Final = (
    ("Fig. 1", "the robot", "fig01_robot", ""),
    ("Fig. 1", "the robot as a solid", "fig01_solid", _SOLID),
    ("Fig. 2", "spacer disk with dimensions", "fig02_disk", ""),
    ("Fig. 2", "arc of a segment", "fig02_arc", ""),
    ("Fig. 3", "global view of the spaces and maps", "fig03_spaces", ""),
    ("Fig. 4", "geometry of a module", "fig04_module", ""),
    ("Fig. 5", "tip, displacement, stress and strain", "fig05_tip_against_force", ""),
    ("Fig. 6a", "lengths of all tendons", "fig06_geometric_sweep", ""),
    ("Fig. 6b", "tip by constant curvature", "fig06_geometric_sweep", ""),
    ("Fig. 7", "configurations", "fig07_configurations", ""),
    ("Fig. 8", "the test bench", None, "a photograph of the article's own bench"),
    ("Fig. 9", "measured tip", "fig09_measured_tip", _DATA),
    ("Fig. 10", "constant curvature over the simulation", "fig10_overlay", ""),
    ("Fig. 11", "errors against the simulation", "fig11_errors", ""),
    ("Fig. 12", "errors against the measurement", "fig12_measured_errors", _DATA),
    ("Eqs. 1 to 5", "constant curvature, with numbers", "equations", ""),
    ("Table 1", "parameters of the robot", "robot", ""),
)


def counterparts(study: Study) -> tuple[Counterpart, ...]:
    """List the figures and tables of the source study with their counterparts in a report.

    Parameters
    ----------
    study : Study
        Of any robot.

    Returns
    -------
    tuple of Counterpart
        In the order of the source study.
    """
    here = {"equations": "Equations with this robot's numbers", "robot": "The robot"}
    here |= {figure.stem: figure.title for figure in study.figures}
    reasons = {"fig02_disk": study.without_disks}
    try:
        check_round(study.robot, "the solid")
    except InputError as error:
        reasons["fig01_solid"] = str(error)
    return tuple(
        Counterpart(
            source,
            shows,
            anchor if anchor in here else None,
            here.get(anchor or "", ""),
            reasons.get(anchor or "", missing),
        )
        for source, shows, anchor, missing in _ALL
    )
