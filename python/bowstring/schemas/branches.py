"""JSON of the command branches."""

from __future__ import annotations

from typing import Annotated

from bowstring.schemas.basic import OfRobot, about
from bowstring.schemas.results import beside
from bowstring.statics.branches import BranchDiagram


@beside(BranchDiagram)
class Branches(OfRobot):
    """Output of `bowstring branches`."""

    text: Annotated[list[str], about("The diagram in sentences.")]
    file: Annotated[str | None, about("Figure; `null` if it could not be drawn.")]
