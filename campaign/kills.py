"""Commands that are killed or interrupted at random moments leave only complete results.

``python -m campaign.kills N`` does N trials. In half of them an earlier result exists. After
SIGKILL the result is the earlier one, a complete new one or none; the next command removes
temporary files. After SIGTERM and Ctrl-C, also two of them, the command reports it within seconds
and leaves nothing.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import Final, NamedTuple

PATIENCE: Final = 60.0  # s for a command to end after a signal, on a busy machine
SIGNALS: Final = {
    "KILL": [signal.SIGKILL],
    "TERM": [signal.SIGTERM],
    "INT": [signal.SIGINT],
    "TERM twice": [signal.SIGTERM, signal.SIGTERM],
}
STOPPED: Final = 130
BEFORE_MAIN: Final = (-signal.SIGTERM, -signal.SIGINT)  # Python itself was still starting


class Command(NamedTuple):
    """A command, its output, a check that the output is complete, and whether it is resumed."""

    arguments: tuple[str, ...]
    output: str
    check: Callable[[Path], None]
    resumes: bool = False


def _folder(file: str) -> Callable[[Path], None]:
    def check(folder: Path) -> None:
        kept = json.loads((folder / file).read_text("utf-8"))
        for name, digest in kept["sha256"].items():
            assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest, name
        there = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}
        assert there == set(kept["files"]), there

    return check


def _run(file: Path) -> None:
    from bowstring.dynamics.run_file import read_run

    read_run(file)


def _drawing(file: Path) -> None:
    assert file.read_text("utf-8").rstrip().endswith("</svg>")


def _history(file: Path) -> None:
    json.loads(file.read_text("utf-8"))["arcs_rad"]


def _table(file: Path) -> None:
    from bowstring.data.measurements import read_measurements

    read_measurements(file)


def _series(folder: Path) -> None:
    assert "</VTKFile>" in (folder / "run.pvd").read_text("utf-8")


def _zarr(folder: Path) -> None:
    """All chunks are there, and each has the values of its points."""
    import xarray as xr

    with xr.open_zarr(folder) as data:
        solved = data["solved"].to_numpy()
        assert solved.shape == (20, 10, 10)
        assert (solved == 1).all(), f"{int((solved != 1).sum())} points without a value"
        errors = data["cc_from_force"].to_numpy()
        assert ((errors >= 0.0) & (errors < 1.0)).all(), "an error that is none"


_OVER: Final = ("tension=1:60:20", "gravity.z=-9.81:0:10", "tip_force.x=0:1:10")
_STORED: Final = (
    *("map", "amouri2019", *(word for axis in _OVER for word in ("--over", axis))),
    *("--models", "cc_from_force", "--points", "5", "--store", "map-store", "--out"),
)
_MOTION: Final = ("simulate", "amouri2019", "--tension", "5,0,0", "--rise", "0.2", "--hold", "0.1")
COMMANDS: Final = (
    Command(("study", "amouri2019", "--points", "3", "--out"), "st", _folder("study.json")),
    Command(("modes", "amouri2019", "--count", "2", "--out"), "md", _folder("modes.json")),
    Command((*_MOTION, "--out"), "run.nc", _run),
    Command((*_MOTION, "--vtk"), "series", _series),
    Command(("export", "amouri2019", "--drawing"), "disk.svg", _drawing),
    Command(("solve", "amouri2019", "--tension", "5,0,0", "--save-history"), "path.json", _history),
    Command(_STORED, "map.zarr", _zarr, resumes=True),
    Command(("bench", "simulate", "amouri2019", "--masses", "0:1:4", "--out"), "table.csv", _table),
)


def start(command: Command, folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "bowstring", *command.arguments, command.output],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def trial(
    number: int,
    former: Path,
    took: dict[str, float],
    seed: int,
    commands: Sequence[Command] = COMMANDS,
) -> tuple[str, str]:
    """Stop a command once.

    Parameters
    ----------
    number : int
    former : Path
        A folder with the outputs of all commands.
    took : dict
        Seconds that each command takes, by its output.
    seed : int
    commands : sequence of Command
        Commands of which one is chosen.

    Returns
    -------
    tuple of str
        What was done, and what was wrong, or nothing.
    """
    random = Random(f"{seed}:{number}")
    command, name = random.choice(commands), random.choice([*SIGNALS])
    with tempfile.TemporaryDirectory(prefix="bowstring-kills-") as made:
        folder = Path(made)
        place, replaces = folder / command.output, random.random() < 0.5
        if replaces:
            for file in former.glob(f"{place.stem}*"):
                copy = shutil.copytree if file.is_dir() else shutil.copyfile
                copy(file, folder / file.name)
        with start(command, folder) as process:
            time.sleep(random.random() * took[command.output])
            for one in SIGNALS[name]:
                process.send_signal(one)
                time.sleep(0.02)
            try:
                _, said = process.communicate(timeout=PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                return f"{command.output} {name}", "it did not end"
        what = f"{command.output} {name}, exit {process.returncode}"
        try:
            _judge(command, name, process.returncode, said, folder, replaces)
            if command.resumes:
                _resume(command, folder)
        except Exception as error:
            return what, f"{type(error).__name__}: {error}; {said[-500:]!r}"
    return what, ""


def _judge(command: Command, name: str, code: int, said: str, folder: Path, replaces: bool) -> None:
    place = folder / command.output
    if name != "KILL":
        assert code in (0, STOPPED, *BEFORE_MAIN), "the exit code"
        assert code in BEFORE_MAIN or "Traceback" not in said, "a traceback"
        assert code != STOPPED or "Stopped" in said, "no word"
        assert not _hidden(folder), f"{_hidden(folder)} is left"
    _sweep(folder)
    if replaces or code == 0:
        assert place.exists(), "the result is lost"
    if place.exists():
        command.check(place)
    # the truth of a table is stored beside it
    assert not [p for p in folder.iterdir() if not p.name.startswith(place.stem)], "strange files"


def _resume(command: Command, folder: Path) -> None:
    """Run a stopped command to its end."""
    with start(command, folder) as process:
        _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, f"it does not go on: {said}"
    command.check(folder / command.output)
    assert not _hidden(folder), f"{_hidden(folder)} is left"


def _hidden(folder: Path) -> list[str]:
    return [name for name in os.listdir(folder) if name.startswith(".")]


def _sweep(folder: Path) -> None:
    """Removes leftovers as the next command does; child processes of a killed one end soon."""
    from bowstring.files.atomic_io import remove_leftovers

    until = time.monotonic() + PATIENCE
    remove_leftovers(folder)
    while _hidden(folder):
        assert time.monotonic() < until, f"{_hidden(folder)} stays"
        time.sleep(0.05)
        remove_leftovers(folder)


def campaign(
    count: int, seed: int = 0, commands: Sequence[Command] = COMMANDS
) -> tuple[Counter[str], list[str]]:
    """Returns the outcomes of so many trials, and the failures."""
    counts: Counter[str] = Counter()
    failures: list[str] = []
    with tempfile.TemporaryDirectory(prefix="bowstring-kills-") as made:
        former, took = Path(made), {}
        for command in commands:
            begun = time.monotonic()
            with start(command, former) as process:
                _, said = process.communicate()
            assert process.returncode == 0, said
            took[command.output] = 1.1 * (time.monotonic() - begun)
        for number in range(count):
            what, wrong = trial(number, former, took, seed, commands)
            counts[what.partition(" ")[2]] += 1
            if wrong:
                failures.append(f"trial {number}, {what}: {wrong}")
                print(failures[-1], flush=True)
    return counts, failures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="output of the command that is stopped, such as map.zarr")
    options = parser.parse_args()
    chosen = [each for each in COMMANDS if options.only in (None, each.output)]
    counts, failures = campaign(options.count, options.seed, chosen)
    for what, number in sorted(counts.items()):
        print(f"{what:28} {number:6}")
    print(f"{options.count} commands stopped, {len(failures)} failures")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
