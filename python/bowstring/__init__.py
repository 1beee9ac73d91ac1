"""Is constant curvature good enough for my cable-driven continuum robot?

Names are imported when first used: ``import bowstring as bs`` is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bowstring import (
        arc,
        bench,
        calibration,
        datasets,
        dynamics,
        errors,
        fit,
        measurements,
        registration,
        shape,
        study,
    )
    from bowstring._core import __version__
    from bowstring.dynamics import Run, simulate
    from bowstring.oscillations import Modes, modes
    from bowstring.robot import Robot, load_robot, robot_names, robot_schema
    from bowstring.rod import (
        Jacobians,
        PullJacobian,
        Solution,
        Sweep,
        jacobians,
        pull_jacobian,
        solve,
        solve_batch,
        sweep,
    )
    from bowstring.solid import make_solid

__all__ = [
    "Jacobians",
    "Modes",
    "PullJacobian",
    "Robot",
    "Run",
    "Solution",
    "Sweep",
    "__version__",
    "arc",
    "bench",
    "calibration",
    "datasets",
    "dynamics",
    "errors",
    "fit",
    "jacobians",
    "load_robot",
    "make_solid",
    "measurements",
    "modes",
    "pull_jacobian",
    "registration",
    "robot_names",
    "robot_schema",
    "shape",
    "simulate",
    "solve",
    "solve_batch",
    "study",
    "sweep",
]

_HOME = {
    "__version__": "_core",
    "Run": "dynamics",
    "simulate": "dynamics",
    "Modes": "oscillations",
    "modes": "oscillations",
    "Robot": "robot",
    "load_robot": "robot",
    "robot_names": "robot",
    "robot_schema": "robot",
    "Jacobians": "rod",
    "PullJacobian": "rod",
    "Solution": "rod",
    "Sweep": "rod",
    "jacobians": "rod",
    "pull_jacobian": "rod",
    "solve": "rod",
    "solve_batch": "rod",
    "sweep": "rod",
    "make_solid": "solid",
}
_MODULES = {
    "arc",
    "bench",
    "calibration",
    "datasets",
    "dynamics",
    "errors",
    "fit",
    "measurements",
    "registration",
    "shape",
    "study",
}


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f"{__name__}.{name}")
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
