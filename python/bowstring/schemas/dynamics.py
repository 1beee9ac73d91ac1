"""JSON of the commands simulate and modes."""

from __future__ import annotations

from typing import Annotated

from bowstring.schemas.basic import InFolder, Object, OfRobot, OrNull, Pose, Vector, about


class TimeStepError(Object):
    """Estimated error of the time steps."""

    tip_m: Annotated[OrNull, about("Largest estimated error of the position of the tip.")]


class RunFiles(Object):
    """Files of a simulation."""

    run: Annotated[str | None, about("NetCDF file; `null` without `--out`.")]
    vtk: Annotated[str | None, about("Folder of the VTK series; `null` without `--vtk`.")]
    animation: Annotated[str | None, about("Animation; `null` without `--animation`.")]


class Simulate(OfRobot):
    """Output of `bowstring simulate`."""

    status: Annotated[
        str,
        about(
            "`converged`: every step converged, up to the end. `step_failed`, `collision`: the run "
            "stopped early, in a collision because two disks met. `no_equilibrium` or another "
            "status of `solve`: there is no equilibrium to start from. `interrupted`: by Ctrl-C or "
            "SIGTERM."
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


class Mode(Object):
    """A natural mode of small oscillation."""

    frequency_hz: Annotated[float, about("Natural frequency.")]
    kind: Annotated[str, about("`bending`, `torsion` or `axial`.")]
    displacement: Annotated[
        list[Vector], about("Displacement of each disk in base axes; the largest is 1.")
    ]
    rotation: Annotated[
        list[Vector],
        about("Small rotation vector of each disk in its own axes.", "rad/m of displacement"),
    ]


class EquilibriumModes(Object):
    """Result of `Modes.to_dict`."""

    status: Annotated[
        str,
        about(
            "`converged`; without a stable equilibrium `no_equilibrium` or another status of "
            "`solve`, and there are no modes."
        ),
    ]
    tensions_N: Annotated[
        list[OrNull] | None,
        about("Tensions of the equilibrium; without one, those given, `null` where none is."),
    ]
    modes: Annotated[list[Mode], about("Modes, slowest first.")]
    disks: Annotated[list[Pose], about("Disks of the equilibrium from base to tip.")]


class Modes(EquilibriumModes, OfRobot, InFolder):
    """Output of `bowstring modes`."""
