"""Result folder of `bowstring modes --out`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bowstring.aliases import Progress
from bowstring.dynamics.modal import Modes
from bowstring.files.atomic_io import write_whole
from bowstring.files.result_folder import check_folder, write_listing
from bowstring.viz.style import figure_style, save_figure, save_figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_modes(
    modes: Modes, content: Mapping[str, Any], out: str | Path, *, progress: Progress | None = None
) -> Path:
    """Write pictures of mode shapes.

    Parameters
    ----------
    modes : Modes
    content : dict
        Plain values for ``modes.json``, as ``bowstring modes --json`` prints.
    out : str or Path
        Folder; former modes in it are replaced as a whole after success.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    Path
        Absolute path of the folder, with modes.json and each mode as PNG, PDF and SVG.

    Raises
    ------
    InputError
        If the folder cannot be written (see `check_folder`).
    """
    from bowstring.viz.modes import draw_modes

    notify = progress or (lambda what, share: None)
    folder = check_folder(out, "modes")

    def fill(new: Path) -> None:
        def save(stem: str, figure: Figure) -> None:
            save_figure(figure, new / stem)
            figure.savefig(new / f"{stem}.svg", metadata={"Date": None, "Creator": "Bowstring"})

        with figure_style():
            save_figures(draw_modes(modes), save, lambda share: notify("pictures", share))
        write_listing(new / "modes.json", content)

    write_whole(folder, "modes", fill, lambda: check_folder(folder, "modes"))
    notify("done", 1.0)
    return folder
