"""Measurements: readers of tables, frames, checks, public data sets, synthetic benches."""

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
