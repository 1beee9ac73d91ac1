"""Messages about output paths that cannot be written, before any work."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bowstring.cad.export import write_solid
from bowstring.data import synthetic
from bowstring.dynamics import run_file
from bowstring.errors import InputError
from bowstring.files import atomic_io
from bowstring.files.atomic_io import (
    check_file,
    check_place,
    check_replaceable,
    folder_beside,
    remove_leftovers,
    write_whole,
    write_whole_file,
)
from bowstring.robot.reader import load_robot
from bowstring.study import report
from bowstring.viz import vtk
from made_frames import made_file
from objects import refused

SEALED = Path("/proc")  # accepts no files, whatever its permissions

sealed = pytest.mark.skipif(not SEALED.is_dir(), reason="needs /proc, a folder that takes no file")


#: Checks of output paths, by a name that each takes.
CHECKS: dict[str, Callable[[Path], object]] = {
    "a.gif": lambda place: check_file(place, "animation", (".gif",), b"mark"),
    "run.nc": run_file.check_file,
    "bench.csv": synthetic.check_table,
    "series": vtk.check_folder,
    "study": report.check_folder,
}


def refused_by_all(says: str, folder: Path) -> None:
    for name, check in CHECKS.items():
        refused(says, partial(check, folder / name))


@sealed
def test_a_folder_that_takes_no_file_is_refused() -> None:
    refused_by_all("the folder /proc may not be written", SEALED)
    for check in (vtk.check_folder, report.check_folder):
        refused("the folder /proc may not be written", partial(check, SEALED / "a" / "b"))


def test_a_free_path_is_not_touched(tmp_path: Path) -> None:
    check_place(tmp_path / "a" / "b", "no")
    check_place(tmp_path, "no")
    check_file(tmp_path / "x.step", "solid", (".step",), b"mark")
    assert os.listdir(tmp_path) == []


def test_impossible_paths_are_named(tmp_path: Path) -> None:
    (tmp_path / "notes").write_text("mine")
    refused(r"no: .*notes is a file", lambda: check_place(tmp_path / "notes" / "a", "no"))
    refused("no: File name too long", lambda: check_place(tmp_path / ("x" * 300), "no"))
    refused("no: its name is not valid", lambda: check_place(tmp_path / "a\0", "no"))


def test_links_in_a_circle_are_refused(tmp_path: Path) -> None:
    for name in CHECKS:
        (tmp_path / name).symlink_to(tmp_path / f"b{name}")
        (tmp_path / f"b{name}").symlink_to(tmp_path / name)
    refused_by_all("links lead to it in a circle", tmp_path)
    refused("its name is not valid", lambda: run_file.check_file("\0"))


def test_a_working_folder_that_was_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    for check in (run_file.check_file, vtk.check_folder, report.check_folder):
        refused("No such file or directory", partial(check, "run"))


def test_files_of_other_users_are_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in /tmp: files of other users in a writable folder cannot be replaced."""
    robot = load_robot("amouri2019")
    made_file(tmp_path / "run.nc", robot, {}).finish()
    (tmp_path / "a.gif").write_text("")
    (tmp_path / "series").mkdir()
    checks = [partial(CHECKS[name], tmp_path / name) for name in ("run.nc", "a.gif", "series")]
    monkeypatch.setattr(os, "geteuid", lambda: tmp_path.stat().st_uid + 1)
    for check in checks:
        check()
    tmp_path.chmod(0o1777)
    for check in checks:
        refused("another user's, who alone may replace it in", check)
    run_file.check_file(tmp_path / "new.nc")
    monkeypatch.undo()
    for check in checks:
        check()


def _fill(new: Path) -> None:
    new.write_text("whole")


@pytest.mark.parametrize("name", ["x" * 255, "\N{VIOLIN}" * 63, f"a.{'x' * 253}"])
def test_the_longest_names_are_written(tmp_path: Path, name: str) -> None:
    """The temporary name must not be too long where the name itself is allowed."""
    write_whole_file(tmp_path / name, "file", _fill)
    assert (tmp_path / name).read_text() == "whole"
    (tmp_path / name).unlink()
    write_whole(tmp_path / name, "folder", lambda new: _fill(new / "a"))
    assert (tmp_path / name / "a").read_text() == "whole"
    assert os.listdir(tmp_path) == [name]


@pytest.mark.parametrize("mask", [0o077, 0o022, 0o007])
def test_permissions_are_those_of_any_new_file(tmp_path: Path, mask: int) -> None:
    former = os.umask(mask)
    try:
        write_whole_file(tmp_path / "file", "file", _fill)
        write_whole(tmp_path / "folder", "folder", lambda new: (new / "a").touch())
        made_file(tmp_path / "run.nc", load_robot("amouri2019"), {}).finish()
    finally:
        os.umask(former)
    for name in ("file", "folder/a", "run.nc"):
        assert (tmp_path / name).stat().st_mode & 0o777 == 0o666 & ~mask
    assert (tmp_path / "folder").stat().st_mode & 0o777 == 0o777 & ~mask


# -- paths that cannot be replaced as a whole -----------------------------------------------------


@pytest.mark.parametrize("check", [report.check_folder, vtk.check_folder])
def test_the_root_and_the_working_folder_are_refused(
    check: Callable[[Path], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused("it is the root of the file system", lambda: check(Path("/")))
    (tmp_path / "a").mkdir()
    monkeypatch.chdir(tmp_path / "a")
    refused("the working folder is or lies in it", lambda: check(Path()))
    check(Path("new"))


@pytest.mark.skipif(not os.path.ismount("/dev/shm"), reason="needs a drive of its own")
def test_a_mounted_drive_is_refused() -> None:
    # other programs keep files there, which another check would name first
    with pytest.raises(InputError, match="a drive is mounted there"):
        check_replaceable(Path("/dev/shm"), "cannot write the study")


def test_a_large_foreign_tree_is_not_walked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One file is enough to reject it."""
    for i in range(20):
        (tmp_path / "mine" / str(i)).mkdir(parents=True)
        (tmp_path / "mine" / str(i) / "notes").touch()
    looked, walk = [], os.walk

    def counted(*arguments: Any, **options: Any) -> Iterator[Any]:
        for each in walk(*arguments, **options):
            looked.append(each)
            yield each

    monkeypatch.setattr(os, "walk", counted)
    refused("no study of Bowstring", lambda: report.check_folder(tmp_path / "mine"))
    assert len(looked) <= 2


# -- leftovers of a killed process -----------------------------------------------------------------

KILLED = """
import os, signal, sys
from pathlib import Path
from bowstring.files import atomic_io

def fill(new):
    (new / "half").write_text("half")
    if sys.argv[2] == "fill":
        os.kill(os.getpid(), signal.SIGKILL)

rename, moves = os.rename, []
def killed(*names):
    rename(*names)
    os.kill(os.getpid(), signal.SIGKILL)

if sys.argv[2] == "move":
    atomic_io._exchange = lambda *_: False
    os.rename = killed
atomic_io.write_whole(Path(sys.argv[1]), "study", fill)
"""


def killed(place: Path, when: str) -> None:
    code = subprocess.run([sys.executable, "-c", KILLED, str(place), when], check=False).returncode
    assert code == -signal.SIGKILL


@pytest.mark.skipif(os.name == "nt", reason="no SIGKILL")
def test_leftovers_of_a_killed_process_are_swept(tmp_path: Path) -> None:
    place = tmp_path / "study"
    killed(place, "fill")
    assert [p.name[:7] for p in tmp_path.iterdir()] == [".study-"]
    (tmp_path / ".mine-0123456789ab").mkdir()
    write_whole(place, "study", lambda new: (new / "whole").touch())
    assert sorted(os.listdir(tmp_path)) == [".mine-0123456789ab", "study"]
    assert os.listdir(place) == ["whole"]


@pytest.mark.skipif(os.name == "nt", reason="no SIGKILL")
def test_killed_between_two_renames_the_former_folder_comes_back(tmp_path: Path) -> None:
    place = tmp_path / "study"
    place.mkdir()
    (place / "former").touch()
    killed(place, "move")
    assert not place.exists()
    check_place(place, "no")  # as the next run does before its work
    assert os.listdir(place) == ["former"] and os.listdir(tmp_path) == ["study"]


def test_files_of_a_live_process_are_not_swept(tmp_path: Path) -> None:
    with folder_beside(tmp_path / "study") as work:
        (work / "half").touch()
        remove_leftovers(tmp_path)
        write_whole_file(tmp_path / "other", "file", _fill)
        assert os.listdir(work) == ["half"]
    assert os.listdir(tmp_path) == ["other"]


@pytest.mark.parametrize("atomic", [True, False])
def test_a_former_folder_is_exchanged(
    atomic: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not atomic:
        monkeypatch.setattr(atomic_io, "_exchange", lambda *_: False)
    for name in ("former", "later"):
        write_whole(tmp_path / "study", "study", lambda new, name=name: (new / name).touch())
    assert os.listdir(tmp_path) == ["study"] and os.listdir(tmp_path / "study") == ["later"]


@pytest.mark.skipif(sys.platform != "linux", reason="of Linux")
def test_the_exchange_is_one_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "study").mkdir()

    def never(*_: object) -> None:
        raise AssertionError("two steps")

    monkeypatch.setattr(os, "rename", never)
    write_whole(tmp_path / "study", "study", lambda new: (new / "later").touch())
    assert os.listdir(tmp_path / "study") == ["later"]


def test_a_netcdf_that_does_not_fit_is_one_sentence(tmp_path: Path) -> None:
    """The library raises a RuntimeError; a limit of the size of files stands for a full drive."""
    resource = pytest.importorskip("resource")
    netcdf = pytest.importorskip("netCDF4")
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]

    def fill(new: Path) -> None:
        file = new / "a.nc" if new.is_dir() else new
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
        try:
            with netcdf.Dataset(file, "w") as data:
                data.createDimension("x", 10_000)
                data.createVariable("v", "f8", ("x",))[:] = np.zeros(10_000)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))

    for write, name in ((write_whole_file, "a.nc"), (write_whole, "folder")):
        with pytest.raises(InputError, match=r"cannot write the map to .*NetCDF: .*room on the"):
            write(tmp_path / name, "map", fill)
    assert not os.listdir(tmp_path)

    def other(new: Path) -> None:
        raise RuntimeError("a bug")

    with pytest.raises(RuntimeError, match="a bug"):
        write_whole_file(tmp_path / "a.nc", "map", other)


def test_a_netcdf_on_a_full_drive_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fill(new: Path) -> None:
        raise RuntimeError("NetCDF: HDF error")

    free = shutil.disk_usage(tmp_path)._replace(free=0)
    monkeypatch.setattr(shutil, "disk_usage", lambda place: free)
    with pytest.raises(InputError, match="the drive is full; make room"):
        write_whole_file(tmp_path / "a.nc", "map", fill)


def test_folders_above_are_removed_where_the_work_fails(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()

    def full(new: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(InputError, match="No space left on device"):
        write_whole(tmp_path / "a" / "b" / "c" / "d", "study", full)
    assert os.listdir(tmp_path) == ["a"] and os.listdir(tmp_path / "a") == []
    write_whole(tmp_path / "a" / "b" / "c", "study", lambda new: None)
    assert (tmp_path / "a" / "b" / "c").is_dir()


def test_a_full_drive_is_named_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = shutil.disk_usage(tmp_path)._replace(free=0)
    monkeypatch.setattr(shutil, "disk_usage", lambda place: full)
    refused_by_all("the drive is full; make room", tmp_path)
    # a drive without sizes is not full
    monkeypatch.setattr(shutil, "disk_usage", lambda place: full._replace(total=0))
    check_file(tmp_path / "a.svg", "figure", (".svg",), b"")


def test_what_libraries_say_of_a_full_drive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def denied(new: Path) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    def failed(solid: object, new: Path) -> bool:
        raise RuntimeError("Failed to write STEP file")

    monkeypatch.setattr("bowstring.cad.export._step", failed)
    refused("Permission denied", lambda: write_whole_file(tmp_path / "a.nc", "map", denied))
    with pytest.raises(InputError, match="the CAD kernel failed"):
        write_solid(None, tmp_path / "a.step")  # type: ignore[arg-type]
    almost = shutil.disk_usage(tmp_path)._replace(free=5000)
    monkeypatch.setattr(shutil, "disk_usage", lambda place: almost)
    for write in (
        lambda: write_whole_file(tmp_path / "a.nc", "map", denied),
        lambda: write_solid(None, tmp_path / "a.step"),  # type: ignore[arg-type]
    ):
        refused("the drive is full; make room", write)
    assert os.listdir(tmp_path) == []
