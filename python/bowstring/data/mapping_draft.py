"""Draft of a mapping file with the probable meaning of a table's columns.

Comments mark guesses, which the user has to check. The draft is always a valid mapping.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Final

from bowstring.data.motive import FRAME, TIME
from bowstring.data.tables import Table
from bowstring.units import quote

__all__ = ["draft"]

_KINDS: Final = {
    "mass": ("mass", "load", "weight"),
    "tension": ("tension", "force", "kraft", "newton"),
    "displacement": (
        "displacement",
        "pull",
        "disp",
        "servo",
        "motor",
        "tendon",
        "cable",
        "spool",
        "wire",
    ),
}
_UNITS: Final = {
    "mass": ("kg", "g", "mg"),
    "tension": ("N", "mN", "kN", "kgf", "lbf"),
    "displacement": ("mm", "cm", "m", "um", "inch"),
}
_LENGTHS: Final = _UNITS["displacement"]
_ANGLES: Final = {"bend": ("bend", "theta", "angle"), "direction": ("direction", "phi", "plane")}
_TIMES: Final = ("s", "ms", "us", "min")
_TIME_WORDS: Final = ("time", "timestamp", "t", "zeit", "sec", "seconds")
_MOST_COLUMNS: Final = 24


def draft(table: Table, tendons: int | None = None) -> str:
    """Write a mapping file for a table.

    Parameters
    ----------
    table : Table
        Table with its header.
    tendons : int, optional
        Number of the robot's tendons; missing columns are filled with zeros (no tension).

    Returns
    -------
    str
        YAML with comments at lines to be checked.
    """
    columns = [name for name in table.header if name and _can_be_named(name)]
    lines = ["source: measured        # measured, synthetic or computed"]
    header = table.form.header == "first"
    form = [] if header else ["header: none"]
    form += ["separator: blanks"] if table.form.separator == "blanks" else []
    if form:
        names = "" if header else "   # or names: [t, force, x, y, z], one a column"
        lines.append(f"table: {{{', '.join(form)}}}{names}")
    left = [name for name in columns if name not in (FRAME, TIME)] if table.length_unit else columns
    time = next(
        (name for name in left if _words(name)[:1] and _words(name)[0] in _TIME_WORDS), None
    )
    left = [name for name in left if name != time]
    quaternion = _quaternion(left)
    tip = _tip([name for name in left if name not in quaternion])
    if not tip:
        left = [name for name in left if name not in quaternion]
    left = [name for name in left if name not in tip]
    angles = {} if tip or quaternion else _angles(left)
    left = [name for name in left if name not in angles.values()]
    known = bool(tip or angles or quaternion)
    quantity, found = _commands(left, known) if not table.length_unit else ("tension", [])
    if not table.length_unit and not known:  # without hints: commands first, then the tip
        free = [name for name in left if name not in found]
        tip = tuple(free[-3:])
        left = [name for name in left if name not in tip]
    if not table.length_unit and not found:
        found = left[: tendons or 3]
    lines += _tendon_lines(quantity, found, left, tendons, bool(table.length_unit))
    if angles:
        fields = ", ".join(f"{field}: {_text(name)}" for field, name in angles.items())
        unit = _unit_in(angles["bend"], ("deg", "rad")) or "deg"
        lines.append(f"angles: {{{fields}, unit: {unit}}}   # and of what tips there are: tip")
    elif quaternion and not tip:
        cells = ", ".join(map(_text, quaternion))
        lines.append(f"angles: {{quaternion: [{cells}]}}   # w, x, y and z")
    else:
        lines += _tip_lines(tip, table, left)
    if time is not None:
        unit = _unit_in(time, _TIMES) or "s"
        lines.append(f"time: {{column: {_text(time)}, unit: {unit}}}   # unit: iso for dates")
    if table.length_unit:
        lines += [
            "frame: {axes: [z, x, y]}   # the measuring frame's x, y and z in the file's axes",
            "join:                      # the log of the tendons' actuation, by time",
            "  file: forces.csv         # beside the export",
            "  time: {column: time, unit: s}",
            "  shift: 0 s               # added to its times",
        ]
    unused = [name for name in left if name not in found]
    if unused:
        shown = ", ".join(_text(name) for name in unused[:_MOST_COLUMNS])
        lines.append(f"# other columns: {shown}{', ...' if len(unused) > _MOST_COLUMNS else ''}")
    return "\n".join(lines) + "\n"


def _tendon_lines(
    quantity: str, found: list[str], left: Sequence[str], tendons: int | None, is_motive: bool
) -> list[str]:
    # for a Motive export they are in the joined log
    named = [f"tension_{i}" for i in range(1, 1 + (tendons or 3))] if is_motive else list(found)
    if not named and not left:
        return []
    if tendons is not None:
        named = (named + ["0"] * tendons)[:tendons]
    cells = ", ".join(_text(name) if name != "0" else "0" for name in named or ["0"])
    unit = next((u for u in (_unit_in(name, _UNITS[quantity]) for name in found) if u), None)
    return [
        "tendons:",
        f"  quantity: {quantity:<10}   # mass, tension or displacement",
        f"  unit: {unit or _UNITS[quantity][0]:<14}   # or a scale, such as 0.1 N",
        f"  columns: [{cells}]   # in the order of the robot's tendons; 0: no load",
    ]


def _tip_lines(tip: Sequence[str], table: Table, left: Sequence[str]) -> list[str]:
    if table.length_unit:
        mark = " Position X"
        bodies = [name.removesuffix(mark) for name in table.header if name.endswith(mark)]
        named = [body for body in bodies if _can_be_named(body)]
        if named:
            best = next((b for b in named if "tip" in b.lower()), named[-1])
            others = ", ".join(map(quote, named[:12]))
            return [f"tip: {{name: {_text(best)}}}   # of {others}"]
    unit = next((u for u in (_unit_in(name, _LENGTHS) for name in tip) if u), "mm")
    named = list(tip or left[-1:])  # with few columns a single one
    cells = ", ".join([_text(name) for name in named] + ["0"] * (3 - len(named)))
    return [f"tip: {{columns: [{cells}], unit: {unit}}}   # of x, y and z"]


def _can_be_named(name: str) -> bool:
    return name.isprintable() and len(name) <= 200 and name.lower() not in ("", "~", "null")


def _text(name: str) -> str:
    return json.dumps(name, ensure_ascii=False)


def _words(name: str) -> list[str]:
    return re.findall(r"[a-z]+", name.lower())


def _unit_in(name: str, units: Sequence[str]) -> str | None:
    """Unit in brackets or at the end of a name."""
    match = re.search(r"[\[(]\s*([A-Za-z]+)\s*[\])]", name) or re.search(r"_([A-Za-z]+)$", name)
    return match[1] if match and match[1] in units else None


def _tip(names: Sequence[str]) -> tuple[str, ...]:
    """Three columns whose names differ only in x, y and z, preferably with "tip"."""
    sets = []
    for name in names:
        for match in re.finditer(r"(?<![A-Za-z])[xX](?![A-Za-z])", name):
            others = [
                name[: match.start()] + letter + name[match.end() :]
                for letter in ("yz" if match[0] == "x" else "YZ")
            ]
            if all(other in names for other in others):
                sets.append((name, *others))
    return next((s for s in sets if "tip" in s[0].lower()), sets[-1] if sets else ())


def _quaternion(names: Sequence[str]) -> tuple[str, ...]:
    """Four columns whose names differ only in w, x, y and z."""
    for name in names:
        for match in re.finditer(r"[wW](?![A-Za-z])", name):
            letters = "wxyz" if match[0] == "w" else "WXYZ"
            found = [name[: match.start()] + each + name[match.end() :] for each in letters]
            if all(each in names for each in found):
                return tuple(found)
    return ()


def _is_coordinate(name: str) -> bool:
    return re.search(r"(?<![A-Za-z])[xyzXYZ](?![A-Za-z])", name) is not None


def _angles(names: Sequence[str]) -> dict[str, str]:
    """Columns of angle and direction of bending; empty without the former."""
    found = {}
    for field, words in _ANGLES.items():
        name = next((n for n in names if any(w.startswith(words) for w in _words(n))), None)
        if name is not None:
            found[field] = name
    return found if "bend" in found else {}


def _commands(names: Sequence[str], known: bool) -> tuple[str, list[str]]:
    """Quantity of the tendons' commands, and its columns.

    Lengths may be displacements if the columns of the tip are `known`.
    """
    for kind, words in _KINDS.items():
        found = [name for name in names if any(w.startswith(words) for w in _words(name))]
        if found:
            units = [k for k in _UNITS if any(_unit_in(name, _UNITS[k]) for name in found)]
            return (kind if kind in units or not units else units[0]), found
    for kind, units_of in _UNITS.items():
        found = [name for name in names if _unit_in(name, units_of) and not _is_coordinate(name)]
        if found and (kind != "displacement" or known):
            return kind, found
    return "tension", []
