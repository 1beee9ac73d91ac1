"""What several test files share."""

from __future__ import annotations

import signal

import pytest

from bowstring import study
from bowstring.robot import load_robot
from shell import Shell


@pytest.fixture(scope="session")
def paper() -> study.Study:
    """The study of the paper's own robot."""
    return study.run(load_robot("amouri2019"))


@pytest.fixture
def shell(capsys: pytest.CaptureFixture[str]) -> Shell:
    return Shell(capsys)


def pytest_configure() -> None:
    """A shell that starts the tests in the background has them ignore Ctrl-C; some test it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
