"""Schemas of the JSON that commands print with ``--json``.

Results declare their keys themselves (`bowstring.results`). What a command adds to them, and
objects whose keys depend on the data, are typed dictionaries: key, type, meaning, and unit where
the key does not end in it. Tests hold to both what is printed, and ``docs/reference/json.md`` is
made from them. Commands import it for type checks alone.
"""

from __future__ import annotations

from typing import Any, Final

from bowstring.cli.schemas import (
    additions,
    bench,
    compiled,
    dynamics,
    inverse,
    program,
    solids,
    statics,
    study,
)
from bowstring.cli.schemas.results import object_of

_FORMS: Final[dict[str, Any]] = {
    "robots": program.Robots,
    "doctor": program.Doctor,
    "fk": statics.Fk,
    "ik": inverse.Ik,
    "ik --path": inverse.IkPath,
    "ik --residual": inverse.IkResidual,
    "control": additions.Control,
    "reach": additions.ReachFound,
    "reach --errors": additions.Workspace,
    "solve": statics.Solve,
    "branches": additions.Branches,
    "simulate": dynamics.Simulate,
    "modes": dynamics.Modes,
    "study": study.Study,
    "suite": additions.Suite,
    "map": additions.Map,
    "map --over --over --over": additions.Grid,
    "map --store": additions.StoredMap,
    "uncertainty": additions.Uncertainty,
    "bench check": bench.BenchCheck,
    "bench simulate": bench.BenchSimulate,
    "fit": additions.Fit,
    "fit --compare, stopped": additions.StoppedComparison,
    "fit --measurements, angles only": additions.FitOfAngles,
    "export --out .step": solids.Cad,
    "export --out .xml": program.Export,
    "export --out .json": compiled.Compiled,
    "fe": solids.Fe,
    "data list": program.DataSets,
    "data get": program.DataFolder,
}

#: The object that each command prints; that of `schema` is a JSON Schema itself.
COMMANDS: Final[dict[str, Any]] = {name: object_of(form) for name, form in _FORMS.items()}
