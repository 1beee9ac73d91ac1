"""Is constant curvature good enough for my cable-driven continuum robot?

Names are imported when first used: ``import bowstring as bs`` is quick.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if sys.version_info < (3, 10):  # noqa: UP036 - pip checks it, a folder on the path does not
    raise ImportError(
        "Bowstring needs Python 3.10 or newer, and this is "
        + sys.version.split()[0]
        + "; make an environment of a newer one: python3.12 -m venv .venv"
    )

if TYPE_CHECKING:
    from bowstring import (
        cad,
        calibration,
        constant_curvature,
        data,
        dynamics,
        errors,
        fem,
        inverse,
        robot,
        statics,
        study,
        uncertainty,
        validity,
        viz,
    )
    from bowstring._core import RodModel, __version__
    from bowstring.cad.solid import make_solid
    from bowstring.calibration.fitting import Fit, fit
    from bowstring.calibration.priors import Prior
    from bowstring.calibration.table_fit import Calibration, calibrate
    from bowstring.data.measurements import Measurements, read_measurements, write_measurements
    from bowstring.data.tendon_check import check_tendons
    from bowstring.dynamics.base_motion import BaseMotion
    from bowstring.dynamics.integrator import Integrator
    from bowstring.dynamics.linear import LinearModel, linearise
    from bowstring.dynamics.modal import Modes, modes
    from bowstring.dynamics.simulation import Output, Run, Start, simulate
    from bowstring.integrations.live import view
    from bowstring.inverse.compiled import compile_robot
    from bowstring.inverse.kinematics import inverse_kinematics
    from bowstring.inverse.limits import ActuationLimits
    from bowstring.inverse.solution import InverseSolution
    from bowstring.robot.model import Robot
    from bowstring.robot.reader import load_robot, robot_names, robot_schema
    from bowstring.statics.branches import (
        Branch,
        BranchDiagram,
        BranchEvent,
        BranchSearch,
        CriticalLoad,
        branch_diagram,
        critical_load,
    )
    from bowstring.statics.contact import ContactSolution, solve_contact, sweep_contact
    from bowstring.statics.derivatives import (
        DisplacementJacobian,
        Jacobians,
        displacement_jacobian,
        jacobians,
    )
    from bowstring.statics.differentiation import DirectionalDerivatives
    from bowstring.statics.directional_derivatives import (
        Derivatives,
        derivatives,
        directional_derivatives,
    )
    from bowstring.statics.load import Load, PointLoad
    from bowstring.statics.plane import Plane
    from bowstring.statics.rod import solve, solve_batch, sweep
    from bowstring.statics.solution import Solution, Sweep
    from bowstring.study.run import run_study
    from bowstring.study.settings import Extras, Ramp
    from bowstring.study.study import Study
    from bowstring.validity.chart import ValidityChart, validity_chart
    from bowstring.validity.control import ControlErrors, control_errors
    from bowstring.validity.loading import Loading
    from bowstring.validity.map_result import ValidityMap
    from bowstring.validity.maps import validity_map
    from bowstring.validity.multi_axis_maps import ValidityGrid, validity_grid
    from bowstring.validity.reach import Reach, reach
    from bowstring.validity.spread import Spread, validity_spread
    from bowstring.validity.workspace import WorkspaceMap, workspace_map

__all__ = [
    "ActuationLimits",
    "BaseMotion",
    "Branch",
    "BranchDiagram",
    "BranchEvent",
    "BranchSearch",
    "Calibration",
    "ContactSolution",
    "ControlErrors",
    "CriticalLoad",
    "Derivatives",
    "DirectionalDerivatives",
    "DisplacementJacobian",
    "Extras",
    "Fit",
    "Integrator",
    "InverseSolution",
    "Jacobians",
    "LinearModel",
    "Load",
    "Loading",
    "Measurements",
    "Modes",
    "Output",
    "Plane",
    "PointLoad",
    "Prior",
    "Ramp",
    "Reach",
    "Robot",
    "RodModel",
    "Run",
    "Solution",
    "Spread",
    "Start",
    "Study",
    "Sweep",
    "ValidityChart",
    "ValidityGrid",
    "ValidityMap",
    "WorkspaceMap",
    "__version__",
    "branch_diagram",
    "cad",
    "calibrate",
    "calibration",
    "check_tendons",
    "compile_robot",
    "constant_curvature",
    "control_errors",
    "critical_load",
    "data",
    "derivatives",
    "directional_derivatives",
    "displacement_jacobian",
    "dynamics",
    "errors",
    "fem",
    "fit",
    "inverse",
    "inverse_kinematics",
    "jacobians",
    "linearise",
    "load_robot",
    "make_solid",
    "modes",
    "reach",
    "read_measurements",
    "robot",
    "robot_names",
    "robot_schema",
    "run_study",
    "simulate",
    "solve",
    "solve_batch",
    "solve_contact",
    "statics",
    "study",
    "sweep",
    "sweep_contact",
    "uncertainty",
    "validity",
    "validity_chart",
    "validity_grid",
    "validity_map",
    "validity_spread",
    "view",
    "viz",
    "workspace_map",
    "write_measurements",
]

_HOME = {
    name: module
    for module, names in {
        "_core": "RodModel __version__",
        "cad.solid": "make_solid",
        "calibration.fitting": "Fit fit",
        "calibration.priors": "Prior",
        "calibration.table_fit": "Calibration calibrate",
        "data.measurements": "Measurements read_measurements write_measurements",
        "data.tendon_check": "check_tendons",
        "dynamics.base_motion": "BaseMotion",
        "dynamics.integrator": "Integrator",
        "dynamics.linear": "LinearModel linearise",
        "dynamics.modal": "Modes modes",
        "dynamics.simulation": "Output Run Start simulate",
        "inverse.compiled": "compile_robot",
        "inverse.kinematics": "inverse_kinematics",
        "inverse.limits": "ActuationLimits",
        "inverse.solution": "InverseSolution",
        "robot.model": "Robot",
        "robot.reader": "load_robot robot_names robot_schema",
        "statics.branches": (
            "Branch BranchDiagram BranchEvent BranchSearch CriticalLoad branch_diagram "
            "critical_load"
        ),
        "statics.contact": "ContactSolution solve_contact sweep_contact",
        "statics.derivatives": "DisplacementJacobian Jacobians displacement_jacobian jacobians",
        "statics.differentiation": "DirectionalDerivatives",
        "statics.directional_derivatives": "Derivatives derivatives directional_derivatives",
        "statics.load": "Load PointLoad",
        "statics.plane": "Plane",
        "statics.rod": "solve solve_batch sweep",
        "statics.solution": "Solution Sweep",
        "study.settings": "Extras Ramp",
        "study.run": "run_study",
        "study.study": "Study",
        "validity.chart": "ValidityChart validity_chart",
        "validity.control": "ControlErrors control_errors",
        "validity.multi_axis_maps": "ValidityGrid validity_grid",
        "validity.loading": "Loading",
        "validity.map_result": "ValidityMap",
        "validity.maps": "validity_map",
        "validity.reach": "Reach reach",
        "validity.spread": "Spread validity_spread",
        "validity.workspace": "WorkspaceMap workspace_map",
        "integrations.live": "view",
    }.items()
    for name in names.split()
}
"""Module of each public name that is not itself a module."""


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name not in _HOME:
        return import_module(f"{__name__}.{name}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
