"""Shell completion of arguments and flags.

Completion must be fast, so this module imports nothing slow. Typer shows the values that begin with
the typed text; without any, the shell completes file names.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeAlias

import typer

#: Function that returns values, with the parameters of typer's `autocompletion`.
Offer: TypeAlias = Callable[..., list[str]]
_PACKAGE: Final = Path(__file__).parents[1]
#: Parts of each public data set, as `bowstring.data.datasets` has them.
DATA_SETS: Final[dict[str, tuple[str, ...]]] = {
    "crl-ftdcr-mocap": ("train", "val", "keypoints", "tendon_pull"),
    "soromox-tentacle": ("markers",),
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
    """Offer built-in files of a folder by name, and YAML files at the typed path."""

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
    """Offer the tables of the data set of --data, or of all sets without it."""
    named = DATA_SETS.get(context.params.get("data", ""))
    return [part for each in (DATA_SETS.values() if named is None else [named]) for part in each]
