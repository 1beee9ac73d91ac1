"""Motion of a run as a recording for the viewer Rerun, beside other data of the user."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from bowstring.aliases import Progress
from bowstring.files.atomic_io import check_file, write_whole_file
from bowstring.optional import load_extra
from bowstring.robot.model import Robot
from bowstring.viz.colours import rgb
from bowstring.viz.vtk import check_data, holes

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["check_rerun", "write_rerun"]

_WHAT: Final = "Rerun recording"
_MARK: Final = b"bowstring"
_HUES: Final = ("red", "green", "purple", "amber")


def check_rerun(path: str | Path) -> Path:
    """Check before any work that a recording may be written to a ``.rrd`` file; return its path."""
    return check_file(Path(path), _WHAT, (".rrd",), _MARK)


def write_rerun(
    robot: Robot,
    data: xr.Dataset,
    path: str | Path,
    *,
    progress: Progress | None = None,
) -> Path:
    """Write a run as a recording for Rerun, whole or not at all; needs the extra ``rerun``.

    Parameters
    ----------
    robot : Robot
        Robot of the run.
    data : xarray.Dataset
        Run from `Run.to_dataset` or `bowstring.dynamics.run_file.read_run`.
    path : str or Path
        Ends in ``.rrd``; a former file of Bowstring is replaced, no other.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    Path
        The file, absolute. On the timeline ``time`` it has ``robot/backbone``, ``robot/disks`` and
        ``robot/tendons`` in m, z up in the base frame, and ``tip_m/x`` and so on; labelled as
        simulated.

    Raises
    ------
    InputError
        If rerun-sdk is missing, the file cannot be written, or the data are of another robot.
    """
    notify = progress or (lambda what, share: None)
    file = check_rerun(path)
    check_data(robot, data)
    rerun = load_extra("rerun")

    def fill(new: Path) -> None:
        # Rerun writes by another thread, and only under names that end in .rrd
        own = new.with_name(new.name + ".rrd")
        try:
            _record(rerun, robot, data, own, notify)
            own.replace(new)
        finally:
            own.unlink(missing_ok=True)

    write_whole_file(file, _WHAT, fill, lambda: check_rerun(file))
    return file


def _record(rerun: Any, robot: Robot, data: xr.Dataset, file: Path, notify: Progress) -> None:
    recording = rerun.RecordingStream("bowstring", send_properties=True)
    recording.save(file)
    recording.send_recording_name(f"{robot.name}, simulated")
    recording.log("robot", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    disks = robot.disks
    diameters = [s.backbone.diameter or 0.01 * robot.length for s in robot.segments]
    lengths = np.maximum(disks.thickness_m, 2e-3 * robot.length)
    colours = [rgb(_HUES[i % len(_HUES)]) for i in disks.segment[robot.tendons.end_disk]]
    line = data["position"].to_numpy()
    position, rotation = data["disk_position"].to_numpy(), data["disk_rotation"].to_numpy()
    paths = holes(robot, data)
    times = np.asarray(data["time"], dtype=float)
    for k, time in enumerate(times):
        recording.set_time("time", duration=float(time))
        recording.log(
            "robot/backbone",
            rerun.LineStrips3D([line[k]], radii=0.5 * min(diameters), colors=rgb("ink")),
        )
        recording.log(
            "robot/disks",
            rerun.Cylinders3D(
                lengths=lengths,
                radii=disks.radius_m,
                centers=position[k],
                quaternions=Rotation.from_matrix(rotation[k]).as_quat(),
                colors=rgb("muted"),
                fill_mode="solid",
            ),
        )
        recording.log(
            "robot/tendons", rerun.LineStrips3D([path[k] for path in paths], colors=colours)
        )
        for axis, value in zip("xyz", line[k, -1], strict=True):
            recording.log(f"tip_m/{axis}", rerun.Scalars(float(value)))
        notify(_WHAT, (k + 1) / len(times))
    recording.flush()
    recording.disconnect()
