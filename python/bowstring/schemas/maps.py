"""JSON of the command map."""

from __future__ import annotations

from typing import Annotated

from bowstring.schemas.basic import Object, OfRobot, about
from bowstring.schemas.results import beside
from bowstring.validity.maps import ValidityMap
from bowstring.validity.multi_axis_maps import ValidityGrid
from bowstring.validity.spread import Spread
from bowstring.validity.workspace import WorkspaceMap


@beside(WorkspaceMap)
class Workspace(OfRobot):
    """Output of `bowstring reach --errors`."""

    text: Annotated[list[str], about("The map in sentences.")]
    file: Annotated[str | None, about("File of the map; `null` if it could not be drawn.")]


@beside(ValidityMap)
class Map(OfRobot):
    """Output of `bowstring map`."""

    text: Annotated[list[str], about("The map in sentences.")]
    file: Annotated[str | None, about("File of the map; `null` if it could not be drawn.")]


@beside(ValidityGrid)
class Grid(OfRobot):
    """Output of `bowstring map` with more than two `--over`."""

    text: Annotated[list[str], about("The map in sentences.")]
    file: Annotated[str | None, about("File of the map; `null` if it could not be drawn.")]


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
