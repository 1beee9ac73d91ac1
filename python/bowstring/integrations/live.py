"""Live view in the browser: robots with sliders, poses, and runs that play.

The page is that of viser, served on this machine; Python solves and sends shapes.
"""

from __future__ import annotations

import html
import math
import secrets
import socket
import threading
import time
from collections.abc import Sequence
from contextlib import redirect_stdout
from io import StringIO
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring.aliases import Floats
from bowstring.constant_curvature.arc import Arc
from bowstring.constant_curvature.robot_arcs import RobotArcs
from bowstring.dynamics.simulation import Run
from bowstring.errors import BowstringError, InputError
from bowstring.files.json_files import parsed
from bowstring.formatting import significant
from bowstring.integrations.live_guard import only_with
from bowstring.inverse.limits import default_max_tension
from bowstring.optional import load_extra
from bowstring.robot.model import Robot
from bowstring.statics.actuation import commanded
from bowstring.statics.load import Load
from bowstring.statics.rod import solve
from bowstring.statics.solution import Solution
from bowstring.validation import row, share_of_length, whole
from bowstring.viz.colours import rgb
from bowstring.viz.vtk import check_data, check_stations

if TYPE_CHECKING:
    import xarray as xr

    _Subject: TypeAlias = Robot | Solution | Run | xr.Dataset

__all__ = ["LiveRobot", "LiveView", "view"]

_AROUND: Final = 16
_POINTS: Final = 6  # points of a module
_ARC_POINTS: Final = 25
_GRAVITY: Final = 9.80665
_APART: Final = 0.7  # distance of two robots over their lengths
_FRAME: Final = 1.0 / 30.0  # s
_MOST_TENDONS: Final = 60
_MOST_BEND: Final = 120.0  # degrees
_TURN: Final = np.linspace(0.0, math.tau, _AROUND, endpoint=False)


def view(
    subjects: _Subject | Sequence[_Subject],
    *,
    measured: ArrayLike | None = None,
    tolerance: float | str = 0.01,
    host: str = "127.0.0.1",
    port: int = 8080,
) -> LiveView:
    """Show robots, solutions and runs in the browser; needs the extra ``view``.

    A robot gets sliders for its tendons, gravity and tip force, and constant curvature beside it. A
    solution is a pose that stays. A run plays, by a slider of time. Several stand side by side.

    Parameters
    ----------
    subjects : Robot, Solution, Run or xarray.Dataset, or a sequence of them
        A run in a file is what `bowstring.dynamics.run_file.read_run` reads.
    measured : array_like (K, 3), optional
        Measured points in the base frame of the first subject, m.
    tolerance : float or str
        Tolerated tip error of constant curvature: a share of the length, 0.01 or "1 %", or a length
        such as "0.5 mm".
    host : str
        Address to serve at; others than ``"127.0.0.1"`` let other machines connect.
    port : int
        Port to serve at, 1 to 65535.

    Returns
    -------
    LiveView
        It serves until its `stop`, or the end of Python. In a notebook it shows itself.

    Raises
    ------
    InputError
        If viser is missing, the port is in use, or a subject cannot be shown.
    """
    several = subjects if isinstance(subjects, (list, tuple)) else [subjects]
    if not several:
        raise InputError("there is nothing to view: give a robot, a solution or a run")
    shown = [_checked(subject) for subject in several]
    for robot, _ in shown:
        share_of_length("tolerance", tolerance, robot.length)
    points = None if measured is None else _points(measured)
    viser = load_extra("view")
    _check_port(host, port)
    return LiveView(viser, shown, points, tolerance, (host, port))


_Shown: TypeAlias = "tuple[Robot, Solution | xr.Dataset | None]"


def _checked(subject: object) -> _Shown:
    """A robot, and its pose or run where there is one."""
    import xarray as xr

    if isinstance(subject, Robot):
        return subject, None
    if isinstance(subject, Solution):
        if not subject.converged:
            raise InputError(f"the solution has no pose: {subject.message}")
        return subject.robot, subject
    if isinstance(subject, Run):
        subject = subject.to_dataset()
    if not isinstance(subject, xr.Dataset):
        kind = type(subject).__name__
        raise InputError(f"a {kind} cannot be viewed: give a robot, a solution or a run")
    if "robot_definition" not in subject.attrs:
        raise InputError("the data are no run of Bowstring: they name no robot")
    try:
        robot = Robot.model_validate(parsed(subject.attrs["robot_definition"]))
    except ValueError:
        raise InputError("the run is damaged: robot_definition is no robot") from None
    check_data(robot, subject)
    check_stations(subject)
    return robot, subject


def _points(measured: ArrayLike) -> Floats:
    try:
        points = np.asarray(measured, dtype=float)
    except (OverflowError, TypeError, ValueError):
        raise InputError("measured must be numbers (K, 3) in m") from None
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"measured has shape {points.shape}, it must be (K, 3)")
    return np.asarray(points[np.isfinite(points).all(axis=1)])


def _check_port(host: str, port: int) -> None:
    """Refuse a port that cannot be served, instead of taking another one."""
    whole("port", port, 1, 65535)
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((host, port))
        except (OSError, UnicodeError) as error:
            why = getattr(error, "strerror", None) or error
            raise InputError(
                f"cannot serve at {host}:{port} ({why}); another program may use the port, "
                f"give another one, such as {port % 65535 + 1}"
            ) from None


class LiveView:
    """Page with robots; made by `view`.

    Attributes
    ----------
    url : str
        Address of the page, with a token: without it nothing is shown.
    robots : tuple of LiveRobot
        Robots with sliders, in the order given.
    """

    def __init__(
        self,
        viser: Any,
        shown: Sequence[_Shown],
        measured: Floats | None,
        tolerance: float | str,
        address: tuple[str, int],
    ) -> None:
        host, port = address
        self._players: list[_Player] = []
        token = secrets.token_urlsafe(16)
        with only_with(token) as guarded, redirect_stdout(StringIO()):  # its banner
            self._server = viser.ViserServer(host=host, port=port, verbose=False)
        if not guarded:
            self.stop()
            raise InputError(
                "this version of viser starts its server in another way, so that any page could "
                "see the view; install another one: pip install 'viser>=1.0.30,<2'"
            )
        self.url: str = f"http://{'localhost' if host == '127.0.0.1' else host}:{port}/{token}/"
        scene = self._server.scene
        scene.set_up_direction("+z")
        longest = max(robot.length for robot, _ in shown)
        scene.add_grid(
            "/grid", width=4 * longest, height=4 * longest, cell_size=longest / 10, plane="xy"
        )
        made: list[LiveRobot] = []
        try:
            for k, (robot, state) in enumerate(shown):
                place = np.array([0.0, _APART * longest * k, 0.0])
                path = f"/{k + 1}"
                if state is None:
                    made.append(LiveRobot(self._server, robot, path, place, tolerance))
                elif isinstance(state, Solution):
                    _show_solution(self._server, state, path, place)
                else:
                    self._players.append(_Player(self._server, robot, state, path, place))
        except BaseException:
            self.stop()
            raise
        self.robots: tuple[LiveRobot, ...] = tuple(made)
        if measured is not None and len(measured):
            scene.add_point_cloud("/measured", measured, rgb("green"), point_size=0.008 * longest)
        camera = self._server.initial_camera
        camera.position = (1.2 * longest, -1.8 * longest, 1.1 * longest)
        camera.look_at = (0.0, 0.35 * longest * (len(shown) - 1), 0.4 * longest)

    def __repr__(self) -> str:
        return f"<LiveView at {self.url}>"

    def _repr_html_(self) -> str:
        address = html.escape(self.url, quote=True)
        return f'<iframe src="{address}" title="Robot in 3-D" width="100%" height="600"></iframe>'

    def wait(self) -> None:
        """Serve until Ctrl-C."""
        while True:
            time.sleep(0.2)

    def stop(self) -> None:
        """End the page."""
        for player in self._players:
            player.stop()
        with redirect_stdout(StringIO()):
            self._server.stop()


class _Body:
    """Backbone, disks and tendons of a robot in the scene."""

    def __init__(self, server: Any, robot: Robot, path: str, place: Floats) -> None:
        self.robot, self.place = robot, place
        diameters = [s.backbone.diameter or 0.01 * robot.length for s in robot.segments]
        radius = 0.5 * np.array(diameters)[robot.disks.segment]
        self._radius = np.maximum(radius, 2e-3 * robot.length)
        count = len(radius)
        local = []
        for r, thick in zip(robot.disks.radius_m, robot.disks.thickness_m, strict=True):
            half = np.array([0.0, 0.0, 0.5 * max(float(thick), 2e-3 * robot.length)])
            rim = np.stack([r * np.cos(_TURN), r * np.sin(_TURN), 0.0 * _TURN], axis=1)
            local.append(np.concatenate([rim - half, rim + half, [-half, half]]))
        self._disk = np.array(local)
        disk_faces = np.concatenate([_disk_faces() + k * self._disk.shape[1] for k in range(count)])
        straight = robot.disks.station_m[:, None] * [0.0, 0.0, 1.0]
        turns = np.broadcast_to(np.eye(3), (count, 3, 3))
        line = np.linspace(0.0, 1.0, _POINTS * count + 1)[:, None] * straight[-1]
        scene = server.scene
        self._backbone = scene.add_mesh_simple(
            f"{path}/backbone",
            self._tube(line, turns),
            _tube_faces(len(line)),
            color=rgb("ink"),
        )
        self._disks = scene.add_mesh_simple(
            f"{path}/disks", self._solids(straight, turns), disk_faces, color=rgb("muted")
        )
        spans = self._spans(straight, turns)
        self._owner = np.repeat(np.arange(len(spans)), [len(s) for s in spans])
        self._tendons = scene.add_line_segments(
            f"{path}/tendons",
            np.concatenate(spans),
            self._hues(()),
            thickness=2.0,
            thickness_units="screen",
        )

    def bend(
        self, line: Floats, position: Floats, rotation: Floats, slack: Sequence[int] = ()
    ) -> None:
        """Show another pose: points of the backbone, poses of the disks, slack tendons from 1."""
        self._backbone.vertices = self._tube(line, rotation)
        self._disks.vertices = self._solids(position, rotation)
        self._tendons.points = np.concatenate(self._spans(position, rotation)).astype(np.float32)
        self._tendons.colors = self._hues(slack)

    def _tube(self, line: Floats, rotation: Floats) -> NDArray[np.float32]:
        module = np.minimum(np.arange(len(line)) // _POINTS, len(rotation) - 1)
        found = tube(line, rotation[module][:, :, 0], self._radius[module])
        return np.asarray(found + self.place, dtype=np.float32)

    def _solids(self, position: Floats, rotation: Floats) -> NDArray[np.float32]:
        turned = np.einsum("kij,kpj->kpi", rotation, self._disk) + position[:, None]
        return np.asarray(turned.reshape(-1, 3) + self.place, dtype=np.float32)

    def _spans(self, position: Floats, rotation: Floats) -> list[Floats]:
        paths = self.robot.tendon_points(position, rotation)
        return [np.stack([p[:-1], p[1:]], axis=1) + self.place for p in paths]

    def _hues(self, slack: Sequence[int]) -> NDArray[np.uint8]:
        loose = np.isin(self._owner, np.asarray(slack, dtype=int) - 1)
        each = np.where(loose[:, None], rgb("purple"), rgb("ink"))
        return np.repeat(each[:, None], 2, axis=1).astype(np.uint8)


def tube(line: Floats, side: Floats, radius: Floats) -> Floats:
    """Vertices (P a, 3) of a tube through points (P, 3), with its radius (P,) at each.

    `side` (P, 3) are vectors, none along the line, from which the rings begin.
    """
    ahead = np.diff(line, axis=0)
    tangent = np.concatenate([ahead[:1], ahead[:-1] + ahead[1:], ahead[-1:]])
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-300)
    first = side - (side * tangent).sum(axis=1, keepdims=True) * tangent
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-300)
    second = np.cross(tangent, first)
    ring = np.cos(_TURN)[:, None] * first[:, None] + np.sin(_TURN)[:, None] * second[:, None]
    return np.asarray((line[:, None] + radius[:, None, None] * ring).reshape(-1, 3))


def _tube_faces(points: int) -> NDArray[np.uint32]:
    j, k = np.arange(_AROUND), np.roll(np.arange(_AROUND), -1)
    low = _AROUND * np.arange(points - 1)[:, None]
    high = low + _AROUND
    pairs = [(low + j, low + k, high + k), (low + j, high + k, high + j)]
    return np.concatenate([np.stack(p, axis=-1) for p in pairs]).reshape(-1, 3).astype(np.uint32)


def _disk_faces() -> NDArray[np.uint32]:
    j, k = np.arange(_AROUND), np.roll(np.arange(_AROUND), -1)
    below, above = np.full(_AROUND, 2 * _AROUND), np.full(_AROUND, 2 * _AROUND + 1)
    fans = [(below, k, j), (above, j + _AROUND, k + _AROUND)]
    return np.concatenate([_tube_faces(2), *(np.stack(f, axis=-1) for f in fans)]).astype(np.uint32)


class LiveRobot:
    """A robot with sliders; made by `view`.

    Attributes
    ----------
    robot : Robot
    solution : Solution or None
        Equilibrium that is shown.
    tip_error : float
        Tip error of constant curvature from the same tensions or displacements, m; NaN without an
        arc.
    """

    def __init__(
        self, server: Any, robot: Robot, path: str, place: Floats, tolerance: float | str
    ) -> None:
        tendons = len(robot.tendons.segment)
        if tendons > _MOST_TENDONS:
            raise InputError(
                f"{robot.name} has {tendons} tendons, which are too many sliders: solve it, and "
                "view the solution"
            )
        self.robot = robot
        self.tolerance = share_of_length("tolerance", tolerance, robot.length)
        self.solution: Solution | None = None
        self.tip_error = math.nan
        self._place = place
        self._lock = threading.Lock()
        self._body = _Body(server, robot, path, place)
        radius = 0.5 * (robot.segments[0].backbone.diameter or 0.01 * robot.length)
        self._ghost_radius = max(radius, 2e-3 * robot.length) * 1.05
        line = np.linspace(0.0, 1.0, len(robot.segments) * (_ARC_POINTS - 1) + 1)
        self._ghost = server.scene.add_mesh_simple(
            f"{path}/constant curvature",
            self._arc_tube(line[:, None] * [0.0, 0.0, robot.length]),
            _tube_faces(len(line)),
            color=rgb("red"),
            opacity=0.45,
        )
        gui = server.gui
        most = 0.5 * default_max_tension(robot)
        force = 0.05 * float(most.max())

        def slider(name: str, low: float, high: float, value: float, unit: str) -> Any:
            step = 10.0 ** math.floor(math.log10((high - low) / 200.0))
            high = step * math.ceil(high / step)
            low = step * math.floor(low / step)
            made = gui.add_slider(f"{name}, {unit}", low, high, step, min(max(value, low), high))
            made.on_update(lambda _: self.update())
            return made

        with gui.add_folder(robot.name):
            self._said = gui.add_markdown("")
            self._control = gui.add_dropdown("control by", ("tensions", "displacements"))
            self._control.on_update(lambda _: self.update())
            self._tensions = [
                slider(f"tension {i + 1}", 0.0, float(most[i]), 0.0, "N") for i in range(tendons)
            ]
            self._bends = []
            for i in range(len(robot.segments)):
                of = f" {i + 1}" if len(robot.segments) > 1 else ""
                self._bends += [
                    slider(f"commanded bend{of}", 0.0, _MOST_BEND, 0.0, "degrees"),
                    slider(f"direction{of}", -180.0, 180.0, 0.0, "degrees"),
                ]
            size = math.hypot(*robot.gravity)
            tilt = math.degrees(math.acos(-robot.gravity[2] / size)) if size else 0.0
            self._weight = gui.add_checkbox("gravity", size > 0.0)
            self._weight.on_update(lambda _: self.update())
            self._size = size or _GRAVITY
            self._azimuth = math.atan2(robot.gravity[1], robot.gravity[0])
            self._tilt = slider("gravity, angle from -z", 0.0, 180.0, tilt, "degrees")
            self._force = [slider(f"tip force {a}", -force, force, 0.0, "N") for a in "xyz"]
        self.update()

    def set_tensions(self, tensions: ArrayLike) -> None:
        """Move the sliders of the tensions, and show the pose under them.

        Parameters
        ----------
        tensions : array_like (T,)
            In N; beyond the ends of a slider, its end.
        """
        values = row("tensions", tensions, len(self._tensions), "N")
        self._control.value = "tensions"
        for slider, value in zip(self._tensions, values, strict=True):
            slider.value = float(min(max(value, slider.min), slider.max))
        self.update()

    def set_bends(self, bends: ArrayLike, directions: ArrayLike) -> None:
        """Move the sliders of the displacements, and show the pose under them.

        Parameters
        ----------
        bends, directions : array_like (S,)
            Bend angle of each segment and its direction from x towards y, rad, as constant
            curvature has them. The displacements of the tendons follow from it.
        """
        count = len(self.robot.segments)
        given = {"bends": bends, "directions": directions}
        values = np.degrees([row(name, each, count, "rad") for name, each in given.items()])
        self._control.value = "displacements"
        for slider, value in zip(self._bends, values.T.ravel(), strict=True):
            slider.value = float(min(max(value, slider.min), slider.max))
        self.update()

    def _arcs(self) -> RobotArcs:
        """Constant curvature from the tensions or displacements of the sliders."""
        if self._control.value == "tensions":
            return RobotArcs.from_tensions(self.robot, [s.value for s in self._tensions])
        return RobotArcs.from_lengths(self.robot, self._lengths(0.0) - self._displacements())

    def _lengths(self, share: float) -> Floats:
        """Tendon lengths of constant curvature at a share of the commanded bends."""
        bend, direction = np.radians([s.value for s in self._bends]).reshape(-1, 2).T
        length = np.array([segment.length for segment in self.robot.segments])
        return RobotArcs(self.robot, Arc(share * bend / length, direction, length)).lengths()

    def _displacements(self) -> Floats:
        return self._lengths(0.0) - self._lengths(1.0)

    @property
    def load(self) -> Load:
        """Load of the sliders."""
        tilt = math.radians(self._tilt.value)
        side = math.sin(tilt) * self._size
        gravity = (
            side * math.cos(self._azimuth),
            side * math.sin(self._azimuth),
            -math.cos(tilt) * self._size,
        )
        pulled = self._control.value == "tensions"
        return Load(
            tensions=[s.value for s in self._tensions] if pulled else None,
            displacements=None if pulled else commanded(self.robot, self._displacements()),
            gravity=gravity if self._weight.value else (0.0, 0.0, 0.0),
            tip_force=[s.value for s in self._force],
        )

    def update(self) -> None:
        """Solve the load of the sliders and show the pose; without one the last stays."""
        with self._lock:
            pulled = self._control.value == "tensions"
            for slider in self._tensions:
                slider.visible = pulled
            for slider in self._bends:
                slider.visible = not pulled
            try:
                found = solve(self.robot, load=self.load)
            except BowstringError as error:
                self._said.content = f"**{error}** The last pose stays."
                return
            line = found.centerline(_POINTS)
            if line is None or found.disk_positions is None or found.disk_rotations is None:
                self._said.content = f"**{found.message}** The last pose stays."
                return
            self.solution = found
            self._body.bend(line, found.disk_positions, found.disk_rotations, _slack(found))
            self._show_arcs(line[-1])

    def _arc_tube(self, line: Floats) -> NDArray[np.float32]:
        ahead = np.gradient(line, axis=0)
        # a side that is never along the line
        side = np.where(
            abs(ahead[:, :1]) < 0.9 * np.linalg.norm(ahead, axis=1)[:, None],
            [1.0, 0, 0],
            [0, 1.0, 0],
        )
        found = tube(line, side, np.full(len(line), self._ghost_radius))
        return np.asarray(found + self._place, dtype=np.float32)

    def _show_arcs(self, tip: Floats) -> None:
        try:
            arcs = self._arcs()
        except BowstringError as error:
            self._ghost.visible = False
            self.tip_error = math.nan
            self._said.content = f"Constant curvature has no answer: {error}"
            return
        self._ghost.visible = True
        line = arcs.centerline(_ARC_POINTS)
        self._ghost.vertices = self._arc_tube(line)
        self.tip_error = float(np.linalg.norm(line[-1] - tip))
        share = self.tip_error / self.robot.length
        verdict = "within" if share <= self.tolerance else "**more than**"
        x, y, z = (f"{1e3 * v:.2f}" for v in tip)
        assert self.solution is not None
        estimate = self.solution.error_estimate
        stated = (
            ""
            if estimate is None
            else f" (estimated error {significant(1e6 * estimate.tip, 2)} µm)"
        )
        self._said.content = (
            f"Simulated. Tip of the rod: {x}, {y}, {z} mm{stated}. Constant curvature is wrong by "
            f"{significant(1e3 * self.tip_error, 3)} mm, {significant(100 * share, 3)} % of the "
            f"length: {verdict} the tolerance of {significant(100 * self.tolerance, 3)} %."
        )


def _show_solution(server: Any, found: Solution, path: str, place: Floats) -> None:
    line = found.centerline(_POINTS)
    assert line is not None and found.disk_positions is not None
    assert found.disk_rotations is not None
    _Body(server, found.robot, path, place).bend(
        line, found.disk_positions, found.disk_rotations, _slack(found)
    )


def _slack(found: Solution) -> list[int]:
    return [] if found.slack is None else [int(i) for i in found.slack]


class _Player:
    """A run that plays, with a slider of time."""

    def __init__(
        self, server: Any, robot: Robot, data: xr.Dataset, path: str, place: Floats
    ) -> None:
        self._body = _Body(server, robot, path, place)
        self._time = np.asarray(data["time"], dtype=float)
        self._line = _lines(data)
        self._position = data["disk_position"].to_numpy()
        self._rotation = data["disk_rotation"].to_numpy()
        with server.gui.add_folder(f"{robot.name}, run"):
            last = float(self._time[-1] - self._time[0])
            self._slider = server.gui.add_slider(
                "time, s", 0.0, max(last, 1e-3), max(last, 1e-3) / 500, 0.0
            )
            self._plays = server.gui.add_checkbox("play", True)
            self._speed = server.gui.add_slider("speed", 0.05, 2.0, 0.05, 1.0)
        self._slider.on_update(lambda _: self.show(self._slider.value))
        self.show(0.0)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._play, daemon=True)
        self._thread.start()

    def show(self, passed: float) -> None:
        """Show the output nearest to a time since the start (s)."""
        k = int(np.argmin(abs(self._time - self._time[0] - passed)))
        self._body.bend(self._line[k], self._position[k], self._rotation[k])

    def _play(self) -> None:
        while not self._ended.wait(_FRAME):
            if self._plays.value:
                after = self._slider.value + _FRAME * self._speed.value
                self._slider.value = 0.0 if after > self._slider.max else after
                self.show(self._slider.value)

    def stop(self) -> None:
        """End the thread."""
        self._ended.set()
        self._thread.join()


def _lines(data: xr.Dataset) -> Floats:
    """Points of the backbone as `Solution.centerline` has them, from the stations of a run."""
    module = np.asarray(data["module"], dtype=int)
    station = np.asarray(data["arc_length"], dtype=float)
    position = data["position"].to_numpy()
    parts = []
    for k in range(1, int(module.max()) + 1):
        own = np.flatnonzero(module == k)
        wanted = np.linspace(station[own[0]], station[own[-1]], _POINTS, endpoint=False)
        right = np.clip(np.searchsorted(station[own], wanted, side="right"), 1, len(own) - 1)
        left = right - 1
        gap = station[own][right] - station[own][left]
        share = ((wanted - station[own][left]) / gap)[:, None]
        here = position[:, own]
        parts.append((1.0 - share) * here[:, left] + share * here[:, right])
    return np.concatenate([*parts, position[:, -1:]], axis=1)
