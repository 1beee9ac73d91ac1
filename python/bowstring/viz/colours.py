"""Colours of all figures."""

from __future__ import annotations

from typing import Final

COLOURS: Final = {
    "ink": ("#1b1f24", "#e6e9ee"),
    "muted": ("#5d6673", "#a3adba"),
    "grid": ("#d5dae1", "#3a424d"),
    "paper": ("#ffffff", "#14181d"),
    "blue": ("#0072b2", "#56b4e9"),
    "red": ("#c94f00", "#ff8a3d"),
    "green": ("#007a5a", "#2fc79a"),
    "purple": ("#9c4c83", "#dc94c2"),
    "amber": ("#9a6a00", "#e8b44a"),
    "sky": ("#3fa9d6", "#9adcf5"),
    "yellow": ("#e3cf00", "#f0e442"),
}
"""Value of each colour on a light and on a dark background."""


def rgb(name: str) -> tuple[int, int, int]:
    """Red, green and blue of a colour on a light background, from 0 to 255."""
    text = COLOURS[name][0]
    return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16)
