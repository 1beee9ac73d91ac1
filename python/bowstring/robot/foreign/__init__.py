"""Drafts of robot files from parameter files of other programs, whose code is not run."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from bowstring.errors import InputError
from bowstring.robot.draft import Draft
from bowstring.robot.foreign import opencr_mujoco, soromox, tdcr_modeling
from bowstring.robot.safe_yaml import reading, text_of
from bowstring.units import printable

__all__ = ["convert"]

_LONGEST: Final = 100_000  # characters
_READERS: Final = {
    ".json": opencr_mujoco.draft,
    ".py": soromox.draft,
    ".m": tdcr_modeling.draft_matlab,
    ".cpp": tdcr_modeling.draft_cpp,
}


def convert(file: Path) -> Draft:
    """Draft a robot file from a parameter file of another program.

    What the file does not state is marked as assumed in the draft.

    Parameters
    ----------
    file : Path
        A configuration of opencr-mujoco (``.json``), a script of soromox (``.py``) or parameters
        of tdcr-modeling (``.m``, ``.cpp``).

    Returns
    -------
    Draft

    Raises
    ------
    InputError
        If it cannot be read, is of no known program, or has no robot that Bowstring models.
    """
    label, ending = printable(str(file)), file.suffix.lower()
    with reading(label):
        if not file.is_file():
            raise InputError(f"{label} is not a file; give the parameter file to convert.")
        text = "" if ending in (".mat", ".mlx") else text_of(file, label, "parameter")
    if ending in (".mat", ".mlx") or (ending == ".m" and "SorosimLink" in text):
        raise InputError(
            f"{label}: SoRoSim is not converted; give the numbers of its links instead: "
            "--material NAME,E --diameter 2r --lengths L and --pitch-radius of its tendons."
        )
    if ending not in _READERS:
        raise InputError(
            f"{label}: cannot tell what it is; its name must end in .json (opencr-mujoco), .py "
            "(soromox), or .m or .cpp (tdcr-modeling)."
        )
    if len(text) > _LONGEST:
        raise InputError(f"{label} is too long; keep only the robot's parameters in it.")
    draft = _READERS[ending](text, label)
    draft.head = f"Converted from {file.name}. Check it, and change what is assumed."
    return draft
