"""Fixtures shared by several test files."""

from __future__ import annotations

import os
import pickle
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bowstring import interrupts
from bowstring.robot.model import Robot
from bowstring.robot.reader import load_robot
from bowstring.study import correction_polynomial, run
from bowstring.study.run import run_study
from bowstring.study.study import Study
from bowstring.validity import contour
from made_once import common_folder, made_once
from shell import Shell, process


@pytest.fixture(scope="session")
def robot() -> Robot:
    """The paper's own robot."""
    return load_robot("amouri2019")


@pytest.fixture(scope="session")
def rao() -> Robot:
    """Two segments."""
    return load_robot("rao2021")


@pytest.fixture(scope="session")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """The study of the paper's own robot, computed once for all test processes."""
    place = made_once(
        common_folder(tmp_path_factory) / "study.pickle",
        lambda part: part.write_bytes(pickle.dumps(run_study(load_robot("amouri2019")))),
    )
    found = pickle.loads(place.read_bytes())
    assert isinstance(found, Study)
    return found


@pytest.fixture(scope="session")
def studied(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The report by `bowstring study` in a process of its own, and what it printed as JSON."""
    folder = common_folder(tmp_path_factory) / "written"

    def study(part: Path) -> None:
        done = process("study", "--out", str(folder), "--json")
        assert done.returncode == 0 and not done.stderr, done.stderr
        part.write_text(done.stdout, "utf-8")

    return folder, made_once(folder.with_suffix(".json"), study).read_text("utf-8")


@pytest.fixture(scope="session")
def written(studied: tuple[Path, str]) -> Path:
    """The folder of the report of the study `paper`, which no test changes."""
    return studied[0]


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few samples, coarse lines in maps, and few loads of polynomials, for other results."""
    monkeypatch.setattr(run, "_ASSUMED_POINTS", 16)
    monkeypatch.setattr(correction_polynomial, "_FITTED", 600)
    monkeypatch.setattr(correction_polynomial, "_HELD_OUT", 200)
    monkeypatch.setattr(contour, "_CELLS", 16)


@pytest.fixture(autouse=True)
def no_interrupt_outlives_its_test() -> Iterator[None]:
    """Restore signal handlers after a command, and raise an interrupt that was not handled."""
    before = {number: signal.getsignal(number) for number in interrupts.SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)
    interrupts.acknowledge()


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, which is empty."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for results of finite elements, which no other test sees."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


@pytest.fixture
def shell(capsys: pytest.CaptureFixture[str]) -> Shell:
    return Shell(capsys)


@pytest.fixture
def public_data(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Path]:
    """The folder of a public data set by its name; the test is skipped where it is missing."""
    beside = Path(__file__).parents[2] / "shared" / "data"
    home = Path(os.environ.get("BOWSTRING_DATA", beside)).resolve()
    monkeypatch.setenv("BOWSTRING_DATA", str(home))

    def folder(name: str) -> Path:
        if not (home / name).is_dir():
            pytest.skip(f"needs the data of others, {name}, in {home}")
        return home / name

    return folder


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests that need public data with the marker `data`."""
    for item in items:
        if "public_data" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.data)


def pytest_configure() -> None:
    """Restore Ctrl-C, which a shell disables for tests started in the background."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
