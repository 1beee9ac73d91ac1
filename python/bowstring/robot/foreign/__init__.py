"""Drafts of robot files from the parameter files of other programs: numbers only, no code is run.

What a source does not state is marked in the draft as assumed, never invented.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from bowstring.errors import InputError
from bowstring.robot.draft import Draft
from bowstring.robot.foreign import opencr_mujoco, soromox, sorosim, tdcr_modeling
from bowstring.robot.safe_yaml import reading, text_of
from bowstring.units import printable

__all__ = ["convert"]

#: What to do with files that hold objects of MATLAB or no robot with tendons.
_REFUSED: Final = {
    ".mat": "holds objects that only MATLAB reads: there, write L, E, Poi, Rho and r of each link "
    'as assignments to a script (L1.L = 0.3; ... L1.r{1} = @(X1)0.03;), and give "--from SCRIPT.m"',
    ".mlx": "is a live script: save it in MATLAB as a script, .m",
    ".npz": "holds soromox's HSA or McKibben actuators, which are no backbone with tendons; give "
    "a script with LinkSpec or PCSParams",
}


def convert(file: Path) -> Draft:
    """Draft a robot file from a parameter file of another program.

    Parameters
    ----------
    file : Path
        A configuration of opencr-mujoco (``.json``), a script of soromox (``.py``), parameters of
        tdcr-modeling (``.m``, ``.cpp``, ``.h``), or links of SoRoSim (``.m``).

    Returns
    -------
    Draft

    Raises
    ------
    InputError
        If it cannot be read, is of no known program, or has no robot that Bowstring models.
    """
    label, ending = printable(str(file)), file.suffix.lower()
    if ending in _REFUSED:
        raise InputError(f"{label} {_REFUSED[ending]}.")
    with reading(label):
        if not file.is_file():
            raise InputError(f"{label} is not a file; give the parameter file to convert.")
        text = text_of(file, label, "parameter")
    if ending == ".json":
        draft = opencr_mujoco.draft(text, label)
    elif ending == ".py":
        draft = soromox.draft(text, label)
    elif ending in (".cpp", ".cc", ".cxx", ".h", ".hpp"):
        draft = tdcr_modeling.draft_cpp(text, label)
    elif ending == ".m":
        of_links = re.search(r"SorosimLink|\w\.(E|L|ld|Poi|Rho)\b", text)
        draft = (sorosim.draft if of_links else tdcr_modeling.draft_matlab)(text, label)
    else:
        raise InputError(
            f"{label}: cannot tell what it is; end its name in .json (opencr-mujoco), .py "
            "(soromox), .m (SoRoSim, tdcr-modeling) or .cpp (tdcr-modeling)."
        )
    draft.head = (f"Converted from {file.name}. Check it, and change what is assumed.", *draft.head)
    return draft
