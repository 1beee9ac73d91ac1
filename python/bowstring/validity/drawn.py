"""Base of results over the workspace that are drawn in one figure."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from bowstring.results import Result
from bowstring.viz.style import write_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Drawn(Result, ABC):
    """Result with a figure that can be saved."""

    content: ClassVar[str]
    """The figure in words, for errors."""

    @abstractmethod
    def figure(self) -> Figure:
        """Draw the figure."""

    def save(self, path: str | Path) -> Path:
        """Write the figure to a file (PNG, PDF or SVG), whole or not at all.

        Parameters
        ----------
        path : str or Path
            An earlier figure is replaced.

        Returns
        -------
        Path
            Absolute path of the file.
        """
        return write_figure(self.figure, path, self.content)
