"""JSON of the command suite."""

from __future__ import annotations

from typing import Annotated

from bowstring.schemas.basic import MadeBy, Object, about
from bowstring.schemas.results import beside
from bowstring.suite import summary


@beside(summary.Suite)
class Suite(Object):
    """Output of `bowstring suite`."""

    folder: Annotated[str | None, about("Folder of `--out`; `null` without it.")]
    provenance: Annotated[MadeBy, about("Version and settings.")]
