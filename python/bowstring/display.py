"""Short representations of objects: one line of text, a small table in a notebook."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any, Final, TypeVar

import numpy as np

Class = TypeVar("Class", bound=type)

_LONGEST: Final = 60  # characters of a value
_MOST: Final = 4  # largest array that is shown in full
_MOST_ROWS: Final = 10


def short_repr(cls: Class) -> Class:
    """Give a dataclass a one-line repr that shows long arrays and values by their size.

    Use it as a decorator above that of the dataclass.
    """

    def text(self: Any) -> str:
        shown = (f"{f.name}={_brief(getattr(self, f.name))}" for f in fields(self) if f.repr)
        return f"{type(self).__name__}({', '.join(shown)})"

    setattr(cls, "__repr__", text)  # noqa: B010
    return cls


def _brief(value: object) -> str:
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, np.ndarray):
        if value.size <= _MOST and value.ndim == 1:
            form = "{:.6g}" if value.dtype.kind == "f" else "{}"
            return f"[{', '.join(form.format(item) for item in value)}]"
        return f"array {value.shape}"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, str):
        return repr(value if len(value) <= _LONGEST else value[: _LONGEST - 3] + "...")
    if isinstance(value, (Mapping, Sequence)) and not hasattr(value, "_fields"):
        text = repr(value) if len(value) <= _MOST else ""
        many = f"{type(value).__name__} of {len(value)}"
        return text if text and len(text) <= _LONGEST and "array" not in text else many
    text = repr(value)
    return text if len(text) <= _LONGEST and "\n" not in text else f"<{type(value).__name__}>"


def html_table(title: str, rows: Iterable[Sequence[object]], header: Sequence[str] = ()) -> str:
    """Write a table for a notebook.

    Parameters
    ----------
    title : str
        Caption.
    rows : iterable of sequence
        Cells, converted by `str`; the first cell of a row is its name.
    header : sequence of str
        Names of the columns.

    Returns
    -------
    str
        HTML with all cells escaped.
    """
    head = "".join(f"<th>{html.escape(str(cell))}</th>" for cell in header)
    body = "".join(
        "<tr>"
        + f"<th>{html.escape(str(row[0]))}</th>"
        + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in row[1:])
        + "</tr>"
        for row in rows
    )
    return (
        f"<table><caption>{html.escape(title)}</caption>"
        + (f"<thead><tr>{head}</tr></thead>" if head else "")
        + f"<tbody>{body}</tbody></table>"
    )


def sampled_rows(count: int, row: Callable[[int], Sequence[object]]) -> list[Sequence[object]]:
    """Sample the rows of a long table: the first, some between, the last."""
    return [row(k) for k in some(count, _MOST_ROWS)]


def some(count: int, most: int) -> list[int]:
    """Choose at most so many of the numbers from 0, evenly, the first and the last among them."""
    shown = np.linspace(0, count - 1, min(count, most)).round().astype(int)
    return np.unique(shown).tolist() if count else []


def millimetres(point: object) -> str:
    """Write lengths given in m as text in mm."""
    values = 1e3 * np.asarray(point, dtype=float).ravel()
    return ", ".join(f"{v:.3f}" for v in values) + " mm"
