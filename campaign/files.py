"""Damaged files of all kinds that Bowstring reads: each is read, or rejected by a sentence.

Half of the files of JSON and YAML are damaged in their structure, the others in their bytes.

``python -m campaign.files N`` continues the last campaign with N more files. A trial is determined
by its number, so ``python -m campaign.files --only NUMBER`` repeats one. Each worker is a process
of its own: one that hangs or dies costs one trial, which is counted as a failure.

With ``--library target/release/libbowstring.so`` all files are compiled robots, which the C library
reads and solves.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import multiprocessing
import os
import resource
import shutil
import sys
import tempfile
import time
import traceback
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection, wait
from pathlib import Path
from random import Random
from typing import Any, Final

from campaign import compiled
from campaign.mutations import damage, rescale, reshape

ROOT: Final = Path(__file__).parents[1]
RESULTS: Final = Path(__file__).parent / "results"
SHARES: Final = {
    **{
        "robot": 18,
        "table": 14,
        "foreign": 6,
        "workbook": 4,
        "mapping": 8,
        "actuation": 6,
        "history": 6,
    },
    **{"start": 2, "truth": 2, "run": 17, "hdf5": 1},
    **{"residual": 4, "calibration": 2, "distributions": 4, "protocol": 2, "job": 1},
    **{"listing": 1, "kept": 1, "definition": 1},
}
"""Kinds of files, and their percentages of the trials."""
COMPILED: Final = "compiled"
"""Kind of a campaign with the C library."""
PATIENCE: Final = 30.0  # s for a file
SLOW: Final = 300.0  # s for an HDF5 file, whose own limits are 5 s of computing and 50 s in all
MEMORY: Final = 2 << 30  # bytes that a worker may use beyond its use at the start


# -- the files ---------------------------------------------------------------------------------


class Kind:
    """Intact files of a kind, and the function that reads one."""

    def __init__(self, suffix: str, corpus: list[bytes], read: Callable[[Path], object]) -> None:
        assert corpus
        self.suffix, self.corpus, self.read = suffix, corpus, read

    def check(self, folder: Path) -> None:
        """Read the intact files."""
        for content in self.corpus:
            whole = folder / f"whole{self.suffix}"
            whole.write_bytes(content)
            self.read(whole)


def compiled_kind(folder: Path, library: Path) -> dict[str, Kind]:
    """The kind of compiled robots, read by the C library in a file."""
    kind = Kind(".json", compiled.corpus(ROOT), compiled.Library(library).read)
    kind.check(folder)
    return {COMPILED: kind}


def kinds(folder: Path) -> dict[str, Kind]:
    """All kinds; intact files that are not in the repository are written to a folder."""
    import bowstring as bs
    from bowstring.calibration import read_residual, table_fit
    from bowstring.cli.actuation import read_history
    from bowstring.data import synthetic
    from bowstring.data.mapping import load_mapping
    from bowstring.dynamics.load_table import read_actuation
    from bowstring.dynamics.run_file import read_run
    from bowstring.files.result_folder import check_folder, write_listing
    from bowstring.integrations import live
    from bowstring.jobs import Job, Store, Variable, run
    from bowstring.robot.writer import to_yaml
    from bowstring.suite import running
    from bowstring.suite.protocol import Model, read_set

    package = ROOT / "python" / "bowstring"
    robot = bs.load_robot("amouri2019")
    rough = robot.with_({"segments.0.tendons.friction": "0.1"})
    elastic = bs.load_robot("rao2021")

    def raw(*files: Path) -> list[bytes]:
        return [file.read_bytes() for file in files]

    def read_robot(file: Path) -> None:
        found = bs.load_robot(file)
        again = file.with_name("again.yaml")
        again.write_text(to_yaml(found), "utf-8")
        if bs.load_robot(again).hash != found.hash:
            raise AssertionError("the robot is another one when it is written and read again")

    def read_path(file: Path) -> None:
        bs.solve(rough, [6.0, 0.0, 0.0], history=read_history(file))

    def table(file: Path) -> None:
        bs.read_measurements(file, robot)

    # a bench, its truth and a workbook of it
    data = synthetic.simulate(robot, synthetic.Loads(masses=(0.0, 1.0, 2.0), repeats=2), seed=1)
    made, truth = synthetic.write(data, folder / "bench.csv")
    rows = [
        line.split(",") for line in made.read_text("utf-8").splitlines() if not line.startswith("#")
    ]
    _workbook(folder / "bench.xlsx", rows)
    # a history and runs
    history = bs.solve(rough, [10.0, 0.0, 0.0]).history()
    assert history is not None
    small = robot.with_({"segments.0.disks.count": 3})
    output = bs.Output(points=2, path=folder / "run.nc")
    bs.simulate(small, [1.0, 0.0, 0.0], 0.03, output=output)
    moved = read_run(folder / "run.nc")
    moved.to_netcdf(folder / "run3.nc", format="NETCDF3_64BIT")
    moved.to_netcdf(folder / "run.h5")
    moved.isel(time=slice(0, 2)).to_netcdf(
        folder / "packed.h5", encoding={"position": {"zlib": True}}
    )
    start = {"robot": "a", "units": "SI: m, rad, s", "values": {"gain": 1.02, "base.x": 1e-4}}
    fitted = {
        "parameters": [
            {"name": "segments.*.backbone.E", "unit": "GPa", "value": 35, "standard_error": 2.0},
            {"name": "gravity.x", "unit": "m/s^2", "value": 0.1, "standard_error": 0.01},
        ],
        "correlation": [[1.0, 0.5], [0.5, 1.0]],
        "converged": True,
    }
    young, ratio = "segments.*.backbone.E", "segments.*.backbone.nu"
    alone = {young: {"normal": {"sd": "5 %"}}, ratio: {"uniform": {"from": 0.3, "to": 0.4}}}
    joint = {"calibration": "fit.json", ratio: {"lognormal": {"sd": "2 %"}}}
    (folder / "fit.json").write_text(json.dumps(fitted), "utf-8")
    job = Job(_squares, {"x": 3}, {"y": Variable("1", "y")}, {"a": [1]}, block=2)
    run(job, folder / "store")
    score = {"rows": 3, "rows_without_solution": 0, "values": {"rmse": 1.0, "mean": None}}
    kept = {"form": 1, "validation": score, "train": score, "parameters": {"gain": 1.0}}
    kept |= {"converged": True, "message": "", "time_s": 0.5}
    (folder / "modes").mkdir()
    write_listing(folder / "modes" / "modes.json", {"robot": "a"})

    with_robot = sorted((package / "suite" / "sets").glob("*/robot.yaml"))[0].parent
    shutil.copytree(with_robot, folder / "set")

    def read_distributions(file: Path) -> None:
        bs.uncertainty.read_distributions(file, robot)

    def read_fit(file: Path) -> None:
        shutil.copyfile(file, folder / "damaged-fit.json")
        bs.uncertainty.read_distributions({"calibration": str(folder / "damaged-fit.json")}, robot)

    def read_protocol(file: Path) -> None:
        shutil.copyfile(file, folder / "set" / "protocol.yaml")
        read_set(folder / "set")

    def read_job(file: Path) -> None:
        shutil.copyfile(file, folder / "store" / "job.json")
        Store(folder / "store", job)

    def read_listing(file: Path) -> None:
        shutil.copyfile(file, folder / "modes" / "modes.json")
        check_folder(folder / "modes", "modes")

    def read_definition(file: Path) -> None:
        text = file.read_text("utf-8", errors="surrogateescape")
        live._checked(moved.assign_attrs(robot_definition=text))

    def correct(file: Path) -> None:
        read_residual(file, robot).correct(bs.Load(tensions=[[1.0, 0.0, 0.0], [2.0, 1.0, 0.0]]))

    actuation = "t_s,tension_1_N,tension_2_N,tension_3_N\n0,0,0,0\n0.5,10,0,0\n1,0,5,0\n"
    displacements = "t_s,displacement_1_mm,displacement_2_mm,tension_3_N\n0,0,0,0\n0.5,1,-0.5,2\n"
    mapping = ROOT / "examples" / "foreign.yaml"
    foreign = mapping.with_suffix(".csv")
    found = {
        "robot": Kind(
            ".yaml",
            [
                *raw(*sorted((package / "robot" / "builtin").glob("*.yaml"))),
                *raw(ROOT / "examples" / "my_robot.yaml"),
                to_yaml(elastic).encode(),
            ],
            read_robot,
        ),
        "table": Kind(".csv", [*raw(ROOT / "examples" / "bench.csv"), made.read_bytes()], table),
        "foreign": Kind(
            ".csv",
            raw(foreign),
            lambda file: bs.read_measurements(file, mapping=mapping),
        ),
        "workbook": Kind(".xlsx", raw(folder / "bench.xlsx"), table),
        "mapping": Kind(
            ".yaml",
            [
                *raw(*sorted((package / "data" / "mappings").glob("*.yaml"))),
                *raw(mapping),
            ],
            load_mapping,
        ),
        "actuation": Kind(
            ".csv",
            [actuation.encode(), displacements.encode()],
            lambda file: read_actuation(file, robot),
        ),
        "history": Kind(".json", [json.dumps(history).encode()], read_path),
        "start": Kind(".json", [json.dumps(start).encode()], table_fit.read_start),
        "residual": Kind(".json", [json.dumps(_residual(robot)).encode()], correct),
        "calibration": Kind(".json", [json.dumps(fitted).encode()], read_fit),
        "distributions": Kind(
            ".yaml", [json.dumps(each).encode() for each in (alone, joint)], read_distributions
        ),
        "protocol": Kind(
            ".yaml",
            raw(folder / "set" / "protocol.yaml"),
            read_protocol,
        ),
        "job": Kind(".json", raw(folder / "store" / "job.json"), read_job),
        "listing": Kind(".json", raw(folder / "modes" / "modes.json"), read_listing),
        "kept": Kind(
            ".json",
            [json.dumps(kept).encode()],
            lambda file: running._kept(file, Model.model_construct()),
        ),
        "definition": Kind(".json", [moved.attrs["robot_definition"].encode()], read_definition),
        "truth": Kind(".truth.json", [truth.read_bytes()], _truth_reader(made, synthetic)),
        "run": Kind(".nc", raw(folder / "run.nc", folder / "run3.nc"), read_run),
        "hdf5": Kind(".nc", raw(folder / "run.h5", folder / "packed.h5"), read_run),
    }
    for kind in found.values():
        kind.check(folder)
    return found


def _squares(first: int, count: int) -> dict[str, Any]:
    import numpy as np

    return {"y": (first + np.arange(count)) ** 2.0}


def _residual(robot: Any) -> dict[str, Any]:
    """Content of a file of a residual of 20 rows."""
    import numpy as np

    import bowstring as bs
    from bowstring.calibration.observations import Score
    from bowstring.calibration.residual import Hyperparameters, Residual, Scales, Table
    from bowstring.calibration.residual_file import residual_to_dict

    tensions = np.random.default_rng(1).uniform(0.0, 10.0, (20, 3))
    points = bs.sweep(robot, tensions).tip_position
    score = Score(20, 1e-3, 1e-3, 2e-3, 1e-3, 1e-3)
    return residual_to_dict(
        Residual(
            robot=robot,
            rod=bs.RodModel(),
            values={"tool.x": 1e-3},
            tool=np.zeros(3),
            hyperparameters=Hyperparameters(),
            scales=Scales(np.full(3, 3.0), robot.length),
            by_displacement=np.zeros(3, dtype=bool),
            table=Table(tensions, points, [np.arange(20)]),
            residuals=1e-3 * np.cos(tensions),
            validated=(score, score),
        )
    )


def _truth_reader(table: Path, bench: Any) -> Callable[[Path], object]:
    place = bench.truth_file(table)

    def read(file: Path) -> object:
        shutil.copyfile(file, place)
        return bench.read_truth(table)

    return read


def _workbook(file: Path, rows: list[list[str]]) -> None:
    from openpyxl import Workbook

    book = Workbook()
    sheet = book.active
    for row in rows:
        sheet.append([_cell(each) for each in row])
    book.save(file)


def _cell(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _damaged_workbook(data: bytes, random: Random, folder: Path) -> bytes:
    """Damages mostly a part of the archive, not the archive itself."""
    if random.random() < 0.3:
        return damage(data, random, [data])
    source, target = folder / "whole.xlsx", folder / "part.xlsx"
    source.write_bytes(data)
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        names = old.namelist()
        chosen = random.choice(names)
        for name in names:
            part = old.read(name)
            new.writestr(name, damage(part, random, [part]) if name == chosen else part)
    return target.read_bytes()


# -- a trial -----------------------------------------------------------------------------------


def trial(number: int, of: dict[str, Kind], folder: Path, seed: int = 0) -> tuple[str, str, str]:
    """Damage a file and read it.

    Parameters
    ----------
    number : int
    of : dict
        As `kinds` or `compiled_kind` returns it.
    folder : Path
    seed : int

    Returns
    -------
    tuple of str
        Kind; "read", "refused" or "failed"; and the error.
    """
    from bowstring.errors import InputError, NoSolutionError

    name = COMPILED if COMPILED in of else kind_of(number, seed)
    kind, random = of[name], Random(f"{seed}:{number}")
    data = random.choice(kind.corpus)
    if name == COMPILED and random.random() < 0.5:
        data = rescale(data, random)
    elif kind.suffix in (".yaml", ".json", ".truth.json") and random.random() < 0.5:
        data = reshape(data, random, yaml=kind.suffix == ".yaml")
    elif name == "workbook":
        data = _damaged_workbook(data, random, folder)
    else:
        data = damage(data, random, kind.corpus)
    file = folder / f"damaged{kind.suffix}"
    file.write_bytes(data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            kind.read(file)
    except (InputError, NoSolutionError) as error:
        said = str(error)
        if not said or len(said) > 5000:
            return name, "failed", f"{len(said)} letters: {said[:300]!r}"
        return name, "refused", ""
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return name, "failed", "".join(traceback.format_exception(error))[-3000:]
    return name, "read", ""


def kind_of(number: int, seed: int = 0) -> str:
    """Kind of a trial."""
    return Random(f"kind:{seed}:{number}").choices([*SHARES], [*SHARES.values()])[0]


# -- many trials -------------------------------------------------------------------------------


def _work(pipe: Connection, seed: int, library: Path | None) -> None:
    """Worker process: receives numbers of trials, sends their outcomes."""
    with tempfile.TemporaryDirectory(prefix="bowstring-campaign-") as made:
        folder = Path(made)
        of = compiled_kind(folder, library) if library else kinds(folder)
        pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
        limit = pages * resource.getpagesize() + MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        pipe.send("ready")
        with contextlib.suppress(EOFError, KeyboardInterrupt):
            while True:
                number = pipe.recv()
                pipe.send((number, *trial(number, of, folder, seed)))


def _patience(number: int, seed: int) -> float:
    return SLOW if kind_of(number, seed) == "hdf5" else PATIENCE


class _Worker:
    def __init__(self, seed: int, library: Path | None) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=_work, args=(other, seed, library), daemon=True)
        self.process.start()
        other.close()
        self.number: int | None = None
        self.until = time.monotonic() + 120.0

    def give(self, number: int, seed: int) -> None:
        self.number = number
        self.until = time.monotonic() + _patience(number, seed)
        self.pipe.send(number)

    def end(self) -> None:
        self.process.kill()
        self.process.join()


def campaign(
    count: int, seed: int = 0, workers: int = 2, library: Path | None = None
) -> dict[str, Any]:
    """Continues for so many trials; results so far are in ``campaign/results``."""
    RESULTS.mkdir(exist_ok=True)
    place = RESULTS / f"{COMPILED if library else 'files'}-{seed}.json"
    kept = json.loads(place.read_text("utf-8")) if place.exists() else {"next": 0, "failures": []}
    counts = Counter(kept.get("counts", {}))
    failures = kept["failures"]
    first = kept["next"]
    todo = iter(range(first, first + count))
    done = 0
    begun = time.monotonic()
    waiting: set[int] = set()
    crew = [_Worker(seed, library) for _ in range(workers)]

    def keep() -> None:
        # trials in progress at a stop are repeated later, and counted once
        new = place.with_suffix(".new")
        content = {
            "seed": seed,
            "next": first + done,
            "counts": dict(sorted(counts.items())),
            "failures": failures,
        }
        new.write_text(json.dumps(content, indent=1) + "\n", "utf-8")
        os.replace(new, place)

    def note(number: int, kind: str, outcome: str, why: str) -> None:
        nonlocal done
        done += 1
        counts[f"{kind} {outcome}"] += 1
        waiting.discard(number)
        if outcome == "failed":
            failures.append({"number": number, "kind": kind, "why": why})
            print(f"trial {number}, {kind}: {why.strip().splitlines()[-1][:150]}", flush=True)
        if done % 500 == 0:
            keep()
            rate = done / (time.monotonic() - begun)
            print(f"{done} of {count}, {rate:.0f}/s, {len(failures)} failures", flush=True)

    def next_for(worker: _Worker) -> bool:
        number = next(todo, None)
        if number is None:
            return False
        worker.give(number, seed)
        waiting.add(number)
        return True

    try:
        while crew:
            ready = set(wait([worker.pipe for worker in crew], timeout=0.5))
            for worker in list(crew):
                if worker.pipe in ready:
                    try:
                        said = worker.pipe.recv()
                    except EOFError:
                        said = None
                    if isinstance(said, tuple):
                        note(*said)
                    if said is not None:
                        if not next_for(worker):
                            worker.end()
                            crew.remove(worker)
                        continue
                    why = "the process died"
                elif time.monotonic() > worker.until:
                    why = "it was not read in time"
                else:
                    continue
                worker.end()
                crew.remove(worker)
                if worker.number is None:
                    raise RuntimeError(f"a worker does not start: {why}")
                kind = COMPILED if library else kind_of(worker.number, seed)
                note(worker.number, kind, "failed", why)
                crew.append(_Worker(seed, library))
    finally:
        for worker in crew:
            worker.end()
        if not waiting:
            keep()
    return {"counts": dict(sorted(counts.items())), "failures": failures, "files": first + done}


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--library", type=Path, help="C library, which reads compiled robots")
    parser.add_argument("--only", type=int, help="repeat one trial, and keep its file")
    return parser.parse_args()


def _lines(found: dict[str, Any]) -> Iterator[str]:
    counts = found["counts"]
    yield f"{'kind':10} {'read':>8} {'refused':>8} {'failed':>8}"
    for kind in (*SHARES, COMPILED):
        row = [counts.get(f"{kind} {outcome}", 0) for outcome in ("read", "refused", "failed")]
        if not any(row):
            continue
        yield f"{kind:10} " + " ".join(f"{value:8}" for value in row)
    yield f"{found['files']} files, {len(found['failures'])} failures"


def main() -> None:
    options = _options()
    if options.only is not None:
        with tempfile.TemporaryDirectory() as made:
            folder, library = Path(made), options.library
            of = compiled_kind(folder, library) if library else kinds(folder)
            name, outcome, why = trial(options.only, of, folder, options.seed)
            print(f"{name}: {outcome}\n{why}")
            for file in folder.glob("damaged*"):
                RESULTS.mkdir(exist_ok=True)
                print(shutil.copy(file, RESULTS / f"{options.seed}-{options.only}{file.suffix}"))
        return
    found = campaign(options.count, options.seed, options.workers, options.library)
    print("\n".join(_lines(found)))
    sys.exit(1 if found["failures"] else 0)


if __name__ == "__main__":
    main()
