"""Write results of finite elements: NetCDF, series for ParaView, three figures, JSON."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bowstring.aliases import Progress
from bowstring.fem.comparison import RodComparison
from bowstring.fem.figures import draw
from bowstring.fem.run import BrickRun
from bowstring.fem.vtk import write_vtk
from bowstring.files.atomic_io import write_whole
from bowstring.files.result_folder import check_folder, write_listing
from bowstring.viz.style import figure_style, save_figure, save_figures


def write(
    run: BrickRun,
    comparison: RodComparison,
    content: Mapping[str, Any],
    out: str | Path,
    *,
    progress: Progress | None = None,
) -> Path:
    """Write a run, whole or not at all.

    Parameters
    ----------
    run : BrickRun
    comparison : RodComparison
    content : dict
        Plain values for ``fe.json``, as ``bowstring fe --json`` prints.
    out : str or Path
        Folder; a former run in it is replaced as a whole after success.
    progress : callable, optional

    Returns
    -------
    Path
        Absolute path of the folder, with fe.json, fe.nc (fields of the rod's form from bricks),
        vtk/run.pvd (all bricks), tip.png, stress.png and field.png, also as PDF.
    """
    notify = progress or (lambda what, share: None)
    folder = check_folder(out, "fe")

    def fill(new: Path) -> None:
        run.to_dataset().to_netcdf(new / "fe.nc")
        write_vtk(run, new / "vtk", progress=notify)
        with figure_style():
            save_figures(
                draw(run, comparison),
                lambda stem, figure: save_figure(figure, new / stem),
                lambda share: notify("figures", share),
            )
        write_listing(new / "fe.json", content)

    write_whole(folder, "finite elements", fill, lambda: check_folder(folder, "fe"))
    return folder


def rows(run: BrickRun, comparison: RodComparison) -> list[dict[str, Any]]:
    """Make one entry for each load or time, for JSON; None where unknown."""

    def known(value: Any) -> Any:
        return value.tolist() if np.isfinite(value).all() else None

    frames = run.frames if run.states else None
    found = []
    for i in range(len(run.states)):
        assert frames is not None
        row = {
            "tensions_N": run.tensions[i].tolist(),
            "tip": {
                "position_m": frames.disk_position[i, -1].tolist(),
                "rotation": frames.disk_rotation[i, -1].tolist(),
            },
            "rod_tip_position_m": known(comparison.tip[i]),
            "difference_mm": known(1e3 * comparison.difference[i]),
            "span_tensions_N": [[known(v) for v in span] for span in frames.span_tension[i]],
            "middle_stress_Pa": comparison.middle[i].tolist(),
            "rod_middle_stress_Pa": known(comparison.rod_middle[i]),
            "edge_stress_Pa": comparison.edge[i].tolist(),
        }
        if run.is_motion:
            row["t_s"] = float(run.time[i])
        found.append(row)
    return found
