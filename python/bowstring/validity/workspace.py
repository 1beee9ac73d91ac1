"""Errors of constant curvature over the workspace, under tension limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.display import short_repr
from bowstring.formatting import in_mm, in_percent, significant
from bowstring.robot.designs import Designs
from bowstring.robot.model import Robot, check_robot, with_tendons
from bowstring.statics import rod
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel
from bowstring.validation import choice, instance, number, share_of_length, whole
from bowstring.validity.errors import LABELS, LAWS, Ramps, tip_errors
from bowstring.viz.style import LIGHT, check_figure_file, subplots, write_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bowstring.schemas import maps as schema

__all__ = ["POSES", "WorkspaceMap", "check_workspace_file", "workspace_map"]

Floats = NDArray[np.float64]

POSES: Final = 4096
"""Number of poses by default."""
_PART: Final = 16384
_CELLS: Final = 30  # hexagons along an axis
_SHARES: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)  # of length


@short_repr
@dataclass(frozen=True)
class WorkspaceMap:
    """Errors of constant curvature at many poses of one robot; made by `workspace_map`."""

    robot: Robot
    """Robot, its friction left out."""
    tolerance: float
    """Tolerated tip error as a share of the length."""
    max_tension: float
    """Largest tension of a tendon, N."""
    tensions: Floats
    """Tensions of all tendons (P, T), N."""
    tip: Floats
    """Tips by statics (P, 3), m; NaN without a stable equilibrium."""
    error: dict[str, Floats]
    """Tip errors by model (P,), m; NaN without an arc."""

    def share_valid(self, name: str) -> float:
        """Share of the poses with an error at which a model holds the tolerance."""
        error = self.error[name]
        known = np.isfinite(error)
        if not known.any():
            return float("nan")
        return float((error[known] <= self.tolerance * self.robot.length).mean())

    def described(self) -> list[str]:
        """What the map says, in sentences."""
        solved = int(np.isfinite(self.tip[:, 0]).sum())
        out = [
            f"{solved} of {len(self.tip)} poses with at most {significant(self.max_tension)} N in "
            "each tendon have a stable equilibrium."
        ]
        for name, error in self.error.items():
            known = np.isfinite(error)
            if not known.any():
                out.append(f"Constant curvature {LABELS[name]} has no arc at any pose.")
                continue
            out.append(
                f"Constant curvature {LABELS[name]} holds to {in_percent(self.tolerance, 3)} of "
                f"length at {100.0 * self.share_valid(name):.0f} % of them; mean error "
                f"{in_mm(float(error[known].mean()))}, largest {in_mm(float(error[known].max()))}."
            )
        out.append("The figure shows the largest error of the poses in each hexagon.")
        return out

    def to_dict(self) -> schema.WorkspaceValues:
        """Return plain values in m, N and percent."""
        length = self.robot.length
        return {
            "tolerance_percent": 100.0 * self.tolerance,
            "max_tension_N": self.max_tension,
            "tip_position_m": self.tip.tolist(),
            "tensions_N": self.tensions.tolist(),
            "errors": [
                {
                    "name": name,
                    "error_percent": (100.0 * error / length).tolist(),
                    "valid_percent": 100.0 * self.share_valid(name),
                }
                for name, error in self.error.items()
            ],
        }

    def figure(self) -> Figure:
        """Draw the largest error by tip position.

        The workspace of one segment is a surface, seen from above; that of more is drawn by the
        distance from the base's axis and the height.

        Returns
        -------
        matplotlib.figure.Figure
            A panel for each model.
        """
        from matplotlib.colors import BoundaryNorm, ListedColormap

        names = list(self.error)
        figure, panels = subplots(len(names), 0.6 + 3.3 * len(names), sharex=True)
        x, y, z = 1e3 * self.tip.T
        surface = len(self.robot.segments) == 1
        along, up = (x, y) if surface else (np.hypot(x, y), z)
        bounds = sorted({0.0, *_SHARES, self.tolerance})
        within = bounds.index(self.tolerance)
        colours = ListedColormap(
            [*_shades("Blues_r", within), *_shades("Oranges", len(bounds) - within)]
        )
        norm: Any = BoundaryNorm([100.0 * b for b in bounds], colours.N, extend="max")
        for panel, name in zip(panels, names, strict=True):
            error = 100.0 * self.error[name] / self.robot.length
            known = np.isfinite(error)
            if known.any():
                cells = panel.hexbin(
                    along[known],
                    up[known],
                    error[known],
                    reduce_C_function=np.max,
                    gridsize=_CELLS,
                    norm=norm,
                    cmap=colours,
                    linewidths=0.1,
                )
                bar = figure.colorbar(cells, ax=panel, label="largest error (% of length)")
                bar.ax.axhline(100.0 * self.tolerance, color=LIGHT["ink"], lw=2.0)
            panel.set_title(f"constant curvature {LABELS[name]}")
            panel.set_ylabel("y of the tip (mm)" if surface else "z of the tip (mm)")
            panel.set_aspect("equal", adjustable="box")
            panel.margins(0.06)  # a hexagon reaches beyond its centre
        far = "distance of the tip from the base's axis (mm)"
        panels[-1].set_xlabel("x of the tip (mm)" if surface else far)
        title = f"{self.robot.name}: workspace to {significant(self.max_tension)} N (simulated)"
        figure.suptitle(title, fontsize=9.5, x=0.01, ha="left")
        return figure

    def save(self, path: str | Path) -> Path:
        """Write the figure to a file (PNG, PDF or SVG), whole or not at all.

        Parameters
        ----------
        path : str or Path
            A map of before is replaced.

        Returns
        -------
        Path
            Absolute path of the file.
        """
        return write_figure(self.figure, path, "map", 160, check_workspace_file)


def _shades(name: str, count: int) -> list[tuple[float, ...]]:
    """Colours of one of matplotlib's maps, without its palest ones."""
    from matplotlib import colormaps

    dark_first = name.endswith("_r")
    places = np.linspace(0.05, 0.65, count) if dark_first else np.linspace(0.35, 0.95, count)
    return [tuple(colormaps[name](place)) for place in places]


def check_workspace_file(path: str | Path) -> Path:
    """Check before any work that a figure of the workspace may be written.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Path
        Absolute path.
    """
    return check_figure_file(path, "map of the workspace", (".png", ".pdf", ".svg"))


def workspace_map(
    robot: Robot,
    max_tension: float,
    *,
    poses: int = POSES,
    tolerance: float | str = 0.01,
    models: Sequence[str] | None = None,
    load: Load | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> WorkspaceMap:
    """Compare constant curvature with statics over the workspace of a robot.

    Parameters
    ----------
    robot : Robot
        Its friction is left out.
    max_tension : float
        Largest tension of each tendon, N.
    poses : int
        Number of poses: points of a Sobol' sequence over the tensions of all tendons.
    tolerance : float or str
        Tolerated tip error as a share of the length: 0.01 or "1 %".
    models : sequence of str
        Models of constant curvature, of `bowstring.validity.errors.LAWS`.
    load : Load, optional
        Gravity (that of the robot if left out) and tip force.
    progress : callable, optional
        Called with a word and the finished share.

    Returns
    -------
    WorkspaceMap
        Tips and errors of all poses.

    Raises
    ------
    InputError
        If an argument is wrong.

    Examples
    --------
    >>> import bowstring as bs
    >>> found = bs.workspace_map(bs.load_robot("amouri2019"), 40.0, poses=256)
    >>> found.share_valid("cc_from_lengths")
    1.0
    """
    from scipy.stats import qmc

    check_robot(robot)
    number("max_tension", max_tension, "N")
    whole("poses", poses, 1, 1_000_000)
    tolerance = share_of_length("tolerance", tolerance)
    models = ("cc_from_lengths", "cc_from_force") if models is None else tuple(models)
    for name in models:
        choice("models", name, list(LAWS))
    load = instance("load", load, Load)
    robot = with_tendons(robot, {"friction": 0.0})
    count = len(robot.tendons.segment)
    points = qmc.Sobol(count, scramble=False).random_base2(max(1, (poses - 1).bit_length()))
    tensions = max_tension * points[:poses]
    tip = np.full((poses, 3), np.nan)
    error = {name: np.full(poses, np.nan) for name in models}
    for first in range(0, poses, _PART):
        rows = slice(first, first + _PART)
        found = rod.solve_batch(robot, tensions[rows], load=load, model=RodModel(), disks=False)
        here = len(found)
        ramps = Ramps(
            np.zeros((1, here)),
            tensions[rows][None],
            found.converged[None],
            found.tip_position[None],
            found.tendon_lengths[None],
            found.tip_error[None],
        )
        one = Designs(robot, {"segments.0.length": [robot.segments[0].length]})
        tip[rows] = found.tip_position
        for name, value in tip_errors(one, ramps, models).items():
            error[name][rows] = value[0]
        if progress is not None:
            progress("poses", min(1.0, (first + _PART) / poses))
    return WorkspaceMap(robot, tolerance, max_tension, tensions, tip, error)
