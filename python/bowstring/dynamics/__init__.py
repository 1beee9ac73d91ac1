"""Dynamics of the rod: simulation, load histories, modal analysis, run files."""

from bowstring.dynamics.load_history import Table, ramp, step
from bowstring.dynamics.modal import Modes, modes
from bowstring.dynamics.motions import Motions, MotionsState
from bowstring.dynamics.simulation import NoStart, Run, RunInterrupted, simulate

__all__ = [
    "Modes",
    "Motions",
    "MotionsState",
    "NoStart",
    "Run",
    "RunInterrupted",
    "Table",
    "modes",
    "ramp",
    "simulate",
    "step",
]
