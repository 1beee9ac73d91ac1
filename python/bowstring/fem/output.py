"""Output of CalculiX: tables of a .dat file, increments of a .sta file.

Only whole lines are read, because the program may be running or have been killed.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from bowstring.aliases import Floats

_HEAD: Final = re.compile(rb"^ ([a-z ]+) \(.*?\) for set (\S+) and time +(\S+)\s*$", re.MULTILINE)


class Table(NamedTuple):
    """Table with kind (such as ``"displacements"``), set, time and rows.

    ``rows`` begin with the number of a node, or of an element and its integration point; the
    numbers of a set follow the order of the model's own file. ``end`` is the byte after it.
    """

    kind: str
    set: str
    time: float
    rows: Floats
    end: int


class Increment(NamedTuple):
    """Line of the .sta file: step, attempts and iterations, time in the step and total time."""

    step: int
    attempts: int
    iterations: int
    total_time: float
    step_time: float


def read_dat(file: Path, start: int = 0) -> list[Table]:
    """Read the tables of a .dat file from a byte on; the last one may lack rows.

    Parameters
    ----------
    file : Path
    start : int
        Offset from a previous call.
    """
    try:
        with file.open("rb") as stream:
            stream.seek(start)
            text = stream.read()
    except FileNotFoundError:
        return []
    text = text[: text.rfind(b"\n") + 1]
    heads = list(_HEAD.finditer(text))
    ends = [head.start() for head in heads][1:] + [len(text)][: len(heads)]
    found = []
    for head, end in zip(heads, ends, strict=True):
        body = text[head.end() : end].split(b"\n")
        lines = [line.split() for line in body if line.strip()]
        width = len(lines[0]) if lines else 0
        whole = [line for line in lines if len(line) == width]
        rows = np.array(whole, dtype=float).reshape(len(whole), width)
        kind, name, time = head[1].decode(), head[2].decode(), float(head[3])
        found.append(Table(kind, name, time, rows, start + end))
    return found


def read_increments(file: Path) -> list[Increment]:
    """Read the converged increments of a .sta file."""
    try:
        lines = file.read_text("ascii", errors="replace").split("\n")
    except FileNotFoundError:
        return []
    found = []
    for line in lines[:-1]:  # the last one may be incomplete
        words = line.split()
        # 1U in place of 1: an attempt that did not converge
        if len(words) == 7 and all(w.isdigit() for w in words[:4]):
            step, _, attempts, iterations = map(int, words[:4])
            found.append(Increment(step, attempts, iterations, float(words[4]), float(words[5])))
    return found


def reason(output: str) -> str:
    """Errors on CalculiX's standard output, in one line; empty if none."""
    lines = output.split("\n")
    found = []
    for i, line in enumerate(lines):
        if "*ERROR" in line:
            text = line.split("*ERROR", 1)[1].lstrip(" :")
            more = lines[i + 1].strip() if i + 1 < len(lines) else ""
            found.append(" ".join(f"{text} {more}".split()))
    return "; ".join(dict.fromkeys(found))[:300]
