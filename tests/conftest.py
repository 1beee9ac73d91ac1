"""What several test files share."""

from __future__ import annotations

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
