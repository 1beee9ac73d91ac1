"""The live view: what it shows, how fast, and what it refuses."""

from __future__ import annotations

import socket
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import closing
from typing import Any
from unittest.mock import Mock
from urllib.parse import urlsplit

import numpy as np
import pytest

import bowstring as bs
from bowstring.constant_curvature.robot_arcs import RobotArcs
from bowstring.errors import InputError
from bowstring.integrations.live import LiveView, tube
from bowstring.integrations.live_guard import refusal
from shell import Shell


def free_port() -> int:
    with closing(socket.socket()) as trial:
        trial.bind(("127.0.0.1", 0))
        port: int = trial.getsockname()[1]
        return port


@pytest.fixture
def opened() -> Iterator[Any]:
    """Open views, which end with the test."""
    pytest.importorskip("viser", reason="needs the extra view", exc_type=ImportError)
    views: list[LiveView] = []

    def open_(*subjects: Any, **settings: Any) -> LiveView:
        views.append(bs.view(subjects, port=free_port(), **settings))
        return views[-1]

    yield open_
    for view in views:
        view.stop()


# -- shapes ------------------------------------------------------------------------------------


def test_a_tube_has_its_radius_everywhere() -> None:
    s = np.linspace(0.0, 2.0, 41)
    line = np.stack([1.0 - np.cos(s), 0.0 * s, np.sin(s)], axis=1)
    radius = np.linspace(0.1, 0.05, 41)
    side = np.broadcast_to([0.3, 1.0, 0.2], line.shape)
    rings = tube(line, side, radius).reshape(41, -1, 3)
    away = np.linalg.norm(rings - line[:, None], axis=2)
    np.testing.assert_allclose(away, np.broadcast_to(radius[:, None], away.shape), rtol=1e-12)
    tangent = np.stack([np.sin(s), 0.0 * s, np.cos(s)], axis=1)
    across = np.einsum("kpi,ki->kp", rings - line[:, None], tangent)
    assert abs(across[1:-1]).max() < 1e-6


# -- the page ----------------------------------------------------------------------------------


def test_the_sliders_move_the_rod_and_constant_curvature(opened: Any) -> None:
    robot = bs.load_robot("amouri2019")
    view = opened(robot, bs.load_robot("rao2021"))
    assert [r.robot.name for r in view.robots] == ["amouri2019", "rao2021"]
    live = view.robots[0]
    live.set_tensions([56.0, 0.0, 0.0])
    expected = bs.solve(robot, [56.0, 0.0, 0.0])
    assert live.solution is not None and live.solution.tip is not None
    np.testing.assert_allclose(live.solution.tip.position, expected.tip.position, atol=1e-9)
    assert live.tip_error == pytest.approx(6.39e-3, abs=1e-5)
    assert "within the tolerance of 1 %" in live._said.content
    live.set_tensions([60.0, 0.0, 0.0])
    assert "**more than** the tolerance" in live._said.content
    # the mesh is where the tip is
    ring = np.asarray(live._body._backbone.vertices)[-16:].mean(axis=0)
    np.testing.assert_allclose(ring, live.solution.tip.position, atol=1e-6)
    with urllib.request.urlopen(view.url, timeout=10) as page:
        assert page.status == 200
    assert view.url in view._repr_html_()


def test_displacements_follow_from_commanded_bends(opened: Any) -> None:
    robot = bs.load_robot("amouri2019")
    live = opened(robot).robots[0]
    live.set_bends([np.radians(30.0)], [0.0])
    given = np.asarray(live.load.displacements)
    assert live.load.tensions is None and given[0] > 0 > given[1]
    np.testing.assert_allclose(given / given[0], [1.0, -0.5, -0.5], atol=1e-9)
    bent = RobotArcs.from_lengths(robot, robot.length - given)
    assert bent.theta[0] == pytest.approx(np.radians(30.0))
    expected = bs.solve(robot, load=live.load)
    assert expected.slack is not None and len(expected.slack)
    np.testing.assert_allclose(live.solution.tip.position, expected.tip.position, atol=1e-9)
    colours = np.asarray(live._body._tendons.colors)
    assert len(np.unique(colours.reshape(-1, 3), axis=0)) == 2  # slack tendons stand out
    off = np.linalg.norm(bent.tip.position - expected.tip.position)
    assert live.tip_error == pytest.approx(off, rel=1e-6)
    with pytest.raises(InputError, match="bends has shape"):
        live.set_bends([0.1, 0.2], [0.0, 0.0])


def test_gravity_and_tip_force_count(opened: Any) -> None:
    robot = bs.load_robot("amouri2019", {"gravity": "3 0 -9 m/s^2"})
    live = opened(robot).robots[0]
    np.testing.assert_allclose(live.load.gravity, robot.gravity, atol=0.08)  # steps of a slider
    live._force[0].value = 1.0
    live.update()
    expected = bs.solve(robot, load=live.load)
    np.testing.assert_allclose(live.solution.tip.position, expected.tip.position, atol=1e-9)
    live._weight.value = False
    live.update()
    assert not np.any(live.load.gravity)


def test_without_an_equilibrium_the_last_pose_stays(
    opened: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from bowstring.integrations import live as module

    live = opened(bs.load_robot("amouri2019")).robots[0]
    live.set_tensions([20.0, 0.0, 0.0])
    before = live.solution

    fails = Mock(side_effect=bs.errors.NoSolutionError("there is no equilibrium"))
    monkeypatch.setattr(module, "solve", fails)
    live.set_tensions([30.0, 0.0, 0.0])
    assert live.solution is before
    assert live._said.content == "**there is no equilibrium** The last pose stays."


def test_a_solution_stays_and_a_run_plays(opened: Any) -> None:
    robot = bs.load_robot("amouri2019")
    pose = bs.solve(robot, [30.0, 0.0, 0.0])
    run = bs.simulate(
        robot, [0.0, 0.0, 0.0], start=bs.Start(bs.Load([40.0, 0.0, 0.0])), duration=0.2
    )
    view = opened(pose, run, measured=[[0.1, 0.0, 0.6], [np.nan, 0.0, 0.0]])
    (player,) = view._players
    player._plays.value = False
    player.show(0.0)
    start = np.asarray(player._body._backbone.vertices)[-16:].mean(axis=0)
    place = player._body.place
    np.testing.assert_allclose(start - place, run.tip_position[0], atol=1e-6)
    player.show(0.2)
    end = np.asarray(player._body._backbone.vertices)[-16:].mean(axis=0)
    np.testing.assert_allclose(end - place, run.tip_position[-1], atol=1e-6)
    player._plays.value = True
    before = player._slider.value
    player._ended.wait(0.3)
    assert player._slider.value != before


# -- who may see it ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("path", "host", "origin", "seen"),
    [
        ("/secret/", "localhost:8080", None, True),
        ("/secret", "localhost:8080", "http://localhost:8080", True),
        ("/secret/index.html?darkMode", "localhost:8080", "http://localhost:8080", True),
        ("/secret", "localhost:8080", "http://foreign.example", False),
        ("/secret", "localhost:8080", "http://localhost:8081", False),
        ("/secret", "localhost:8080", "null", False),
        ("/secret", None, "http://localhost:8080", False),
        ("/", "localhost:8080", "http://localhost:8080", False),
        ("/secre", "localhost:8080", None, False),
        ("/x/secret/", "localhost:8080", None, False),
        ("/?/secret/", "localhost:8080", None, False),
        ("/s\N{LATIN SMALL LETTER E WITH ACUTE}cret", "localhost:8080", None, False),
    ],
)
def test_only_its_own_page_sees_the_view(
    path: str, host: str | None, origin: str | None, seen: bool
) -> None:
    assert (refusal("secret", path, host, origin) == "") == seen


def test_a_foreign_connection_is_refused_in_silence(
    opened: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    import viser
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    view = opened(bs.load_robot("amouri2019"))
    address = urlsplit(view.url)
    host, token = f"127.0.0.1:{address.port}", address.path.strip("/")

    def first(path: str, origin: str | None) -> object:
        given: dict[str, Any] = {"subprotocols": [f"viser-v{viser.__version__}"]}
        with connect(f"ws://{host}{path}", origin=origin, max_size=None, **given) as socket_:
            return socket_.recv(timeout=10)

    for path, origin in (
        ("/", None),
        ("/", f"http://{host}"),
        (f"/{token}", "http://foreign.test"),
    ):
        with pytest.raises(InvalidStatus, match="403"):
            first(path, origin)
    for origin in (None, f"http://{host}"):
        assert b"backbone" in zstandard_of(first(f"/{token}", origin))
    for data in (b"no HTTP", b"GET / HTTP/1.1\r\nUpgrade: websocket\r\n\r\n"):
        with socket.create_connection(("127.0.0.1", address.port)) as raw:
            raw.sendall(data)
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(f"http://{host}/", timeout=10)
    assert capfd.readouterr() == ("", "")


def zstandard_of(message: object) -> bytes:
    """The names in a message of viser."""
    import zstandard

    assert isinstance(message, bytes)
    begin = message.find(b"\x28\xb5\x2f\xfd")
    return zstandard.ZstdDecompressor().decompressobj().decompress(message[begin:])


# -- what it refuses ---------------------------------------------------------------------------


def test_what_cannot_be_viewed_is_refused() -> None:
    robot = bs.load_robot("amouri2019")
    for given, settings, message in (
        ((), {}, "there is nothing to view"),
        (("amouri2019",), {}, "a str cannot be viewed: give a robot"),
        ((robot,), {"tolerance": 0.0}, "tolerance is 0, it must be positive"),
        ((robot,), {"measured": [1.0, 2.0]}, r"measured has shape \(2,\)"),
        ((robot,), {"measured": "here"}, "measured must be numbers"),
    ):
        with pytest.raises(InputError, match=message):
            bs.view(given, **settings)


def test_without_the_extra_there_is_a_sentence(
    monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    code, _, err = shell("view", "amouri2019")
    assert code == 2
    assert "live views need viser" in err and "pip install 'bowstring[view]'" in err


def test_a_port_in_use_is_named(opened: Any) -> None:
    with closing(socket.socket()) as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(InputError, match=f"cannot serve at 127.0.0.1:{port}"):
            bs.view(bs.load_robot("amouri2019"), port=port)
    for port in (0, 70000, 1.5):
        with pytest.raises(InputError, match="must be a whole number from 1 to 65535"):
            bs.view(bs.load_robot("amouri2019"), port=port)  # type: ignore[arg-type]


def test_flags_are_checked_before_it_serves(shell: Shell, tmp_path: Any) -> None:
    for arguments, message in (
        (["nobody"], "nobody"),
        (["amouri2019", "--tolerance", "200 %"], "--tolerance"),
        (["amouri2019", "--run", str(tmp_path / "no.nc")], "--run"),
        (["amouri2019", "--measurements", str(tmp_path / "no.csv")], "--measurements"),
    ):
        code, out, err = shell("view", *arguments)
        assert code == 2 and message in err and not out
