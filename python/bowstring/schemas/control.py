"""JSON of `bowstring control` and `bowstring reach`."""

from __future__ import annotations

from typing import Annotated

from bowstring.schemas.basic import OfRobot, about
from bowstring.schemas.results import beside
from bowstring.validity.control import ControlErrors
from bowstring.validity.reach import Reach


@beside(ControlErrors)
class Control(OfRobot):
    """Output of `bowstring control`."""

    text: Annotated[list[str], about("The result in sentences.")]
    file: Annotated[str | None, about("File of the figure; `null` if it could not be drawn.")]


@beside(Reach)
class ReachFound(OfRobot):
    """Output of `bowstring reach`."""

    text: Annotated[list[str], about("The result in sentences.")]
    file: Annotated[str | None, about("File of the figure; `null` if it could not be drawn.")]
