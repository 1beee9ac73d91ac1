"""JSON of commands that print a result, and little more.

These are branches, control, fit, map, reach, suite and uncertainty.
"""

from __future__ import annotations

from typing import Annotated

from bowstring.calibration.model_comparison import ComparisonInterrupted, ModelComparison
from bowstring.calibration.orientation_fit import OrientationFit
from bowstring.calibration.residual_comparison import ResidualStudy
from bowstring.calibration.table_fit import Calibration
from bowstring.cli.schemas.basic import InFolder, MadeBy, OfRobot
from bowstring.cli.schemas.results import beside
from bowstring.results import Object, about
from bowstring.statics import branches
from bowstring.suite import summary
from bowstring.validity.control import ControlErrors
from bowstring.validity.map_result import ValidityMap
from bowstring.validity.multi_axis_maps import ValidityGrid
from bowstring.validity.reach import Reach
from bowstring.validity.spread import Spread
from bowstring.validity.workspace import WorkspaceMap


class WithFigure(OfRobot):
    """Addition of commands that draw their result."""

    text: Annotated[list[str], about("The result in sentences.")]
    file: Annotated[
        str | None, about("File of the figure or map; `null` if it could not be drawn.")
    ]


@beside(branches.BranchDiagram)
class Branches(WithFigure):
    """Output of `bowstring branches`."""


@beside(ControlErrors)
class Control(WithFigure):
    """Output of `bowstring control`."""


@beside(Reach)
class ReachFound(WithFigure):
    """Output of `bowstring reach`."""


@beside(WorkspaceMap)
class Workspace(WithFigure):
    """Output of `bowstring reach --errors`."""


@beside(ValidityMap)
class Map(WithFigure):
    """Output of `bowstring map`."""


@beside(ValidityGrid)
class Grid(WithFigure):
    """Output of `bowstring map` with more than two `--over`."""


class StoredValues(Object):
    """A map computed in blocks."""

    points: Annotated[int, about("Number of points.")]
    blocks: Annotated[int, about("Number of blocks.")]
    folder: Annotated[str, about("Folder of the blocks.")]
    text: Annotated[list[str], about("The map in sentences; of up to 5 million points.")]
    file: Annotated[
        str | None,
        about("Data set of the map, NetCDF or Zarr, or its figure; `null` if it is not drawn."),
    ]


class StoredMap(OfRobot, StoredValues):
    """Output of `bowstring map --store`."""


@beside(Spread)
class Uncertainty(OfRobot):
    """Output of `bowstring uncertainty`."""

    file: Annotated[str | None, about("Figure; `null` if it could not be drawn.")]


@beside(Calibration)
class Fit(OfRobot, InFolder):
    """Output of `bowstring fit`."""

    residual: Annotated[ResidualStudy | None, about("Residual; `null` without `--residual`.")]
    comparison: Annotated[
        ModelComparison | None, about("Comparison of models; `null` without `--compare`.")
    ]


@beside(ComparisonInterrupted)
class StoppedComparison(OfRobot, InFolder):
    """Output of `bowstring fit --compare` that was stopped by Ctrl-C; there is no fit."""


@beside(OrientationFit)
class FitOfAngles(OfRobot):
    """Output of `bowstring fit` of a table with angles only."""


@beside(summary.Suite)
class Suite(Object):
    """Output of `bowstring suite`."""

    folder: Annotated[str | None, about("Folder of `--out`; `null` without it.")]
    provenance: Annotated[MadeBy, about("Version and settings.")]
