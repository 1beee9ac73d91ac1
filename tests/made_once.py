"""Objects that are made once in a test run, shared by several processes."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

_PATIENCE = 300.0  # s


def common_folder(factory: pytest.TempPathFactory) -> Path:
    """A folder of this run, common to all its processes."""
    own = factory.getbasetemp()
    return own.parent if "PYTEST_XDIST_WORKER" in os.environ else own


def made_once(place: Path, make: Callable[[Path], object]) -> Path:
    """Make a file or folder once, in the first process that needs it, under a temporary name.

    The other processes wait for it. If making it fails, the next one tries.

    """
    claim = place.with_name(f"{place.name}.claim")
    until = time.monotonic() + _PATIENCE
    while not place.exists():
        try:
            os.close(os.open(claim, os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            assert time.monotonic() < until, f"nobody has made {place} in {_PATIENCE:g} s"
            time.sleep(0.05)
            continue
        try:
            if not place.exists():
                part = place.with_name(f"{place.name}.part")
                make(part)
                os.rename(part, place)
        finally:
            claim.unlink()
    return place
