"""Numbers as people read them, in sentences and tables, and as JSON holds them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

__all__ = [
    "in_mm",
    "in_newtons",
    "in_percent",
    "listed",
    "number",
    "plain",
    "round_down",
    "signed",
    "significant",
    "with_error",
]

_ROUND: Final = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
_DASH: Final = "\N{EN DASH}"
_MINUS: Final = "\N{MINUS SIGN}"


# -- in sentences ------------------------------------------------------------------------------


def significant(value: float, digits: int = 3) -> str:
    """A few significant digits, large numbers without an exponent."""
    rounded = float(f"{value:.{digits}g}")  # 999.6 is 1000, not 1e+03
    return f"{value:.0f}" if abs(rounded) >= 10.0**digits else f"{value:.{digits}g}"


def in_mm(metres: float) -> str:
    """Three significant digits of mm, nothing finer than a micrometre."""
    mm = metres * 1e3
    if not math.isfinite(mm):
        return "no number"
    if abs(mm) < 1e-3:
        return "under 0.001 mm"
    return f"{significant(mm)} mm" if abs(mm) >= 0.1 else f"{mm:.3f} mm"


def with_error(value: float, error: float) -> str:
    """A value to the last digit that its standard error has, of which two are told."""
    digits = max(0, 1 - math.floor(math.log10(error))) if 0.0 < error < math.inf else 99
    if digits > 9 or abs(value) >= 1e9:
        return f"{value:.5g} +- {error:.2g}"
    return f"{value:.{digits}f} +- {error:.{digits}f}"


def in_percent(share: float, digits: int = 2) -> str:
    """Percent, to two significant digits if not said otherwise."""
    return f"{significant(share * 100.0, digits)} %"


def in_newtons(a: float, b: float) -> str:
    """A range of force, or one."""
    return f"{significant(a)} N" if a == b else f"{significant(a)} to {significant(b)} N"


def listed(parts: Sequence[str], word: str = "and") -> str:
    """Parts of a sentence: with commas, and "and" or another word before the last."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {word} {parts[-1]}"


def round_down(value: float) -> float:
    """Largest of 1, 1.2, 1.5, ... times a power of ten that is not above the value."""
    power = math.floor(math.log10(value))
    # through decimal text: 8 * 10.0**-3 is not the float 0.008
    candidates = (float(f"{m}e{p}") for p in (power - 1, power) for m in _ROUND)
    return max(c for c in candidates if c <= value * (1 + 1e-12))


# -- in tables ---------------------------------------------------------------------------------


def number(value: float | None, digits: int = 3) -> str:
    """Fixed digits after the point; a dash where there is no number."""
    if value is None or not math.isfinite(value):
        return _DASH
    if 1e-6 < abs(value) < 0.5 * 10.0**-digits:  # below is rounding of exact zeros
        return f"< {10.0**-digits:.{digits}f}"
    return signed(value, digits).removeprefix("+")


def signed(value: float | None, digits: int = 2) -> str:
    """As `number`, but with its sign, for changes."""
    if value is None or not math.isfinite(value):
        return _DASH
    text = f"{value:+.{digits}f}"
    return text[1:] if float(text) == 0.0 else text.replace("-", _MINUS)


# -- in JSON ------------------------------------------------------------------------------------


def plain(value: Any) -> Any:
    """What JSON can hold: lists for arrays, null for what is not a finite number."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):  # of numpy, which takes long to import
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
