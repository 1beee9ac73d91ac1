"""Overrides: change single fields of a robot file by their path."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from bowstring.errors import InputError
from bowstring.robot.safe_yaml import read_yaml
from bowstring.robot.stiffness import mirrored
from bowstring.units import NUMBER, quote
from bowstring.validation import shown

# Setting one of a pair removes the other, so that an override works for either form of the file.
_EITHER: Final = {
    **{"G": "nu", "nu": "G", "count": "positions", "positions": "count"},
    **{"mass": "density", "density": "mass"},
}


def check_mapping(overrides: object) -> None:
    """Refuse overrides that are not a mapping."""
    if not isinstance(overrides, Mapping):
        raise InputError(
            f"overrides is {shown(overrides)}, it must be a mapping from path to value"
        )


def expand(tree: Any, path: str) -> list[str]:
    """Paths of a path in which ``*`` stands for every index of a list; none if none matches.

    A field of ``tendons`` without an index is that of all of them, as it is of a ring of tendons.
    """

    def walk(here: Any, keys: Sequence[str], above: str = "") -> Iterator[list[str]]:
        if not keys:
            yield []
            return
        key, *rest = keys
        if isinstance(here, list) and above == "tendons" and not (key == "*" or key.isdecimal()):
            items, rest = [(str(i), item) for i, item in enumerate(here)], list(keys)
        elif isinstance(here, list):
            items = [(str(i), item) for i, item in enumerate(here) if key in ("*", str(i))]
        else:
            below = here.get(key) if isinstance(here, dict) else None
            items = [] if key == "*" else [(key, below)]
        for name, item in items:
            yield from ([name, *end] for end in walk(item, rest, key))

    return [".".join(keys) for keys in walk(tree, _keys(path))]


def expand_all(tree: Any, overrides: Mapping[Any, Any]) -> dict[Any, Any]:
    """Expand every path with ``*``; of two values for a path the later holds."""
    found: dict[Any, Any] = {}
    for path, value in overrides.items():
        keys = _keys(path) if isinstance(path, str) else []
        paths = expand(tree, path) if "*" in keys or "tendons" in keys[:-1] else [path]
        if not paths and "*" not in keys:
            paths = [path]  # `override` says what is wrong with it
        if not paths:
            raise InputError(
                f"Override {quote(path)}: nothing matches; * stands for every index of a list, as "
                "in segments.*.length."
            )
        found.update(dict.fromkeys(paths, value))
    return found


def _keys(path: str) -> list[str]:
    return re.sub(r"\[([0-9]+|\*)\]", r".\1", path).split(".")


def fill(tree: Any, whole: Any, keys: Sequence[str]) -> None:
    """Copy the parts along a path that `tree` lacks from `whole`."""
    if len(keys) < 2:
        return
    key, *rest = keys
    if isinstance(tree, dict) and isinstance(whole, dict):
        if key not in tree and isinstance(whole.get(key), dict | list):
            tree[key] = whole[key]
        elif key in tree:
            fill(tree[key], whole.get(key), rest)
    elif isinstance(tree, list) and isinstance(whole, list):
        for i, (item, known) in enumerate(zip(tree, whole, strict=False)):
            if key == str(i):
                fill(item, known, rest)


def override(tree: dict[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Set the fields of ``overrides`` in ``tree`` (which changes) and return it."""
    overrides = _symmetric(expand_all(tree, overrides))
    for path, value in overrides.items():
        if not (isinstance(path, str) and path.isprintable() and len(path) <= 100):
            raise InputError(f'Override {quote(path)}: write it as "segments.0.length".')
        *parents, last = keys = _keys(path)
        if not all(keys):
            raise InputError(f'Override {quote(path)}: write it as "segments.0.length".')
        here: Any = tree
        for i, key in enumerate(parents):
            index = _step(here, key, keys[:i], path)
            here = here.setdefault(index, {}) if isinstance(here, dict) else here[index]
        index = _step(here, last, parents, path)
        if value is None:
            if isinstance(here, list):
                raise InputError(f"Override {path}: an entry of a list cannot be removed.")
            here.pop(index, None)
            continue
        here[index] = value if last in ("name", "description") else _read_override(value, path)
        other = _EITHER.get(last)
        also_set = f"{path.rpartition('.')[0]}.{other}" in overrides
        if other and isinstance(here, dict) and not also_set:
            here.pop(other, None)
    return tree


def _symmetric(overrides: dict[Any, Any]) -> dict[Any, Any]:
    """Add the mirrored entries of a stiffness matrix, so that one override keeps it symmetric."""
    out = dict(overrides)
    given = {".".join(_keys(path)) for path in overrides if isinstance(path, str)}
    for path, value in overrides.items():
        other = mirrored(".".join(_keys(path))) if isinstance(path, str) else None
        if other is not None and other not in given:
            out[other] = value
    return out


def _step(here: Any, key: str, above: list[str], path: str) -> Any:
    """Key or index of ``key`` in ``here``; the error lists the existing ones."""
    name = ".".join(above)
    if isinstance(here, dict):
        return key
    if not isinstance(here, list):
        raise InputError(f"Override {path}: {name} is a value, there is no {quote(key)} in it.")
    if re.fullmatch(r"[0-9]{1,6}", key, re.ASCII) and int(key) < len(here):
        return int(key)
    choice = f"{name}.0" + (f" to {name}.{len(here) - 1}" if len(here) > 1 else "")
    raise InputError(f"Override {path}: there is no {quote(key)} in {name}; write {choice}.")


def _read_override(value: Any, path: str) -> Any:
    """Read an override as in a file, except that a number without a unit is SI."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _read_override(item, path) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_read_override(item, path) for item in value]
    if not isinstance(value, str):
        return value
    text = value.strip()
    if text.startswith(("[", "{")):
        field = read_yaml(f"value: {text}", f"Override {path}").get("value")
        return _read_override(field, path)
    words = text.split()
    if words and all(len(w) <= 100 and re.fullmatch(NUMBER, w, re.ASCII) for w in words):
        numbers = [int(w) if re.fullmatch("[+-]?[0-9]{1,15}", w) else float(w) for w in words]
        return numbers if len(numbers) > 1 else numbers[0]
    return text
