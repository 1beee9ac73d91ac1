"""Format numbers for sentences, tables and JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

_ROUND: Final = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
_DASH: Final = "\N{EN DASH}"
_MINUS: Final = "\N{MINUS SIGN}"


# -- in sentences ------------------------------------------------------------------------------


def significant(value: float, digits: int = 3) -> str:
    """Round to a few significant digits; write large numbers without an exponent."""
    rounded = float(f"{value:.{digits}g}")  # 999.6 is 1000, not 1e+03
    return f"{value:.0f}" if abs(rounded) >= 10.0**digits else f"{value:.{digits}g}"


def in_mm(metres: float) -> str:
    """Write a length in mm with three significant digits, not finer than a micrometre."""
    mm = metres * 1e3
    if not math.isfinite(mm):
        return "no number"
    if abs(mm) < 1e-3:
        return "under 0.001 mm"
    return f"{significant(mm)} mm" if abs(mm) >= 0.1 else f"{mm:.3f} mm"


def with_error(value: float, error: float) -> str:
    """Write a value with its standard error, which has two significant digits."""
    digits = max(0, 1 - math.floor(math.log10(error))) if 0.0 < error < math.inf else 99
    if digits > 9 or abs(value) >= 1e9:
        return f"{value:.5g} +- {error:.2g}"
    return f"{value:.{digits}f} +- {error:.{digits}f}"


def in_percent(share: float, digits: int = 2) -> str:
    """Write a share in percent, by default with two significant digits."""
    return f"{significant(share * 100.0, digits)} %"


def in_newtons(a: float, b: float) -> str:
    """Write a range of force, or one force if both ends agree."""
    return f"{significant(a)} N" if a == b else f"{significant(a)} to {significant(b)} N"


def listed(parts: Sequence[str], word: str = "and") -> str:
    """Join parts of a sentence with commas, and with a word before the last."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {word} {parts[-1]}"


def round_down(value: float) -> float:
    """Round down to 1, 1.2, 1.5, ... times a power of ten."""
    power = math.floor(math.log10(value))
    # Decimal text, because 8 * 10.0**-3 is not the float 0.008.
    candidates = (float(f"{m}e{p}") for p in (power - 1, power) for m in _ROUND)
    return max(c for c in candidates if c <= value * (1 + 1e-12))


# -- in tables ---------------------------------------------------------------------------------


def number(value: float | None, digits: int = 3) -> str:
    """Write a number with fixed decimals; a dash for None."""
    if value is None or not math.isfinite(value):
        return _DASH
    if 1e-6 < abs(value) < 0.5 * 10.0**-digits:  # smaller values are rounded zeros
        return f"< {10.0**-digits:.{digits}f}"
    return signed(value, digits).removeprefix("+")


def signed(value: float | None, digits: int = 2) -> str:
    """Write a change: `number` with its sign."""
    if value is None or not math.isfinite(value):
        return _DASH
    text = f"{value:+.{digits}f}"
    return text[1:] if float(text) == 0.0 else text.replace("-", _MINUS)


# -- in JSON ------------------------------------------------------------------------------------


def plain(value: Any) -> Any:
    """Convert a value for JSON: arrays become lists, non-finite numbers become None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):  # NumPy takes long to import
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
