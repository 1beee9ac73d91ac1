"""Animation of a run as GIF or MP4: backbone, disks and tendons in real time."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.aliases import Floats, Progress
from bowstring.errors import InputError
from bowstring.files.atomic_io import check_file, write_whole_file
from bowstring.robot.model import Robot
from bowstring.validation import number
from bowstring.viz.vtk import check_data, circle, holes

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

__all__ = ["animate", "check_length", "check_picture"]

_FPS: Final = 25  # frames per second; exact in a GIF, whose unit of time is 10 ms
_DPI: Final = 110
_MOST: Final = 5000
_HUES: Final = ("red", "green", "purple", "amber")
_MM: Final = 1e3
_MARK: Final = b"Bowstring animation"  # comment that identifies our files


def check_picture(path: str | Path) -> Path:
    """Check before any work that an animation may be written to a file.

    Parameters
    ----------
    path : str or Path
        Path with the suffix ``.gif`` or ``.mp4``.

    Returns
    -------
    Path
        The same file, absolute, links resolved.

    Raises
    ------
    InputError
        If the suffix or folder is wrong, or ffmpeg, needed for MP4, is missing.
    """
    file = check_file(Path(path), "animation", (".gif", ".mp4"), _MARK)
    if file.suffix.lower() == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError(
            f"cannot write the animation to {file}: ffmpeg makes MP4 and is not installed; install "
            "it or name a .gif"
        )
    return file


def check_length(duration: float, speed: float = 1.0) -> float:
    """Number of frames for a duration in s; raise `InputError` if there are too many."""
    count = duration / speed * _FPS + 1.0
    if count > _MOST:
        raise InputError(
            f"the animation would have {count:.3g} pictures; {_MOST} are possible: choose a speed "
            f"of {count / _MOST * speed:.2g} or more (bowstring.viz.animation.animate), or "
            "fewer times"
        )
    return count


def animate(
    robot: Robot,
    data: xr.Dataset,
    path: str | Path,
    *,
    speed: float = 1.0,
    progress: Progress | None = None,
) -> Path:
    """Write an animation of a run, whole or not at all.

    Parameters
    ----------
    robot : Robot
        Robot of the run.
    data : xarray.Dataset
        Run from `bowstring.statics.fields.to_dataset` or `bowstring.dynamics.run_file.read_run`.
    path : str or Path
        Path with the suffix ``.gif``, or ``.mp4``, which needs ffmpeg; an existing animation is
        replaced.
    speed : float
        Speed relative to real time. Each frame shows the nearest output time.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    Path
        Absolute path of the file.

    Raises
    ------
    InputError
        If the file cannot be written, the run has a single time, or the animation is too long.
    """
    from matplotlib.animation import FFMpegWriter, PillowWriter

    from bowstring.viz.style import figure_style

    notify = progress or (lambda what, share: None)
    file = check_picture(path)
    check_data(robot, data)
    speed = number("speed", speed)
    times = data["time"].to_numpy()
    if len(times) < 2:
        raise InputError("the run holds one output time; there is nothing that moves")
    count = check_length(float(times[-1] - times[0]), speed)
    shown = times[0] + np.arange(max(2, int(count + 1e-9))) * speed / _FPS
    nearest = np.abs(times - shown[:, None]).argmin(axis=1)
    writer: Any
    if file.suffix.lower() == ".gif":
        writer = PillowWriter(fps=_FPS)
    else:
        writer = FFMpegWriter(
            fps=_FPS,
            codec="libx264",
            metadata={"comment": _MARK.decode()},
            extra_args=["-pix_fmt", "yuv420p"],
        )

    def fill(new: Path) -> None:
        try:
            with figure_style():
                scene = _Scene(robot, data, speed)
                with writer.saving(scene.figure, str(new), dpi=_DPI):
                    for k, i in enumerate(nearest.tolist()):
                        notify("animation", k / len(nearest))
                        scene.show(i)
                        writer.grab_frame()
        except subprocess.CalledProcessError as error:
            raise InputError(
                f"cannot write the animation to {file}: ffmpeg failed (exit code "
                f"{error.returncode}); name a .gif"
            ) from None

        if new.suffix.lower() == ".gif":
            _comment(new)

    write_whole_file(file, "animation", fill, lambda: check_picture(file))
    notify("animation", 1.0)
    return file


def _comment(gif: Path) -> None:
    """Add the comment to a GIF, before its frames."""
    raw = gif.read_bytes()
    flags = raw[10]
    table = 3 * 2 ** (flags % 8 + 1) if flags & 0x80 else 0  # bytes of the global colour table
    begin = 13 + table
    comment = b"\x21\xfe" + bytes([len(_MARK)]) + _MARK + b"\0"
    gif.write_bytes(raw[:begin] + comment + raw[begin:])


class _Scene:
    """Figure with its moving parts, in mm."""

    figure: Figure

    def __init__(self, robot: Robot, data: xr.Dataset, speed: float) -> None:
        from matplotlib.figure import Figure
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        from bowstring.viz.style import LIGHT as colour

        self._time = data["time"].to_numpy()
        self._backbone = _MM * data["position"].to_numpy()
        rim = robot.disks.radius_m[:, None, None] * circle(33, closed=True)
        turned = np.einsum("tdij,daj->tdai", data["disk_rotation"].to_numpy(), rim)
        self._rims = _MM * (data["disk_position"].to_numpy()[:, :, None] + turned)
        self._holes = [_MM * path for path in holes(robot, data)]

        self.figure = Figure(figsize=(5.6, 5.6))
        axes: Any = self.figure.add_axes((0.04, 0.05, 0.86, 0.83), projection="3d")
        low, high = self._limits()
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        axes.set_box_aspect(high - low, zoom=0.9)
        axes.view_init(elev=14.0, azim=-65.0)
        axes.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
        axes.zaxis.labelpad = 8
        for axis, span in zip((axes.xaxis, axes.yaxis, axes.zaxis), high - low, strict=True):
            axis.set_major_locator(_ticks(span, (high - low).max()))
            axis.set_pane_color("#ffffff")
        self._tendons = []
        for k, path in enumerate(self._holes):
            hue = colour[_HUES[k % len(_HUES)]]
            label = f"tendon {k + 1}" if k < 6 else None
            style = ("-", "--", "-.", ":")[(k + k // 4) % 4]
            x, y, z = path[0].T
            self._tendons += axes.plot(x, y, z, color=hue, lw=1.3, ls=style, label=label)
        x, y, z = self._backbone[0].T
        (self._line,) = axes.plot(x, y, z, color=colour["blue"], lw=3.5, label="backbone")
        self._disks = Poly3DCollection(
            list(self._rims[0]), facecolor=colour["muted"], edgecolor=colour["ink"], alpha=0.45
        )
        self._disks.set_linewidth(0.7)
        axes.add_collection3d(self._disks)
        self.figure.legend(loc="upper right", ncols=1 if len(self._holes) < 4 else 2)
        pace = "real time" if speed == 1.0 else f"{speed:g} times as fast as real"
        self._label = self.figure.text(0.03, 0.965, "", va="top", fontsize=13, family="monospace")
        self.figure.text(
            0.03, 0.915, f"{robot.name}, simulated, {pace}", va="top", color=colour["muted"]
        )

    def _limits(self) -> tuple[Floats, Floats]:
        points = np.concatenate(
            [path.reshape(-1, 3) for path in (self._rims, self._backbone, *self._holes)]
        )
        low, high = points.min(axis=0), points.max(axis=0)
        # in a flat box the tick labels of short sides would overlap
        side = np.maximum(high - low, 0.4 * (high - low).max())
        side[2] = high[2] - low[2]
        middle, room = 0.5 * (low + high), 0.02 * side.max()
        return middle - 0.5 * side - room, middle + 0.5 * side + room

    def show(self, i: int) -> None:
        """Show output time number i."""
        self._line.set_data_3d(*self._backbone[i].T)
        self._disks.set_verts(list(self._rims[i]))
        for line, path in zip(self._tendons, self._holes, strict=True):
            line.set_data_3d(*path[i].T)
        self._label.set_text(f"t = {self._time[i]:.3f} s")


def _ticks(span: float, longest: float) -> Any:
    """Fewer ticks on a short axis, so that their labels do not overlap."""
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(nbins=max(1, round(7.0 * span / longest)), steps=[1, 2, 5, 10])
