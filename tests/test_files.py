"""What is said before any work of places that cannot be written."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from bowstring import report, runfile, vtk
from bowstring.errors import InputError
from bowstring.files import check_file, check_place

SEALED = Path("/proc")  # takes no file of anyone's, whatever its rights say

sealed = pytest.mark.skipif(not SEALED.is_dir(), reason="needs /proc, a folder that takes no file")


@sealed
def test_a_folder_that_takes_no_file_is_refused() -> None:
    with pytest.raises(InputError, match="the folder /proc may not be written"):
        check_file(SEALED / "x.step", "solid", (".step",))
    with pytest.raises(InputError, match="the folder /proc may not be written"):
        runfile.check_file(SEALED / "run.nc")
    for check in (vtk.check_folder, report.check_folder):
        with pytest.raises(InputError, match="the folder /proc may not be written"):
            check(SEALED / "a" / "b")


def test_a_place_that_is_free_is_left_as_it_is(tmp_path: Path) -> None:
    check_place(tmp_path / "a" / "b", "no")
    check_place(tmp_path, "no")
    check_file(tmp_path / "x.step", "solid", (".step",))
    assert os.listdir(tmp_path) == []


def test_places_that_cannot_be_are_named(tmp_path: Path) -> None:
    (tmp_path / "notes").write_text("mine")
    with pytest.raises(InputError, match=r"no: .*notes is a file"):
        check_place(tmp_path / "notes" / "a", "no")
    with pytest.raises(InputError, match="no: File name too long"):
        check_place(tmp_path / ("x" * 300), "no")
