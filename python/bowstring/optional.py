"""Packages that are installed only with an extra of Bowstring."""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Final

from bowstring.errors import InputError
from bowstring.interrupts import is_interrupt

__all__ = ["EXTRAS", "load_extra"]

#: Module of each extra, its purpose, and the feature that needs it.
EXTRAS: Final = {
    "cad": ("build123d", "solids", "solids of bowstring export"),
    "excel": ("openpyxl", "Excel tables", "measurements as .xlsx"),
    "download": ("requests", "downloads", "bowstring data get"),
    "uncertainty": ("SALib", "screening and second-order indices", "Morris screening"),
    "cluster": ("distributed", "clusters and Zarr", "bowstring.jobs"),
    "jax": ("jax", "equilibria in JAX", "bowstring.jax"),
    "gymnasium": ("gymnasium", "environments", "bowstring.gymnasium"),
    "view": ("viser", "live views", "bowstring view"),
    "rerun": ("rerun", "recordings", "simulate --out run.rrd"),
}


def load_extra(extra: str, module: str = "") -> ModuleType:
    """Import the module of an extra.

    Parameters
    ----------
    extra : str
        Name of an extra in `EXTRAS`.
    module : str
        Another module of the extra, instead of that in `EXTRAS`.

    Raises
    ------
    InputError
        If the module cannot be imported; the message has the command that installs it.
    """
    name, purpose, _ = EXTRAS[extra]
    name = module or name
    try:
        return importlib.import_module(name)
    except ImportError as error:
        if is_interrupt(error):
            raise KeyboardInterrupt from None
        why = "" if error.name == name else f" ({error})"
        if "libGL" in why:  # the CAD kernel is installed, the system's OpenGL library is not
            cure = (
                "install the system's OpenGL library, on Debian and Ubuntu: apt-get install libgl1"
            )
        else:
            cure = f"install it: pip install 'bowstring[{extra}]'"
        raise InputError(f"{purpose} need {name}, which cannot be loaded{why}; {cure}") from None
