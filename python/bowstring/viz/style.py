"""Style and common functions of all figures.

Figures are narrow, so that their text is readable on a phone. Colours are those of Okabe and Ito,
which colour-blind readers can distinguish; markers and line styles differ too. In SVG every colour
becomes a CSS variable, so that a page can switch between a light and a dark theme.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bowstring import interrupts
from bowstring.errors import BowstringError, FigureWarning
from bowstring.files.atomic_io import check_file, write_whole_file
from bowstring.processes import for_each
from bowstring.viz.colours import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

__all__ = [
    "AXES",
    "LIGHT",
    "MARKS",
    "TINY",
    "WIDTH",
    "check_figure_file",
    "figure_style",
    "legend_above",
    "log_ticks",
    "not_drawn",
    "save",
    "save_figure",
    "save_figures",
    "subplots",
    "svg",
    "title_above",
    "write_figure",
]

LIGHT: Final = {name: light for name, (light, _) in COLOURS.items()}
"""Colours of a light page by name."""
WIDTH: Final = 4.6  # inches
TINY: Final = 1e-6  # m; lower end of logarithmic axes
AXES: Final = (("x", "blue", "o"), ("y", "green", "^"), ("z", "red", "s"))
"""Name, colour and marker of each coordinate."""
MARKS: Final = {
    ".png": b"Software\0Bowstring",
    ".pdf": b"/Creator (Bowstring)",
    ".svg": b"<dc:title>Bowstring</dc:title>",
}
"""Bytes by suffix that `save` writes to a file, to identify our files."""
_DPI: Final = 160
_RAISED: Final = str.maketrans(
    "-0123456789",
    "\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT ZERO}\N{SUPERSCRIPT ONE}\N{SUPERSCRIPT TWO}"
    "\N{SUPERSCRIPT THREE}\N{SUPERSCRIPT FOUR}\N{SUPERSCRIPT FIVE}\N{SUPERSCRIPT SIX}"
    "\N{SUPERSCRIPT SEVEN}\N{SUPERSCRIPT EIGHT}\N{SUPERSCRIPT NINE}",
)
_ABOUT: Final[dict[str, dict[str, Any]]] = {
    ".png": {"Software": "Bowstring"},
    ".pdf": {"Creator": "Bowstring", "CreationDate": None},
    ".svg": {"Creator": "Bowstring", "Date": None},
}


@contextmanager
def figure_style() -> Iterator[None]:
    """Context manager of the style of figures, for drawing and saving them."""
    import matplotlib as mpl

    ink, muted, grid = LIGHT["ink"], LIGHT["muted"], LIGHT["grid"]
    with mpl.rc_context(
        {
            "font.size": 9.0,
            "axes.titlesize": 9.5,
            "axes.titlelocation": "left",
            "axes.labelsize": 9.0,
            "legend.fontsize": 8.5,
            "legend.frameon": False,
            "xtick.labelsize": 8.5,
            "ytick.labelsize": 8.5,
            "text.color": ink,
            "axes.labelcolor": ink,
            "axes.titlecolor": ink,
            "axes.edgecolor": muted,
            "xtick.color": muted,
            "ytick.color": muted,
            "xtick.labelcolor": ink,
            "ytick.labelcolor": ink,
            "grid.color": grid,
            "grid.linewidth": 0.6,
            "axes.grid": True,
            "axes.axisbelow": True,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "lines.linewidth": 1.6,
            "lines.markersize": 4.5,
            "svg.fonttype": "none",
            "svg.hashsalt": "bowstring",
            "pdf.fonttype": 42,  # TrueType; IEEE refuses Type 3 fonts
            # names in files are no formulas; `log_ticks` writes powers of ten without one
            "text.parse_math": False,
            "text.usetex": False,
            # the figure's own layout alone
            "figure.autolayout": False,
            "figure.constrained_layout.use": False,
        }
    ):
        yield


def save(figure: Figure, file: Path, dpi: float) -> None:
    """Save a figure as PNG, PDF or SVG by the suffix, without a date and with our mark."""
    figure.savefig(file, dpi=dpi, metadata=_ABOUT[file.suffix.lower()])


def check_figure_file(
    path: str | Path, content: str, suffixes: Sequence[str] = tuple(MARKS)
) -> Path:
    """Check before any work that a figure may be written (`atomic_io.check_file`)."""
    file = Path(path)
    return check_file(file, content, suffixes, MARKS.get(file.suffix.lower(), b""))


def write_figure(
    draw: Callable[[], Figure],
    path: str | Path,
    content: str,
    dpi: float = _DPI,
    suffixes: Sequence[str] = tuple(MARKS),
) -> Path:
    """Draw a figure and write it, whole or not at all; return the absolute path of its file.

    `content` names it in errors; `suffixes` are allowed.
    """
    file = check_figure_file(path, content, suffixes)
    with figure_style():
        figure = draw()
        write_whole_file(
            file,
            content,
            lambda new: save(figure, new, dpi),
            lambda: check_figure_file(file, content, suffixes),
        )
    return file


def not_drawn(name: str, error: Exception) -> None:
    """Warn that a figure cannot be drawn, where results beside it are written all the same."""
    if isinstance(error, (BowstringError, OSError, MemoryError)) or interrupts.is_interrupt(error):
        raise error
    why = " ".join(f"{type(error).__name__}: {error}".split())
    warnings.warn(
        f"{name} is left out, as drawing it failed ({why}); all else is complete. This is a bug in "
        "Bowstring; please report it.",
        FigureWarning,
        stacklevel=2,
    )


def save_figures(
    drawings: Iterable[tuple[str, Callable[[], Figure]]],
    save: Callable[[str, Figure], None],
    notify: Callable[[float], None],
) -> list[str]:
    """Draw and save figures; return the stems of those that did not fail.

    Parameters
    ----------
    drawings : iterable of tuple
        Stem of each figure, and a function that draws it.
    save : callable
        Called with a stem and its figure, in another process where this is possible.
    notify : callable
        Progress callback, called with the finished share from 0 to 1.

    Warns
    -----
    FigureWarning
        If a figure cannot be drawn or saved.
    """
    made: list[tuple[str, Figure]] = []
    for stem, draw in drawings:
        try:
            made.append((stem, draw()))
        except Exception as error:
            not_drawn(f"figure {stem}", error)
    saved = [stem for stem, _ in made]

    def fails(each: tuple[str, Figure], error: Exception) -> None:
        not_drawn(f"figure {each[0]}", error)
        saved.remove(each[0])

    for_each(made, lambda each: save(*each), notify=notify, failed=fails)
    return saved


def save_figure(figure: Figure, path: Path, suffixes: Sequence[str] = (".png", ".pdf")) -> None:
    """Save a figure in each format; `path` has no suffix."""
    _lay_out(figure)
    for suffix in suffixes:
        save(figure, Path(f"{path}{suffix}"), _DPI)


def _lay_out(figure: Figure) -> None:
    """Lay a figure out for all file formats; else each one would draw it twice."""
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)
        figure.set_layout_engine()


def svg(stem: str, figure: Figure) -> str:
    """Convert a figure to an SVG element for an HTML page.

    Parameters
    ----------
    stem : str
        Prefix of all ids, so that figures do not clash on one page.
    figure : matplotlib.figure.Figure

    Returns
    -------
    str
        ``<svg ...>``, its colours as ``var(--ink, #1b1f24)`` and so on, no background.
    """
    _lay_out(figure)
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\bid="', f'id="{stem}-', text)
    text = re.sub(r'href="#', f'href="#{stem}-', text)
    text = re.sub(r"url\(#", f"url(#{stem}-", text)
    for name, light in LIGHT.items():
        text = text.replace(light, f"var(--{name}, {light})")
    # matplotlib's default marker edge and text colours are black
    text = re.sub(r"(stroke|fill): #000000", r"\1: var(--ink)", text)
    return re.sub(r'<svg [^>]*viewBox="([^"]*)"[^>]*>', r'<svg viewBox="\1">', text, count=1)


def subplots(rows: int, height: float, **options: Any) -> tuple[Figure, list[Axes]]:
    """Make panels below each other with a total height in inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = figure.subplots(rows, 1, squeeze=False, **options)
    return figure, list(axes[:, 0])


def log_ticks(axis: Axis) -> None:
    """Label a logarithmic axis with powers of ten as plain text, for `figure_style`."""
    from matplotlib.ticker import LogFormatterSciNotation

    class Powers(LogFormatterSciNotation):
        def __call__(self, x: float, pos: int | None = None) -> str:
            text = str(super().__call__(x, pos))
            text = re.sub(r"\^\{(.*?)\}", lambda found: found[1].translate(_RAISED), text)
            text = text.replace(r"\times", "\N{MULTIPLICATION SIGN}")
            return re.sub(r"\$|\\mathdefault|[{}]", "", text)

    axis.set_major_formatter(Powers())
    axis.set_minor_formatter(Powers(labelOnlyBase=False))


def title_above(figure: Figure, text: str) -> None:
    """Write the title of a figure at its upper left corner."""
    figure.suptitle(text, fontsize=9.5, x=0.01, ha="left")


def legend_above(axes: Axes, columns: int) -> None:
    """Place the legend above the axes, where it covers nothing."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        handlelength=1.8,
        columnspacing=1.2,
    )
