"""Figures of the paper, from the program: `make paper-figures`.

Writes error.png, budget.png and verification.png beside this file and prints the numbers that
paper.md quotes. All are simulated. The references of the third figure are those of
tests/test_statics_rod.py (two independent codes) and, for the 3-D finite
elements, the table of docs/verification/finite-elements.md, whose page has its command.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import bowstring as bs
from bowstring.study.run import run_study
from bowstring.study.study import Study
from bowstring.viz.style import LIGHT, figure_style, legend_above, save, subplots

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from test_statics_rod import SWEEP  # noqa: E402

DPI = 200
MEANINGS = {
    "cc_from_lengths": ("from lengths", "blue", "o"),
    "cc_from_force": ("from force", "red", "s"),
}


def finite_elements() -> np.ndarray:
    """Tension in N, distance of the tips and its error bar in mm: sliding disks, extrapolated."""
    page = (ROOT / "docs" / "verification" / "finite-elements.md").read_text("utf-8")
    rows = re.findall(r"^\| (\d+) N \| \*\*([\d.]+) ± ([\d.]+)\*\* \|", page, re.M)
    return np.array(rows, dtype=float)


def error(study: Study) -> Figure:
    """Tip error of constant curvature against tension, with the tolerance and the corrections."""
    tension, limit = study.statics.tension, study.verdict.tolerance_length
    figure, (axes,) = subplots(1, 2.9)
    for name, (label, colour, mark) in MEANINGS.items():
        of = study.comparison(name)
        axes.plot(tension, 1e3 * of.error, color=LIGHT[colour], marker=mark, ms=4, label=label)
    corrected = study.comparison("cc_from_force_arm")
    axes.plot(tension, 1e3 * corrected.error, color=LIGHT["green"], ls="--", label="corrected")
    axes.axhline(1e3 * limit, color=LIGHT["muted"], lw=1, ls=":")
    axes.annotate("1 % of length", (1, 1e3 * limit), xytext=(0, 3), textcoords="offset points")
    axes.set(xlabel="tension of tendon 1 (N)", ylabel="tip error (mm), simulated")
    legend_above(axes, 3)
    return figure


def budget(study: Study) -> Figure:
    """What each effect, alone, changes in the mean error of constant curvature in this sweep."""
    rows = study.budget.rows
    figure, (axes,) = subplots(1, 3.6)
    place = np.arange(len(rows))[::-1]
    for k, (name, (label, colour, _)) in enumerate(MEANINGS.items()):
        changes = [1e3 * study.budget.contribution(r, "in_sweep", name).mean for r in rows]
        axes.barh(place + 0.2 - 0.4 * k, changes, 0.4, color=LIGHT[colour], label=label)
    axes.axvline(0, color=LIGHT["ink"], lw=0.8)
    axes.set_xscale("symlog", linthresh=0.01)
    axes.set_xticks([-1, 0, 1, 100], ["-1", "0", "1", "100"])
    axes.set_yticks(place, [r.label for r in rows])
    figure.supxlabel("change of mean tip error (mm), simulated", size="medium")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


def distances() -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Label and distances in mm between our tip and the independent one, and the stated errors."""
    robot = bs.load_robot("amouri2019")
    rows = SWEEP[1:]  # without load both are straight
    for theory, column in (("kirchhoff", 1), ("cosserat", 3)):
        for elements in (None, 4):
            model = bs.RodModel(theory=theory, elements=elements)
            found = [bs.solve(robot, [f, 0, 0], model=model) for f in rows[:, 0]]
            tips = 1e3 * np.array([each.tip.position for each in found])
            apart = np.linalg.norm(tips[:, [0, 2]] - rows[:, column : column + 2], axis=1)
            stated = 1e3 * np.array([each.error_estimate.tip for each in found])
            yield f"{theory.capitalize()} rod, {elements or 'default'} elements", apart, stated


def verification(study: Study, measured: list[tuple[str, np.ndarray, np.ndarray]]) -> Figure:
    """Distance of the tip from independent solutions, beside the error of constant curvature."""
    figure, (axes,) = subplots(1, 3.2)
    tension, wrong = study.statics.tension, study.comparison("cc_from_force").error
    axes.plot(tension[1:], 1e3 * wrong[1:], color=LIGHT["red"], marker="s", ms=3, label="CC, force")
    force, apart, bar = finite_elements().T
    axes.errorbar(force, apart, bar, color=LIGHT["ink"], fmt="D", ms=4, label="3-D FE")
    (_, default, stated), (_, fine, _) = measured[:2]  # Kirchhoff; Cosserat's lie on them
    loads = SWEEP[1:, 0]
    axes.plot(loads, stated, color=LIGHT["muted"], ls="--", label="stated error")
    axes.plot(loads, default, color=LIGHT["blue"], marker="o", ms=3, label="shooting")
    axes.plot(loads, fine, color=LIGHT["green"], marker="^", ms=3, label="shooting, 4 el.")
    axes.set_yscale("log")
    axes.set_ylim(1e-8)
    axes.set(xlabel="tension of tendon 1 (N)", ylabel="distance of tips (mm), simulated")
    legend_above(axes, 3)
    return figure


def main() -> None:
    """Draw and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder")
    out = parser.parse_args().out
    study, measured = run_study(bs.load_robot("amouri2019")), list(distances())
    with figure_style():
        for name, figure in (
            ("error", error(study)),
            ("budget", budget(study)),
            ("verification", verification(study, measured)),
        ):
            save(figure, out / f"{name}.png", DPI)
    for line in numbers(study, measured):
        print(line)


def numbers(study: Study, measured: list[tuple[str, np.ndarray, np.ndarray]]) -> Iterator[str]:
    """The numbers that the paper quotes, as it quotes them."""
    for name in (*MEANINGS, "cc_from_force_arm"):
        mean = 1e3 * study.comparison(name).mean
        yield f"{name}: {mean:.3g} mm on average, {100 * 1e-3 * mean / study.length:.2g} %"
    holds = next(m for m in study.verdict.meanings if m.name == "cc_from_force").valid_to
    yield f"cc_from_force holds to {holds:.1f} N"
    for row in study.budget.rows:
        changes = [1e3 * study.budget.contribution(row, "in_sweep", n).mean for n in MEANINGS]
        yield f"{row.label}: " + ", ".join(f"{c:.3g} mm" for c in changes)
    for label, apart, _ in measured:
        yield f"{label}: {apart.max():.2g} mm at most"


if __name__ == "__main__":
    main()
