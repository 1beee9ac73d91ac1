"""Result folder of `bowstring fit --out`."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bowstring.aliases import Progress
from bowstring.calibration.model_comparison import (
    ComparisonInterrupted,
    JudgedModel,
    ModelComparison,
)
from bowstring.calibration.observations import Score
from bowstring.calibration.residual import Residual
from bowstring.calibration.residual_file import RESIDUAL, residual_to_dict
from bowstring.calibration.table_fit import BESIDE, Calibration
from bowstring.errors import InputError
from bowstring.files.atomic_io import write_whole
from bowstring.files.result_folder import check_folder, write_json, write_listing
from bowstring.robot.writer import to_yaml
from bowstring.viz.style import figure_style, save_figure, save_figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MODELS: Final = "models.csv"
_ERROR_PARTS: Final = "error_parts"
_SCORES = ("fitted", "left_out", "validation")


def write_fit(
    calibration: Calibration,
    content: Mapping[str, Any],
    out: str | Path,
    *,
    residual: Residual | None = None,
    comparison: ModelComparison | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write a calibration: calibrated robot file, all numbers, two figures.

    Parameters
    ----------
    calibration : Calibration
    content : dict
        Plain values for ``fit.json``, as ``bowstring fit --json`` prints.
    out : str or Path
        Folder; a former fit in it is replaced as a whole after success.
    residual : Residual, optional
        Residual of the calibration, for ``residual.json``.
    comparison : ModelComparison, optional
        Comparison of models, for ``models.csv`` and ``error_parts``.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    Path
        Absolute path of the folder, with robot.yaml, calibration.json (parameters that are not part
        of a robot file), residual.json where given, fit.json, and residuals and parity as PNG and
        PDF; of a comparison models.csv, and error_parts as SVG too.

    Raises
    ------
    InputError
        If the folder cannot be written (see `check_folder`).
    """
    from bowstring.calibration.figures import draw_fit, draw_parts

    notify = progress or (lambda what, share: None)
    folder = check_folder(out, "fit")
    found, data = calibration.fit, calibration.data
    hashed = "" if data.sha256 is None else f", SHA-256 {data.sha256}"
    lines = [
        *[f"In doubt: {each}" for each in calibration.doubts],
        f"Calibrated by Bowstring ({found.model}) on {data.source} data: {data.name}{hashed}",
        found.message,
        *[f"Not part of a robot file: {each}" for each in calibration.elsewhere],
        *([f"{BESIDE} has these for bowstring fit --start"] if calibration.elsewhere else []),
    ]

    def fill(new: Path) -> None:
        robot = to_yaml(found.robot, "\n".join(" ".join(line.split()) for line in lines))
        (new / "robot.yaml").write_text(robot, encoding="utf-8")
        write_json(new / BESIDE, calibration.beside_to_dict())
        drawings = list(draw_fit(calibration))
        if residual is not None:
            write_json(new / RESIDUAL, residual_to_dict(residual))
        if comparison is not None:
            _write_models(new / _MODELS, model_rows(comparison.models, comparison.chosen))
            label = f"{data.source}: {data.name}"[:60]
            drawings.append((_ERROR_PARTS, partial(draw_parts, comparison, label)))

        def save(stem: str, figure: Figure) -> None:
            also = (".svg",) if stem == _ERROR_PARTS else ()
            save_figure(figure, new / stem, (".png", ".pdf", *also))

        with figure_style():
            save_figures(drawings, save, lambda share: notify("figures", share))
        write_listing(new / "fit.json", content)

    write_whole(folder, "fit", fill, lambda: check_folder(folder, "fit"))
    notify("done", 1.0)
    return folder


def write_stopped(stopped: ComparisonInterrupted, content: Mapping[str, Any], out: Path) -> Path:
    """Write the finished models of a stopped comparison: ``models.csv`` and ``fit.json``.

    Parameters
    ----------
    stopped : ComparisonInterrupted
    content : dict
        Plain values for ``fit.json``.
    out : Path
        Folder.

    Returns
    -------
    Path
        Absolute path of the folder.

    Raises
    ------
    InputError
        If the folder cannot be written, or has a complete fit, which stays.
    """
    folder = check_folder(out, "fit")
    if (folder / "robot.yaml").exists():
        raise InputError(f"{folder} has a complete fit, which stays")

    def fill(new: Path) -> None:
        _write_models(new / _MODELS, model_rows(stopped.models))
        write_listing(new / "fit.json", content)

    write_whole(folder, "fit", fill, lambda: check_folder(folder, "fit"))
    return folder


def _write_models(path: Path, rows: Sequence[Sequence[str]]) -> None:
    """Write the models of a comparison as CSV; missing numbers are empty fields."""
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


def model_rows(models: Sequence[JudgedModel], choice: JudgedModel | None = None) -> list[list[str]]:
    """Header and rows of a table of compared models; cells without a number are empty.

    No row is chosen without a choice, of a part of the models.
    """
    columns = [f"{name}_{number}_mm" for name in _SCORES for number in ("rmse", "mean")]
    rows = [["model", "parameters", "rows", *columns, "chosen", "reason"]]
    for each in models:
        numbers = [cell for name in _SCORES for cell in _cells(getattr(each, name))]
        count = "" if each.left_out is None else str(each.left_out.count)
        chosen = "" if choice is None else "yes" if each is choice else "no"
        rows.append([each.name, " ".join(each.parameters), count, *numbers, chosen, each.reason])
    return rows


def _cells(score: Score | None) -> tuple[str, str]:
    """RMSE and mean in mm."""
    return ("", "") if score is None else (f"{1e3 * score.rmse:.9g}", f"{1e3 * score.mean:.9g}")
