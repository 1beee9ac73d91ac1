"""Measurements: readers of tables, registration, checks, public data sets, synthetic benches."""

from importlib import import_module
from typing import Any

from bowstring.data.measurements import Measurements, read_measurements, write_measurements
from bowstring.data.rigid import Rigid
from bowstring.data.tendon_check import TendonCheck, check_tendons
from bowstring.data.tip_errors import Comparison

__all__ = [
    "Comparison",
    "Measurements",
    "Rigid",
    "TendonCheck",
    "check_tendons",
    "read_measurements",
    "write_measurements",
]

_LAZY = {"datasets", "registration", "synthetic"}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module(f"{__name__}.{name}")
