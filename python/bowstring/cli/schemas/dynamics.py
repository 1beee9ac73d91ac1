"""JSON of the commands simulate and modes."""

from __future__ import annotations

from typing import Annotated, Literal

from bowstring.cli.schemas.basic import InFolder, OfRobot, Vector
from bowstring.cli.schemas.results import beside
from bowstring.dynamics import modal
from bowstring.dynamics.simulation import Status
from bowstring.results import Object, OrNull, about


class TimeStepError(Object):
    """Estimated error of the time steps."""

    tip_m: Annotated[OrNull, about("Largest estimated error of the position of the tip.")]


class RunFiles(Object):
    """Files of a simulation."""

    run: Annotated[
        str | None,
        about(
            "NetCDF or CSV file; `null` without `--out` of it, without an initial "
            "equilibrium, and, for CSV, after an interrupt."
        ),
    ]
    vtk: Annotated[
        str | None,
        about(
            "Folder of the VTK series; `null` without `--vtk`, without an initial equilibrium and "
            "after an interrupt."
        ),
    ]
    animation: Annotated[
        str | None,
        about(
            "Animation; `null` without `--out` of it, without an initial equilibrium, after an "
            "interrupt, and for a run without a time step."
        ),
    ]
    glb: Annotated[
        str | None,
        about(
            "Binary glTF; `null` without `--out` of it, without an initial equilibrium and after "
            "an interrupt."
        ),
    ]
    rerun: Annotated[
        str | None,
        about(
            "Recording for Rerun; `null` without `--out` of it, without an initial equilibrium and "
            "after an interrupt."
        ),
    ]


class Simulate(OfRobot):
    """Output of `bowstring simulate`."""

    status: Annotated[
        Status | Literal["no_equilibrium"],
        about(
            "`converged`: every step converged, up to the end. `step_failed`, `collision`: the run "
            "stopped early, in a collision because two disks met. `no_equilibrium`: "
            "there is no stable equilibrium to start from. `interrupted`: by Ctrl-C or SIGTERM. "
            "`failed`: from Python only, a function of time gave no number."
        ),
    ]
    message: Annotated[str, about("Status as a sentence.")]
    t_s: Annotated[
        list[float],
        about(
            "Times: every 0.01 s from 0 to the end, both included, or every `--every` if that is "
            "longer. Empty without an equilibrium to start from."
        ),
    ]
    tip_position_m: Annotated[
        list[Vector],
        about("Position of the tip at these times; interpolated between the ends of time steps."),
    ]
    steps: Annotated[int, about("Number of time steps.")]
    error_estimate: Annotated[TimeStepError, about("Estimated error of the time steps.")]
    real_time_factor: Annotated[
        OrNull, about("Simulated time over computing time, without writing files.")
    ]
    files: Annotated[RunFiles, about("Files that were written.")]


@beside(modal.Modes)
class Modes(OfRobot, InFolder):
    """Output of `bowstring modes`."""

    tensions_N: Annotated[
        list[OrNull] | None,
        about("Tensions of the equilibrium; without one, those given, `null` where none is."),
    ]
