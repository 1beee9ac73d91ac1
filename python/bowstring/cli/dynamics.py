"""Commands of dynamics: simulate, modes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from bowstring._core import RodModel
from bowstring.cli import completion
from bowstring.cli.actuation import (
    SHORTEST_STEP,
    Actuation,
    Motion,
    OverTime,
    acting,
    at_rest,
    read_history,
)
from bowstring.cli.flags import Number, Share, of_flag
from bowstring.cli.groups import Flag, Group, option
from bowstring.cli.options import (
    AsJson,
    DeadForces,
    Elements,
    HistoryFile,
    Loads,
    RobotArgument,
    Rod,
    Theory,
    out_folder,
    settings_of,
)
from bowstring.cli.output import (
    Stopped,
    counted,
    fixed,
    new_table,
    progress_bar,
    provenance_of,
    rod_model,
    warn,
    write_json,
    write_tables,
)
from bowstring.errors import InputError, NoSolutionError
from bowstring.formatting import listed, plain
from bowstring.interrupts import is_interrupt
from bowstring.units import rounded

if TYPE_CHECKING:
    from rich.table import Table

    from bowstring.aliases import Progress
    from bowstring.cli.schemas import dynamics as schema
    from bowstring.dynamics.base_motion import BaseMotion
    from bowstring.dynamics.integrator import Integrator
    from bowstring.dynamics.simulation import Run
    from bowstring.robot.model import Robot
    from bowstring.statics.load import Load

TIP_INTERVAL: Final = 0.01  # s between tips in the JSON of simulate, at least
MOST_OUTPUTS: Final = 1_000_000


def _loads_in_motion(
    actuation: OverTime,
    loads: Loads,
    base_motion: Annotated[
        Path | None,
        option(
            "FILE",
            "CSV of poses of the base over time, columns t_s, position_x_mm, ..., rotation_x_deg, "
            "... (rotation vector); position or rotation may be left out.",
        ),
    ] = None,
) -> Load:
    """Make all loads over time."""
    base = None if base_motion is None else _base_motion(base_motion, actuation.duration)
    return acting(actuation.load, loads).replace(base=base)


class _TimeStep(Number):
    def read(self, flag: str, text: str, robot: Robot) -> float:
        value = super().read(flag, text, robot)
        if value < SHORTEST_STEP:
            raise InputError(
                f"{flag}: got {value:g} s; must be {SHORTEST_STEP:g} s or more, shorter steps are "
                "below numerical resolution."
            )
        return value


def _integrator(
    load: Load,
    mass_damping: Annotated[
        float,
        Number(
            "1/s",
            "0.5",
            "Mass-proportional damping: force per mass and velocity.",
            default="0",
            must_be="0 or more",
        ),
    ],
    material_damping: Annotated[
        float,
        Number(
            "s",
            '"1 ms"',
            "Kelvin-Voigt damping of the backbone: its time constant.",
            default="0",
            must_be="0 or more",
        ),
    ],
    modal_damping: Annotated[
        float | None,
        Share(
            "a share of critical damping from 0 to 1",
            lambda value: 0 <= value <= 1,
            '"1 %"',
            'Damping ratio of the slowest modes, 0.01 or "1 %"; in place of the two above.',
            form="RATIO",
        ),
    ],
    dt: Annotated[
        float | None,
        _TimeStep("s", '"1 ms"', "Fixed time step.  [default: adaptive steps]", must_be="positive"),
    ],
    tolerance: Annotated[
        str | None,
        Flag(
            "m",
            "Tolerated error of one adaptive step, in m or with a unit, or a share of the length: "
            '"1 um" or "1e-4 %".  [default: 2e-6 of the length]',
        ),
    ],
    spectral_radius: Annotated[
        float, option("0...1", "Spectral radius at infinity: 1 no numerical damping, 0 most.")
    ] = 0.8,
) -> Integrator:
    from bowstring.dynamics.integrator import Integrator

    if modal_damping is not None and (mass_damping or material_damping):
        raise InputError(
            "--modal-damping is instead of --mass-damping and --material-damping; give either."
        )
    moments = {
        "--tip-moment": [load.tip_moment],
        "--disk-moment": load.disk_moments or [],
        "--follower-force": [each.force for each in load.point_loads or () if each.follower],
    }
    for flag, vectors in moments.items():
        if modal_damping is not None and any(map(any, vectors)):
            raise InputError(
                f"--modal-damping needs the modes, and under {flag} there are none; give "
                "--mass-damping and --material-damping instead."
            )
    if dt is not None and tolerance is not None:
        raise InputError("--tolerance is for steps that adapt and --dt fixes them; give either.")
    if not 0 <= spectral_radius <= 1:
        raise InputError(f"--spectral-radius: got {spectral_radius:g}; must be from 0 to 1.")
    return Integrator(dt, tolerance, spectral_radius, mass_damping, material_damping, modal_damping)


def _rod_in_motion(theory: Theory = "cosserat", elements: Elements = None) -> RodModel:
    return RodModel(theory, elements=elements)


def _interval(
    robot: Robot,
    actuation: OverTime,
    every: Annotated[str, option("s", "Time between outputs.")] = "0.01",
) -> float:
    interval = _TimeStep("s", '"10 ms"', "", must_be="positive").read("--every", every, robot)
    outputs = actuation.duration / interval
    if outputs > MOST_OUTPUTS:
        raise InputError(
            f"--every: {every} gives {outputs:.3g} outputs; up to {MOST_OUTPUTS} are possible."
        )
    return interval


_Load = Annotated["Load", Group("Loads", _loads_in_motion)]
_Rod = Annotated[RodModel, Group("Rod", _rod_in_motion)]
_Integrator = Annotated["Integrator", Group("Time integration", _integrator)]
_Interval = Annotated[float, Group("Outputs", _interval)]


#: Files of a run, in the order in which messages name them.
_CALLED: Final = {
    "run": "run",
    "vtk": "VTK series",
    "animation": "animation",
    "glb": "glTF file",
    "rerun": "Rerun recording",
}
#: What a file of a run is, by its ending.
_KINDS: Final = {
    ".nc": "run",
    ".csv": "run",
    ".gif": "animation",
    ".mp4": "animation",
    ".glb": "glb",
    ".rrd": "rerun",
}


def _by_kind(files: Sequence[Path]) -> dict[str, Path]:
    """Output files by kind, at most one of each."""
    found: dict[str, Path] = {}
    for file in files:
        kind = _KINDS.get(file.suffix.lower())
        if kind is None:
            raise InputError(
                f"--out: got {file}; end it in .nc (all fields), .csv (tip and tendons), .gif or "
                ".mp4 (animation), .glb (moving solid) or .rrd (Rerun)."
            )
        if kind in found:
            raise InputError(f"--out: {found[kind]} and {file} are of the same kind; give either.")
        found[kind] = file
    return found


class _Targets:
    """Output files of a run, each checked before the work begins."""

    def __init__(
        self,
        robot: Robot,
        actuation: OverTime,
        out: Annotated[
            list[Path] | None,
            option(
                "FILE",
                "By its ending all fields (.nc), tip and tendons over time (.csv), an animation "
                "(.gif, .mp4), a moving solid for browsers and Blender (.glb) or a recording for "
                "Rerun (.rrd). Repeatable.",
                values=completion.formats(*_KINDS),
            ),
        ] = None,
        vtk: Annotated[Path | None, option("DIR", "Folder of a VTK series for ParaView.")] = None,
    ) -> None:
        wanted = _by_kind(out or [])
        run = wanted.pop("run", None)
        #: Whether anything but the run itself and its table is written.
        self.pictures = bool(wanted or vtk)
        #: The run as it goes on, or its table, which is written at its end.
        self.out: Path | None = None
        self.table: Path | None = None
        #: Places of the wanted files by kind, and what exists of them so far.
        self.places: dict[str, Path] = {}
        self.files: dict[str, Path | None] = dict.fromkeys(_CALLED)
        if run is not None and run.suffix.lower() == ".csv":
            from bowstring.dynamics.run_table import check_table

            self.places["run"] = self.table = of_flag("--out", check_table, run)
        elif run is not None:
            from bowstring.dynamics.run_file import check_file

            self.places["run"] = self.out = of_flag("--out", check_file, run)
        if vtk is not None:
            from bowstring.viz.vtk import check_folder, check_surface

            check_surface(robot)
            self.places["vtk"] = of_flag("--vtk", check_folder, vtk)
        if "animation" in wanted:
            from bowstring.viz.animation import check_length, check_picture

            self.places["animation"] = of_flag("--out", check_picture, wanted["animation"])
            of_flag("--out", check_length, actuation.duration)
        if "glb" in wanted:
            from bowstring.integrations.gltf import check_glb, check_solid

            check_solid(robot)
            self.places["glb"] = of_flag("--out", check_glb, wanted["glb"])
        if "rerun" in wanted:
            from bowstring.integrations.rerun import check_rerun
            from bowstring.optional import load_extra

            self.places["rerun"] = of_flag("--out", check_rerun, wanted["rerun"])
            load_extra("rerun")
        series = self.places.get("vtk")
        for file in self.places.values():
            if series is None or file is series:
                continue
            if file == series or file in series.parents:
                raise InputError(
                    f"--out: {file} cannot be a file, --vtk needs a folder there; name another "
                    "place."
                )
            if series in file.parents:
                raise InputError(
                    f"--out: {file} lies in the folder of --vtk, which is for the series alone; "
                    "name another place."
                )

    def write(self, run: Run, notify: Progress = lambda what, done: None) -> dict[str, Path | None]:
        """Write the remaining files, unless the user stopped the run; return existing ones."""
        files, places = self.files, self.places
        files["run"] = run.path
        if run.status == "interrupted" or len(run.time) == 0:
            return files
        if not (self.pictures or self.table):
            return files
        share = 0.5 if {"vtk", "animation"} <= places.keys() else 1.0  # of the progress, each
        data = run.to_dataset()
        if self.table is not None:
            from bowstring.dynamics.run_table import write_table

            files["run"] = write_table(data, self.table)
        if "glb" in places:
            from bowstring.integrations.gltf import write_glb

            files["glb"] = write_glb(run.robot, data, places["glb"])
        if "rerun" in places:
            from bowstring.integrations.rerun import write_rerun

            files["rerun"] = write_rerun(run.robot, data, places["rerun"])
        if "vtk" in places:
            from bowstring.viz.vtk import write_vtk

            files["vtk"] = write_vtk(
                run.robot,
                data,
                places["vtk"],
                progress=lambda what, done: notify(what, share * done),
            )
        if "animation" in places and len(run.time) > 1:
            from bowstring.viz.animation import animate

            files["animation"] = animate(
                run.robot,
                data,
                places["animation"],
                progress=lambda what, done: notify(what, 1 - share + share * done),
            )
        return files

    def state(self, run: Run) -> tuple[str, str]:
        """Say which of the wanted files are written and which are not, each "" if none is."""
        there = {**self.files, "run": run.path or self.files["run"]}
        kept, missing = (
            [
                str(place) if kind == "run" else f"the {_CALLED[kind]}"
                for kind, place in self.places.items()
                if bool(there[kind]) is exists
            ]
            for exists in (True, False)
        )
        written = f"{listed(kept)} {'is' if len(kept) == 1 else 'are'} written" if kept else ""
        left = f"{listed(missing)} {'is' if len(missing) == 1 else 'are'} not" if missing else ""
        return written, f"{left}{'' if kept else ' written'}" if left else ""


def simulate(
    robot: RobotArgument,
    actuation: Motion,
    load: _Load,
    rod: _Rod,
    integrator: _Integrator,
    every: _Interval,
    targets: Annotated[_Targets, Group("Outputs", _Targets)],
    history: HistoryFile = None,
    as_json: AsJson = False,
) -> None:
    """Dynamics: the motion under tensions and displacements over time, from equilibrium."""
    path = None if history is None else read_history(history)

    from bowstring.dynamics import simulation

    duration = actuation.duration
    points = simulation.DEFAULT_POINTS
    if not (targets.out or targets.pictures):  # no output needs fields of the backbone
        points = 2 if targets.table else 0
    share = 0.1 if targets.pictures else 1.0  # of the progress
    run: Run | None = None
    files: dict[str, Path | None] | None = None
    try:
        with progress_bar("motion") as notify:
            try:
                run = simulation.simulate(
                    robot,
                    duration=duration,
                    load=load,
                    start=simulation.Start(actuation.start, history=path),
                    model=rod,
                    integrator=integrator,
                    output=simulation.Output(
                        every, points, targets.out, lambda done: notify("motion", share * done)
                    ),
                )
            except simulation.RunInterrupted as stopped:
                run = stopped.run
            except simulation.NoStart as error:
                if as_json:
                    content = _run_json(error.run, every, targets.write(error.run))
                    content["status"], content["message"] = "no_equilibrium", str(error)
                    write_json(content)
                raise
            try:
                files = targets.write(
                    run, lambda what, done: notify(what, share + (1 - share) * done)
                )
            except ImportError as error:
                if not is_interrupt(error):
                    raise
                raise KeyboardInterrupt from None
            except InputError as error:  # such as a full drive
                kept, left = targets.state(run)
                raise InputError(f"{error}; {kept}, {left}") if kept else error from None
        if as_json:
            write_json(_run_json(run, every, files))
        else:
            warn(*run.exceeded)
            write_tables(*_run_tables(run, files))
    except KeyboardInterrupt:
        if run is None:
            raise
        if files is not None:
            kept, _ = targets.state(run)
            raise Stopped(
                f"the result is not printed whole; {kept or 'nothing is kept'}."
            ) from None
        done = "was stopped" if run.status == "interrupted" else "was complete"
        state = ", ".join(filter(None, targets.state(run))) or "nothing is kept"
        raise Stopped(f"the motion {done}; {state}.") from None
    if run.status == "interrupted":
        kept = f"; {files['run']} holds the run up to there" if files["run"] else ""
        raise Stopped(f"at {run.end:.6g} s of {duration:g} s{kept}.")
    run.raise_for_status()


def _base_motion(file: Path, duration: float) -> BaseMotion:
    from bowstring.dynamics.load_table import read_base_motion

    base: BaseMotion = of_flag("--base-motion", read_base_motion, file)
    if duration > base.duration * (1.0 + 1e-9):
        raise InputError(
            f"--base-motion: {file} ends at {base.duration:g} s and the run lasts {duration:g} s; "
            "give poses up to its end."
        )
    return base


def modes(
    robot: RobotArgument,
    actuation: Actuation,
    loads: DeadForces,
    rod: Rod,
    count: Annotated[int, option("N", "Number of modes, slowest first.")] = 6,
    history: HistoryFile = None,
    out: Annotated[Path | None, option("DIR", "Folder for pictures of the mode shapes.")] = None,
    as_json: AsJson = False,
) -> None:
    """Natural frequencies and mode shapes about an equilibrium.

    Without actuation it is that of zero tension.

    Tensions, displacements and angles keep their values while the robot oscillates.
    """
    load = at_rest(robot, actuation, loads)
    path = None if history is None else read_history(history)
    if not 1 <= count <= 1000:
        raise InputError(f"--count: got {count}; must be from 1 to 1000.")

    from bowstring.dynamics import modal

    out = out_folder(out, "modes")
    given = {
        "displacements_m": load.displacements,
        "angles_rad": load.angles,
        "history": history,
    }
    provenance = provenance_of(
        robot,
        count=count,
        **settings_of(load, rod, "tip_moment_Nm", "disk_moments_Nm"),
        **{name: value for name, value in given.items() if value is not None},
    )
    try:
        with progress_bar("modes"):
            found = modal.modes(robot, load=load, model=rod, history=path, count=count)
    except NoSolutionError as error:
        if as_json:
            none: dict[str, Any] = {"modes": [], "disks": [], **provenance, "folder": None}
            write_json({"status": error.status, "tensions_N": plain(load.tensions), **none})
        raise
    from bowstring.statics.limits import buckled_or_stretched

    exceeded = buckled_or_stretched(robot, found.tensions, rod)
    content: dict[str, Any] = {**found.to_dict(), **provenance}
    content["warnings"] = [*robot.warnings, *exceeded]
    folder = None
    if out is not None:
        with progress_bar("pictures") as notify:
            from bowstring.viz.modes_folder import write_modes

            folder = str(write_modes(found, plain(content), out, progress=notify))
    content["folder"] = folder
    if as_json:
        return write_json(content)
    warn(*exceeded)
    found_modes = new_table(">mode", ">frequency Hz", "kind")
    for i, (frequency, kind) in enumerate(zip(found.frequency_hz, found.kind, strict=True), 1):
        found_modes.add_row(str(i), f"{frequency:.5g}", kind)
    write_tables(
        f"{robot.name}, {rod_model(rod.theory)}: {counted(len(found), 'mode')} about the "
        "equilibrium",
        found_modes,
        *([f"Pictures: {folder}"] if folder else []),
    )


def _run_json(run: Run, every: float, files: Mapping[str, Path | None]) -> schema.Simulate:
    import numpy as np

    interval = max(TIP_INTERVAL, every)
    count = int(run.end / interval + 1e-9)
    times = np.round(np.arange(count + 1) * interval, 12)
    if run.end - times[-1] > 1e-9 * run.end:
        times = np.append(times, run.end)
    else:
        times[-1] = run.end
    moved = len(run.time) > 0
    return {
        "status": run.status,
        "t_s": times.tolist() if moved else [],
        "tip_position_m": run.tip_at(times).tolist() if moved else [],
        "steps": run.steps,
        "error_estimate": {"tip_m": run.error_estimate},
        "real_time_factor": run.real_time_factor if moved else None,
        "message": run.message,
        "files": plain(files),
        **provenance_of(run.robot, **run.settings),
        "warnings": [*run.robot.warnings, *run.warnings, *run.exceeded],
    }


def _run_tables(run: Run, files: dict[str, Path | None]) -> Iterator[Table | str]:
    import numpy as np

    yield (
        f"{run.robot.name}, {rod_model(run.settings['theory'])}: {run.status}, {run.end:.6g} s in "
        f"{counted(run.steps, 'step')}, computed about {rounded(run.real_time_factor)} times as "
        "fast as real time"
    )
    if run.converged and run.error_text:
        yield f"{run.error_text[0].upper()}{run.error_text[1:]}."
    if len(run.time) == 0:
        return
    table = new_table("", ">time s", ">tip x mm", ">y mm", ">z mm")
    moved = np.linalg.norm(run.tip_position - run.tip_position[:1], axis=1)
    moments = [("start", 0), ("farthest from the start", int(moved.argmax())), ("end", -1)]
    for name, i in moments:
        table.add_row(
            name, f"{run.time[i]:.6g}", *(fixed(1e3 * value, 3) for value in run.tip_position[i])
        )
    yield table
    labels = {kind: name.capitalize() if name.islower() else name for kind, name in _CALLED.items()}
    lines = [f"{labels[kind]}: {file}" for kind, file in files.items() if file is not None]
    if lines:
        yield "\n".join(lines)
