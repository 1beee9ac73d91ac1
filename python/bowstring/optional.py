"""Packages that Bowstring uses where they are installed."""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Final, NamedTuple

from bowstring.errors import InputError
from bowstring.interrupts import is_interrupt


class Extra(NamedTuple):
    """A package and what it is for."""

    module: str
    purpose: str
    """In the plural, as in "solids need build123d"."""
    feature: str
    """Command or module of Bowstring that needs it."""
    requirement: str
    """What pip installs: an extra of Bowstring, or the package itself."""

    @property
    def command(self) -> str:
        """Command that installs it."""
        quote = "'" if "[" in self.requirement else ""
        return f"pip install {quote}{self.requirement}{quote}"


#: Optional packages by name: extras of Bowstring, and PyTorch, whose builds differ by processor.
EXTRAS: Final = {
    "cad": Extra("build123d", "solids", "solids of bowstring export", "bowstring[cad]"),
    "excel": Extra("openpyxl", "Excel tables", "measurements as .xlsx", "bowstring[excel]"),
    "rosbag": Extra("mcap", "ROS bags", "measurements as .mcap", "bowstring[rosbag]"),
    "matlab": Extra(
        "h5py", "MATLAB files of version 7.3", "measurements as .mat 7.3", "bowstring[matlab]"
    ),
    "download": Extra("requests", "downloads", "bowstring data get", "bowstring[download]"),
    "uncertainty": Extra(
        "SALib", "screening and second-order indices", "Morris screening", "bowstring[uncertainty]"
    ),
    "cluster": Extra("distributed", "clusters and Zarr", "bowstring.jobs", "bowstring[cluster]"),
    "jax": Extra("jax", "equilibria in JAX", "bowstring.jax", "bowstring[jax]"),
    "gymnasium": Extra("gymnasium", "environments", "bowstring.gymnasium", "bowstring[gymnasium]"),
    "view": Extra("viser", "live views", "bowstring view", "bowstring[view]"),
    "rerun": Extra("rerun", "recordings", "simulate --out run.rrd", "bowstring[rerun]"),
    "torch": Extra("torch", "equilibria in PyTorch", "bowstring.torch", "torch"),
}


def load_extra(extra: str, module: str = "") -> ModuleType:
    """Import the module of an optional package.

    Parameters
    ----------
    extra : str
        Its name in `EXTRAS`.
    module : str
        Another module of the extra, instead of that in `EXTRAS`.

    Raises
    ------
    InputError
        If the module cannot be imported; the message has the command that installs it.
    """
    about = EXTRAS[extra]
    name = module or about.module
    try:
        return importlib.import_module(name)
    except (ImportError, OSError, ValueError) as error:  # the last two without a library of its own
        if is_interrupt(error):
            raise KeyboardInterrupt from None
        missing = isinstance(error, ImportError) and error.name == name
        why = "" if missing else f" ({' '.join(str(error).split()):.200})"
        if "libGL" in why:  # the CAD kernel is installed, the system's OpenGL library is not
            cure = (
                "install the system's OpenGL library, on Debian and Ubuntu: apt-get install libgl1"
            )
        else:
            cure = f"install it: {about.command}"
        raise InputError(
            f"{about.purpose} need {name}, which cannot be loaded{why}; {cure}"
        ) from None
