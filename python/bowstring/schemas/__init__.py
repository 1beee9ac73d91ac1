"""Schemas of the JSON that commands print with ``--json``.

Results declare their keys themselves (`bowstring.results`). What a command adds to them, and
objects whose keys depend on the data, are typed dictionaries: key, type, meaning, and unit where
the key does not end in it. Tests hold to both what is printed, and ``docs/reference/json.md`` is
made from them. No command imports this package.
"""

from __future__ import annotations

from typing import Any, Final

from bowstring.schemas import (
    bench,
    branches,
    compiled,
    control,
    dynamics,
    fit,
    inverse,
    maps,
    program,
    solids,
    statics,
    study,
    suite,
)
from bowstring.schemas.results import object_of

_FORMS: Final[dict[str, Any]] = {
    "robots": program.Robots,
    "doctor": program.Doctor,
    "fk": statics.Fk,
    "ik": inverse.Ik,
    "ik --path": inverse.IkPath,
    "ik --residual": inverse.IkResidual,
    "control": control.Control,
    "reach": control.ReachFound,
    "reach --errors": maps.Workspace,
    "solve": statics.Solve,
    "branches": branches.Branches,
    "simulate": dynamics.Simulate,
    "modes": dynamics.Modes,
    "study": study.Study,
    "suite": suite.Suite,
    "map": maps.Map,
    "map --over --over --over": maps.Grid,
    "map --store": maps.StoredMap,
    "uncertainty": maps.Uncertainty,
    "bench check": bench.BenchCheck,
    "bench simulate": bench.BenchSimulate,
    "fit": fit.Fit,
    "fit --compare, stopped": fit.StoppedComparison,
    "fit --measurements, angles only": fit.FitOfAngles,
    "export --out .step": solids.Cad,
    "export --out .xml": program.Export,
    "export --out .json": compiled.Compiled,
    "fe": solids.Fe,
    "data list": program.DataSets,
    "data get": program.DataFolder,
}

#: The object that each command prints; that of `schema` is a JSON Schema itself.
COMMANDS: Final[dict[str, Any]] = {name: object_of(form) for name, form in _FORMS.items()}
