"""Values that the shell offers for arguments and flags.

A press of the tab key waits for this, so nothing here imports what takes long. Of the values, typer
shows those that begin as the text does; where there are none, the shell completes names of files.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeAlias

import typer

#: Gives values; parameters as typer's `autocompletion` has them.
Offer: TypeAlias = Callable[..., list[str]]
_PACKAGE: Final = Path(__file__).parents[1]
#: Parts of each public data set, as `bowstring.data.datasets` has them.
DATA_SETS: Final[dict[str, tuple[str, ...]]] = {
    "crl-ftdcr-mocap": ("train", "val", "keypoints", "tendon_pull"),
    "sorosim-rods": (),
    "tamm-spring": ("bending",),
    "ucl-planar-shape": ("shapes",),
}


def words(*known: str) -> Offer:
    """Offer these words."""

    def offer() -> list[str]:
        return list(known)

    return offer


def formats(*suffixes: str) -> Offer:
    """Offer the formats of a file to write, once its name has a dot."""

    def offer(incomplete: str) -> list[str]:
        stem, dot, begun = incomplete.rpartition(".")
        if not dot or "/" in begun or stem.rpartition("/")[2] in ("", "."):
            return []
        return [stem + suffix for suffix in suffixes]

    return offer


def _yaml_files(folder: str) -> Offer:
    """Offer built-in files of a folder by name, and the YAML files where the text leads."""

    def offer(incomplete: str) -> list[str]:
        names = sorted(path.stem for path in (_PACKAGE / folder).glob("*.yaml"))
        place = incomplete[: incomplete.rfind("/") + 1]
        try:
            beside = sorted(file.name for file in Path(place).iterdir())
        except OSError:
            beside = []
        return names + [place + name for name in beside if name.endswith((".yaml", ".yml"))]

    return offer


robots: Final = _yaml_files("robot/builtin")
mappings: Final = _yaml_files("data/mappings")
data_sets: Final = words(*DATA_SETS)


def parts(context: typer.Context) -> list[str]:
    """Offer the tables of the data set that --data names, or of all sets."""
    named = DATA_SETS.get(context.params.get("data", ""))
    return [part for each in (DATA_SETS.values() if named is None else [named]) for part in each]
