"""`make bench`: every solver on the same robot and loads, one table for statics, one for
displacement control and one for a motion, each with our own figures.

Each solver runs in a process of its own, one after the other, on one thread (only Bowstring's batch
row uses all cores); one that is not installed, fails or takes too long gets a row with the reason.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import dist, isnan, nan, prod
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from benchmarks import displacement, ramp
from benchmarks.cases import DISPLACEMENTS, LOADED, Case, Result

ROOT = Path(__file__).parent.parent
OURS = "Bowstring"
PEERS = {
    "Exudyn": "exudyn_rod",
    "MuJoCo": "mujoco_chain",
    "PyElastica": "pyelastica_rod",
    "soromox": "soromox_rod",
}
DISPLACEMENT_PEERS = {"Exudyn": "exudyn_displacement", "MuJoCo": "mujoco_displacement"}
RAMP_PEERS = {"Exudyn": "exudyn_ramp", "MuJoCo": "mujoco_ramp"}
LEVELS_MM = (30, 10, 3, 1, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
TIME_LIMIT_S = 600
ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "JAX_PLATFORMS": "cpu",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
}
TITLES = {
    DISPLACEMENTS[-1]: "tendon 1 at 80 N, nothing else",
    LOADED: "tendons at 40, 10, 5 N, gravity on 20 g disks and backbone, 1 N transverse at the tip",
}

# The cases of crates/bowstring-core/benches/path.rs: modules and tendons of each.
CORE_CASES = {
    "study": (9, 3),
    "slack": (9, 3),
    "1x10": (10, 3),
    "2x10": (20, 6),
    "3x10": (30, 9),
    "3x20": (60, 9),
}
LINEAR = 1.2  # "about 1" for linear growth of time


def readable(value: float) -> str:
    """Format with three significant digits, without an exponent."""
    if isnan(value):
        return "-"
    return f"{float(f'{value:.3g}'):,.10f}".rstrip("0").rstrip(".").replace(",", " ")


def run_solver(venv: str, module: str) -> dict:
    """Return the report of a benchmark process, or {"failed": reason}."""
    python = ROOT / venv / "bin" / "python"
    if not python.exists():
        return {"failed": f"not installed: no {venv}"}
    try:
        process = subprocess.run(
            [python, "-m", f"benchmarks.{module}"],
            cwd=ROOT,
            env=os.environ | ONE_THREAD,
            capture_output=True,
            text=True,
            timeout=TIME_LIMIT_S,
        )
    except subprocess.TimeoutExpired:
        return {"failed": f"stopped after {TIME_LIMIT_S} s"}
    if process.returncode == 0 and process.stdout.strip():
        return json.loads(process.stdout.strip().splitlines()[-1])
    reason = (process.stderr.strip() or f"exit code {process.returncode}").splitlines()[-1]
    missing = reason.startswith("ModuleNotFoundError")
    return {"failed": f"{'not installed' if missing else 'failed'}: {reason}"}


def error_mm(result: Result, case: Case) -> float:
    return dist(result.tip_mm, case.tip_mm)


def results_of(report: dict, case: Case, solved: bool = True) -> list[Result]:
    results = [Result(**r) for r in report.get("results", []) if r["case"] == case.name]
    return [r for r in results if (r.tip_mm is not None) == solved]


def best(results: list, error: Callable[..., float]) -> list:
    """The fastest setting at each level of tip error, coarse to fine."""
    chosen: list = []
    for level in LEVELS_MM:
        reaching = [r for r in results if error(r) <= level]
        fastest = min(reaching, key=lambda r: r.time_ms, default=None)
        if fastest and fastest not in chosen:
            chosen.append(fastest)
    return chosen


def comparison(reports: dict[str, dict]) -> Table:
    table = Table(title="Static solve of amouri2019: time and tip error", title_justify="left")
    for column in ("solver", "setting"):
        table.add_column(column)
    for column in ("time, ms", "tip error, mm", "time / our one call"):
        table.add_column(column, justify="right")
    for case, title in TITLES.items():
        table.add_row(f"[bold]{case.name}[/bold]", f"[bold]{title}[/bold]")
        ours = {r.setting: r.time_ms for r in results_of(reports[OURS], case)}.get("one call", nan)
        for solver, report in reports.items():
            if "failed" in report:
                table.add_row(solver, escape(report["failed"]))
                continue
            results = results_of(report, case)
            for r in results if solver == OURS else best(results, partial(error_mm, case=case)):
                values = (r.time_ms, error_mm(r, case), r.time_ms / ours)
                table.add_row(solver, r.setting, *map(readable, values))
            if not results:
                notes = [r.note for r in results_of(report, case, solved=False)] or ["not run"]
                table.add_row(solver, escape(f"no solution: {notes[0]}"))
        table.add_section()
    return table


@dataclass
class Found:
    """A solved setting of the displacement-controlled robot."""

    setting: str
    time_ms: float
    error_mm: float
    tension_n: float


def found(report: dict, converged: list[float] | None) -> list[Found]:
    return [
        Found(r["setting"], r["time_ms"], dist(r["tip_mm"], converged), r["tension_n"])
        for r in report.get("results", [])
        if r["tip_mm"] is not None and converged is not None
    ]


def displacement_comparison(reports: dict[str, dict]) -> Table:
    table = Table(title="Displacement control: time and tip error", title_justify="left")
    for column in ("solver", "setting"):
        table.add_column(column)
    for column in ("time, ms", "tip error, mm", "tension 1, N", "time / our one call"):
        table.add_column(column, justify="right")
    converged = reports[OURS].get("converged_mm")
    ours = {r.setting: r.time_ms for r in found(reports[OURS], converged)}.get("one call", nan)
    for solver, report in reports.items():
        if "failed" in report:
            table.add_row(solver, escape(report["failed"]))
            continue
        results = found(report, converged)
        for r in results if solver == OURS else best(results, lambda r: r.error_mm):
            time, error, ratio = map(readable, (r.time_ms, r.error_mm, r.time_ms / ours))
            table.add_row(solver, r.setting, time, error, f"{r.tension_n:.5f}", ratio)
        if not results:
            notes = [r["note"] for r in report["results"] if r["note"]] or [
                "nothing to measure from"
            ]
            table.add_row(solver, escape(f"no solution: {notes[0]}"))
        table.add_section()
    return table


def displacement_notes(report: dict) -> str:
    """Describe the table of displacement control, with our tip beside the independent one."""
    displacements = ", ".join(f"{1e3 * value:.3f}" for value in displacement.DISPLACEMENTS)
    lines = [
        f"Displacements {displacements} mm: those of {displacement.TENSION_N:g} N on tendon 1. "
        "Gravity and tip force on.",
        "Bowstring: a constraint; which tendons are slack is part of the solution. Exudyn,",
        "MuJoCo: tendon 1 is a stiff spring (soft constraint), the others are prescribed as slack.",
        "PyElastica, soromox: have no such input.",
    ]
    if "converged_mm" in report:
        apart = dist(report["converged_mm"], displacement.CHECK_TIP_MM)
        lines.append(
            "Tip error: from ours with elements=8, which is "
            f"{apart:.1g} mm from that of Exudyn by tension, extrapolated."
        )
    return "\n".join(lines)


@dataclass
class Moved:
    """A setting of the ramp that ran to its end."""

    setting: str
    time_ms: float
    error_mm: float

    @property
    def real_time_factor(self) -> float:
        return 1e3 * ramp.DURATION_S / self.time_ms


def against_converged(reports: dict[str, dict]) -> None:
    """Replace the tips of every setting in the ramp reports by errors."""
    converged = reports[OURS].get("converged_mm")
    for report in reports.values():
        for result in report.get("results", []):
            tips = result.pop("tips_mm")
            known = tips is not None and converged is not None
            result["error_mm"] = ramp.error_mm(tips, converged) if known else None


def moved(report: dict) -> list[Moved]:
    return [
        Moved(r["setting"], r["time_ms"], r["error_mm"])
        for r in report.get("results", [])
        if r["error_mm"] is not None
    ]


def ramp_comparison(reports: dict[str, dict]) -> Table:
    table = Table(
        title="Motion of amouri2019: tendon 1 from 0 to 80 N in 1 s, held for 1 s",
        title_justify="left",
    )
    for column in ("solver", "setting"):
        table.add_column(column)
    for column in ("time, ms", "x real time", "tip error, mm", "time / ours at no larger error"):
        table.add_column(column, justify="right")
    for solver, report in reports.items():
        if "failed" in report:
            table.add_row(solver, escape(report["failed"]))
            continue
        results = moved(report)
        for r in results if solver == OURS else best(results, lambda r: r.error_mm):
            ratio = "" if solver == OURS else readable(r.time_ms / our_time(reports, r.error_mm))
            values = (r.time_ms, r.real_time_factor, r.error_mm)
            table.add_row(solver, r.setting, *map(readable, values), ratio)
        if not results:
            notes = [r["note"] for r in report["results"]] or ["not run"]
            table.add_row(solver, escape(f"no solution: {notes[0]}"))
        table.add_section()
    return table


def our_time(reports: dict[str, dict], error: float) -> float:
    """Time in ms of our fastest whole call with at most this tip error; nan if none."""
    times = [r.time_ms for r in moved(reports[OURS]) if r.error_mm <= error]
    return min(times, default=nan)


def published(report: dict) -> str:
    """Compare our converged run with the published figures."""
    if "converged_mm" not in report:
        return "No converged run of ours: no tip errors."
    pairs = [
        f"{report['converged_mm'][round(time / ramp.OUTPUT_S)][0]:.3f} ({x:g}) mm at {time:g} s"
        for time, x in ramp.PUBLISHED_X_MM.items()
    ]
    return (
        "Tip error: largest over the motion at 100 Hz, from our run at dt 0.1 ms, elements=4,\n"
        f"without numerical damping.\nIts tip x (published): {', '.join(pairs)}."
    )


def cpu_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(x.split(":")[1].strip() for x in lines if x.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def core_us() -> dict[str, float]:
    """Times of the core's micro-benchmarks (`cargo bench`) in us, each its fastest sample: other
    work on the machine only adds to it, and may last longer than a benchmark."""
    times = {}
    for file in (ROOT / "target" / "criterion").glob("*/new/sample.json"):
        sample = json.loads(file.read_text())
        each = (t / n for t, n in zip(sample["times"], sample["iters"], strict=True))
        times[file.parent.parent.name] = min(each) / 1e3
    return times


def times_exudyn(reports: dict, setting: str, equal_error: bool) -> float:
    """Exudyn's time over ours, the smaller of the two cases. At equal error: its fastest setting
    with our tip error or less; if there is none, its most accurate, which favours Exudyn."""
    ratios = []
    for case in TITLES:
        ours = [r for r in results_of(reports[OURS], case) if r.setting == setting]
        peers = results_of(reports["Exudyn"], case)
        if not ours or not peers:
            return nan
        most_accurate = min(error_mm(r, case) for r in peers)
        our_error = error_mm(ours[0], case)
        limit = max(our_error, most_accurate) if equal_error else max(LEVELS_MM)
        times = [r.time_ms for r in peers if error_mm(r, case) <= limit]
        ratios.append(min(times, default=nan) / ours[0].time_ms)
    return min(ratios)


class Figures:
    """A table of performance targets and measurements; nan is "not measured"."""

    def __init__(self, title: str) -> None:
        self.table = Table(title=title, title_justify="left")
        for column in ("figure", "target", "measured", ""):
            right = column in ("target", "measured")
            self.table.add_column(column, justify="right" if right else "left")

    def row(self, name: str, sign: str, target: float, value: float, unit: str = "") -> None:
        if isnan(target):
            self.table.add_row(name, "", f"{readable(value)} {unit}")
            return
        met = value >= target if sign == ">=" else value <= target
        verdict = "" if isnan(value) else "[green]met[/green]" if met else "[red]missed[/red]"
        measured = "not measured" if isnan(value) else f"{readable(value)} {unit}"
        self.table.add_row(name, f"{sign} {readable(target)} {unit}", measured, verdict)


def figures(reports: dict) -> Table:
    core = defaultdict(lambda: nan, core_us())
    python = defaultdict(lambda: nan, reports[OURS].get("figures", {}))
    figures = Figures("Bowstring: target and measured (three tendons, gravity and a tip force on)")
    row = figures.row
    row("core, Kirchhoff, cold", "<=", 15, core["cold_kirchhoff"], "us")
    row("core, Kirchhoff, warm sweep of 17", "<=", 10, core["warm17_kirchhoff"] / 17, "us/point")
    for start in ("cold", "warm17"):
        ratio = core[f"{start}_cosserat"] / core[f"{start}_kirchhoff"]
        row(f"core, Cosserat / Kirchhoff, {start}", "<=", 1.6, ratio)
    for theory in ("kirchhoff", "cosserat"):
        ratio = python[f"warm17_{theory}"] / core[f"warm17_{theory}"]
        row(f"Python sweep of 17 / core, {theory}", "<=", 1.2, ratio)
    for theory in ("kirchhoff", "cosserat"):
        row(f"one solve from Python, {theory}", "<=", 40, python[f"one_call_{theory}"], "us")
    row("batch on both cores, Kirchhoff", ">=", 600e3, 1e6 / python["batch_per_solve"], "solves/s")
    row("jax.vmap over 10 000 loads / batch", "<=", 2, python["jax_over_batch"])
    displaced, paths = python["displacement_per_solve"], python["friction_per_step"]
    row("displacement batch on both cores", ">=", 150e3, 1e6 / displaced, "solves/s")
    row("friction, 512 robots on both cores", ">=", 60e3, 1e6 / paths, "steps/s")
    row("inverse of a tip, cold, one call from Python", "<=", 300, python["inverse_cold"], "us")
    row("inverse along a path of 1000 tips", "<=", 100, python["inverse_on_path"], "us/tip")
    row("450 disks / 9 disks", "<=", 55, core["disks_450"] / core["disks_9"])
    for setting in ("cold, in one sweep call", "one call"):
        ratio = times_exudyn(reports, setting, equal_error=True)
        row(f"Exudyn at no larger tip error / ours ({setting})", ">=", 500, ratio)
        ratio = times_exudyn(reports, setting, equal_error=False)
        row(f"Exudyn at its fastest, at any error / ours ({setting})", "", nan, ratio)
    return figures.table


def ramp_figures(reports: dict) -> Table:
    """Targets of the motion, judged by `Run.wall_s`, the motion alone."""
    figures = Figures("Bowstring: target and measured (motion)")
    errors = {r.setting: r.error_mm for r in moved(reports[OURS])}
    times = reports[OURS].get("figures", {})
    for limit, target in ((0.1, 150), (0.3, 400)):
        reaching = [name for name in times if errors.get(name, nan) < limit]
        name = min(reaching, key=lambda name: times[name]["motion"], default="none")
        measured = defaultdict(lambda: nan, times.get(name, {}))
        speed = {kind: 1e3 * ramp.DURATION_S / measured[kind] for kind in ("motion", "call")}
        fast = f"tip error < {limit:g} mm ({name})"
        figures.row(f"{fast}", ">=", target, speed["motion"], "x real time")
        figures.row(f"{fast}, whole Python call", "", nan, speed["call"], "x real time")
        writing = measured["call_with_file"] - measured["call"]
        figures.row(f"writing all fields / motion ({name})", "<=", 1, writing / measured["motion"])
        peers = [r.time_ms for r in moved(reports["Exudyn"]) if r.error_mm <= limit]
        ratio = min(peers, default=nan) / measured["call"]
        figures.row(f"Exudyn / our whole call, tip error < {limit:g} mm", "", nan, ratio)
    core = defaultdict(lambda: nan, core_us())
    figures.row("core, one step of 2 ms", "", nan, core["step_9"], "us")
    figures.row("core, one step, 450 disks / 9 disks", "", nan, core["step_450"] / core["step_9"])
    return figures.table


def displacement_figures() -> Table:
    """Displacement control in the core, on one thread, relative to tension control."""
    figures = Figures("Bowstring: target and measured (displacement control, core)")
    core = defaultdict(lambda: nan, core_us())
    for case in CORE_CASES:
        by_tension = core[f"{case}_by_tension"]
        name = f"{case} ({readable(by_tension)} us)"
        for kind, what, target in (
            ("by_displacement", "by displacement / by tension", 3),
            ("by_tension_with_friction", "by tension with friction / without", 5),
            (
                "by_displacement_with_friction",
                "by displacement with friction / by tension without",
                5,
            ),
        ):
            figures.row(f"{name}: {what}", "<=", target, core[f"{case}_{kind}"] / by_tension)

    def grown(small: str, large: str) -> float:
        """Growth of the time of a solve by displacement, per module and tendon."""
        each = [core[f"{case}_by_displacement"] / prod(CORE_CASES[case]) for case in (small, large)]
        return each[1] / each[0]

    for large in ("3x10", "3x20"):
        name = f"by displacement, time / (modules x tendons), {large} against 1x10"
        figures.row(name, "<=", LINEAR, grown("1x10", large))
    figures.row(
        "by displacement, time / modules, 3x20 against 3x10", "", nan, grown("3x10", "3x20")
    )
    return figures.table


def run_all(modules: dict[str, str]) -> dict[str, dict]:
    reports = {}
    for solver, module in modules.items():
        with Console(stderr=True).status(f"running {solver}"):
            reports[solver] = run_solver(".venv" if solver == OURS else ".venv-peers", module)
    return reports


def print_versions(console: Console, reports: dict[str, dict], notes: str) -> None:
    versions = ", ".join(f"{k} {v['version']}" for k, v in reports.items() if "version" in v)
    console.print(f"{cpu_name()}; Python {platform.python_version()}; {versions}.\n{notes}")


def main() -> None:
    console = Console(width=max(Console().width, 120))
    fastest = f"A peer's rows are its fastest setting at each level of tip error: {LEVELS_MM} mm."

    reports = run_all({OURS: "ours", **{k: f"peers.{v}" for k, v in PEERS.items()}})
    console.print(comparison(reports))
    print_versions(
        console,
        reports,
        "One thread, except the batch; every solve from straight, except the warm sweep.\n"
        + fastest,
    )
    console.print(figures(reports))

    lengths = run_all(
        {OURS: "ours_displacement", **{k: f"peers.{v}" for k, v in DISPLACEMENT_PEERS.items()}}
    )
    console.print(displacement_comparison(lengths))
    print_versions(console, lengths, f"One thread. {displacement_notes(lengths[OURS])}\n{fastest}")
    console.print(displacement_figures())

    motions = run_all({OURS: "ours_ramp", **{k: f"peers.{v}" for k, v in RAMP_PEERS.items()}})
    against_converged(motions)
    console.print(ramp_comparison(motions))
    print_versions(console, motions, f"One thread. {published(motions[OURS])}\n{fastest}")
    console.print(ramp_figures(motions))

    file = ROOT / "target" / "bench.json"
    file.parent.mkdir(exist_ok=True)
    file.write_text(
        json.dumps(
            {
                "cpu": cpu_name(),
                "core_us": core_us(),
                "solvers": reports,
                "displacement": lengths,
                "ramp": motions,
            },
            indent=1,
        )
    )
    console.print(f"All cases and settings: {file.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
