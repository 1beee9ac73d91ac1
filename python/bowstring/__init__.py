"""Is constant curvature good enough for my cable-driven continuum robot?

Names are imported when first used: ``import bowstring as bs`` is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bowstring import (
        cad,
        calibration,
        constant_curvature,
        data,
        dynamics,
        errors,
        fem,
        robot,
        statics,
        study,
        viz,
    )
    from bowstring._core import RodModel, __version__
    from bowstring.cad.solid import make_solid
    from bowstring.calibration.fitting import Fit, fit
    from bowstring.calibration.table_fit import Calibration, calibrate
    from bowstring.data.measurements import Measurements, read_measurements, write_measurements
    from bowstring.data.tendon_check import check_tendons
    from bowstring.dynamics.integrator import Integrator
    from bowstring.dynamics.modal import Modes, modes
    from bowstring.dynamics.simulation import Output, Run, Start, simulate
    from bowstring.robot.model import Robot
    from bowstring.robot.reader import load_robot, robot_names, robot_schema
    from bowstring.statics.derivatives import (
        DisplacementJacobian,
        Jacobians,
        displacement_jacobian,
        jacobians,
    )
    from bowstring.statics.load import Load
    from bowstring.statics.rod import solve, solve_batch, sweep
    from bowstring.statics.solution import Solution, Sweep
    from bowstring.study.settings import Extras, Loading, Ramp
    from bowstring.study.study import Study, run_study

__all__ = [
    "Calibration",
    "DisplacementJacobian",
    "Extras",
    "Fit",
    "Integrator",
    "Jacobians",
    "Load",
    "Loading",
    "Measurements",
    "Modes",
    "Output",
    "Ramp",
    "Robot",
    "RodModel",
    "Run",
    "Solution",
    "Start",
    "Study",
    "Sweep",
    "__version__",
    "cad",
    "calibrate",
    "calibration",
    "check_tendons",
    "constant_curvature",
    "data",
    "displacement_jacobian",
    "dynamics",
    "errors",
    "fem",
    "fit",
    "jacobians",
    "load_robot",
    "make_solid",
    "modes",
    "read_measurements",
    "robot",
    "robot_names",
    "robot_schema",
    "run_study",
    "simulate",
    "solve",
    "solve_batch",
    "statics",
    "study",
    "sweep",
    "viz",
    "write_measurements",
]

_HOME = {
    "__version__": "_core",
    "Fit": "calibration.fitting",
    "fit": "calibration.fitting",
    "Calibration": "calibration.table_fit",
    "calibrate": "calibration.table_fit",
    "make_solid": "cad.solid",
    "Measurements": "data.measurements",
    "read_measurements": "data.measurements",
    "write_measurements": "data.measurements",
    "check_tendons": "data.tendon_check",
    "Modes": "dynamics.modal",
    "modes": "dynamics.modal",
    "Integrator": "dynamics.integrator",
    "Output": "dynamics.simulation",
    "Run": "dynamics.simulation",
    "Start": "dynamics.simulation",
    "simulate": "dynamics.simulation",
    "Robot": "robot.model",
    "load_robot": "robot.reader",
    "robot_names": "robot.reader",
    "robot_schema": "robot.reader",
    "RodModel": "_core",
    "DisplacementJacobian": "statics.derivatives",
    "Jacobians": "statics.derivatives",
    "displacement_jacobian": "statics.derivatives",
    "jacobians": "statics.derivatives",
    "Load": "statics.load",
    "solve": "statics.rod",
    "solve_batch": "statics.rod",
    "sweep": "statics.rod",
    "Solution": "statics.solution",
    "Sweep": "statics.solution",
    "Extras": "study.settings",
    "Loading": "study.settings",
    "Ramp": "study.settings",
    "Study": "study.study",
    "run_study": "study.study",
}
_PACKAGES = {
    "cad",
    "calibration",
    "constant_curvature",
    "data",
    "dynamics",
    "errors",
    "fem",
    "robot",
    "statics",
    "study",
    "viz",
}


def __getattr__(name: str) -> Any:
    if name in _PACKAGES:
        return import_module(f"{__name__}.{name}")
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
