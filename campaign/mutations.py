"""Damage to files: bytes, words, lines, numbers and structures, from a seed."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from copy import deepcopy
from random import Random
from typing import Any, Final

__all__ = ["damage", "rescale", "reshape"]

_WORDS: Final = (0, 1, 2, 3, 4, 255, 256, 65535, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1)
_NUMBERS: Final = (
    *(b"0", b"-0", b"-1", b"1e-320", b"1e308", b"1e400", b"-1e400", b"nan", b"inf", b"0x10"),
    *(b"999999999999999999999", b"1,5", b"1_000", b"1.5.2", b"--3", b"1e", b"", b" ", b"true"),
    *(b"3 mm", b"3 furlong", b"3 N m", b"3 %", b"1e5 Pa", b"~", b"null", b"*a", b"&a 1", b"!!x 1"),
)
_TOKENS: Final = (
    *(b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\x1b[31m", b"\r", b"\n", b"\t", b'"', b"'", b"#"),
    *(b"{", b"}", b"[", b"]", b": ", b"- ", b",", b";", b"|", b"\xe2\x80\xae", b"<<: *x", b"%"),
    *(b"\xf0\x9f\x8e\xbb", b"\x80", b"(" * 200, b"[" * 500, b"9" * 400, b"a" * 5000),
)
_NUMBER: Final = re.compile(rb"[-+]?[0-9]+(?:\.[0-9]*)?(?:[eE][-+]?[0-9]+)?")


def damage(data: bytes, random: Random, corpus: Sequence[bytes]) -> bytes:
    """A file with one to five kinds of damage.

    Parameters
    ----------
    data : bytes
    random : random.Random
    corpus : sequence of bytes
        Files of the same kind, parts of which may be inserted.

    Returns
    -------
    bytes
    """
    for _ in range(random.choice((1, 1, 1, 2, 2, 3, 5))):
        data = random.choice(_DAMAGES)(data, random, corpus)
    return data


def _place(data: bytes, random: Random) -> int:
    """Returns a random position; half of them are near the beginning, where headers are."""
    near = min(len(data), 2048) if random.random() < 0.5 else len(data)
    return random.randrange(near + 1) if near else 0


def _bit(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    if not data:
        return data
    i = min(_place(data, random), len(data) - 1)
    return data[:i] + bytes([data[i] ^ 1 << random.randrange(8)]) + data[i + 1 :]


def _byte(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    i = _place(data, random)
    return (
        data[:i]
        + bytes([random.choice((0, 1, 127, 128, 255, random.randrange(256)))])
        + (data[i + 1 :])
    )


def _word(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    size = random.choice((2, 4, 4, 8))
    i = _place(data, random) // size * size if random.random() < 0.7 else _place(data, random)
    value = random.choice((*_WORDS, random.getrandbits(16))) % 2 ** (8 * size)
    order = random.choice(("big", "little"))
    return data[:i] + value.to_bytes(size, order) + data[i + size :]  # type: ignore[arg-type]


def _number(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    found = list(_NUMBER.finditer(data[:100_000]))
    if not found:
        return data
    one = random.choice(found)
    return data[: one.start()] + random.choice(_NUMBERS) + data[one.end() :]


def _token(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    i = _place(data, random)
    return data[:i] + random.choice(_TOKENS) + data[i:]


def _cut(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    return data[: _place(data, random)]


def _removed(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    i = _place(data, random)
    return data[:i] + data[i + random.choice((1, 1, 2, 4, 16, 256)) :]


def _doubled(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    i = _place(data, random)
    part = data[i : i + random.choice((1, 4, 16, 256, 4096))]
    return data[:i] + part * random.choice((2, 2, 10)) + data[i + len(part) :]


def _lines(data: bytes, random: Random, _: Sequence[bytes]) -> bytes:
    """A line removed, doubled, moved or indented."""
    lines = data.splitlines(keepends=True)
    if not 1 < len(lines) < 50_000:
        return data
    i = random.randrange(len(lines))
    line = lines.pop(i)
    many = {"away": [], "twice": [line, line], "in": [b"  " + line], "out": [line.lstrip()]}
    deed = random.choice((*many, "moved"))
    if deed == "moved":
        lines.insert(random.randrange(len(lines)), line)
    else:
        lines[i:i] = many[deed]
    return b"".join(lines)


def _spliced(data: bytes, random: Random, corpus: Sequence[bytes]) -> bytes:
    other = random.choice(corpus)
    i, j = _place(data, random), _place(other, random)
    return data[:i] + other[j : j + random.choice((4, 64, 1024, 10**6))] + data[i:]


_DAMAGES: Final[tuple[Callable[[bytes, Random, Sequence[bytes]], bytes], ...]] = (
    *(_bit, _byte, _byte, _word, _word, _number, _number, _token, _cut, _removed, _doubled),
    *(_lines, _lines, _spliced),
)


# -- structures --------------------------------------------------------------------------------

#: Texts of JSON that Python does not write, which stand for a number or a list.
_RAW: Final = {
    "@huge": "1" + "0" * 400,
    "@long": "9" * 5000,
    "@overflow": "1e400",
    "@nan": "NaN",
    "@deep": "[" * 5000 + "]" * 5000,
    "@levels": "[" * 30 + "1" + "]" * 30,
}
_VALUES: Final = (
    *(None, True, False, 0, 1, -1, 5, 2**31, -(2**63), 0.5, -0.0, 1e308, -1e308, 5e-324, 1e-9),
    *("", "x", "1", "1e5", "nan", "\x1b[31m", "a" * 5000, [], {}, [0], [[0.0]], [[]], {"a": 1}),
    *_RAW,
)


def reshape(data: bytes, random: Random, *, yaml: bool = False) -> bytes:
    """A file of JSON or YAML with one to three changes of its structure.

    Values of another type, huge numbers, deep nesting, lists for numbers, keys and items dropped,
    added, renamed, repeated and exchanged.
    """
    if yaml:
        from yaml import BaseLoader, load, safe_dump

        tree = load(data, BaseLoader)
    else:
        tree = json.loads(data)
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        tree = _reshaped(tree, random)
    if yaml:
        text = safe_dump(tree, sort_keys=False, allow_unicode=True)
        for key in ("@deep", "@huge", "@levels", "@long", "@nan", "@overflow"):
            text = text.replace(f"'{key}'", _RAW[key])
        return text.encode()
    text = json.dumps(tree)
    for key, raw in _RAW.items():
        text = text.replace(f'"{key}"', raw)
    return text.encode()


def _reshaped(tree: Any, random: Random) -> Any:
    """Changes a node that is reached by a random walk from the root."""
    holder: list[Any] = [tree]
    above: Any = holder
    key: Any = 0
    while (inner := above[key]) and isinstance(inner, (dict, list)) and random.random() < 0.85:
        above = inner
        key = random.choice([*inner]) if isinstance(inner, dict) else random.randrange(len(inner))
    value = above[key]
    kind = random.choice(("value", "value", "value", "wrap", "drop", "add", "repeat", "other"))
    if kind == "value":
        above[key] = deepcopy(random.choice(_VALUES))
    elif kind == "wrap":
        single = isinstance(value, list) and value and random.random() < 0.5
        above[key] = value[0] if single else random.choice(([value], {"a": value}, [[value]]))
    elif kind == "drop":
        del above[key]
    elif kind == "add" and isinstance(value, dict):
        value[random.choice(("x", "", "a.b", "1", *value))] = deepcopy(random.choice(_VALUES))
    elif kind == "add" and isinstance(value, list):
        value.insert(random.randrange(len(value) + 1), deepcopy(random.choice(_VALUES)))
    elif kind == "repeat" and isinstance(value, list):
        above[key] = value * random.choice((2, 3, 50))
    elif isinstance(above, dict):  # renamed
        above[random.choice(("x", key + "s", key.upper(), *above))] = above.pop(key)
    else:  # exchanged
        other = random.randrange(len(above))
        above[key], above[other] = above[other], value
    return holder[0] if holder else None


def rescale(data: bytes, random: Random) -> bytes:
    """A file of JSON with one to five of its numbers multiplied by powers of ten or negated."""
    tree = json.loads(data)
    for _ in range(random.choice((1, 1, 2, 3, 5))):
        above: Any = tree
        while True:
            keys = [*above] if isinstance(above, dict) else [*range(len(above))]
            if not keys:
                break
            key = random.choice(keys)
            value = above[key]
            if isinstance(value, (dict, list)):
                above = value
                continue
            if isinstance(value, float):
                sign = random.choice((1.0, 1.0, 1.0, -1.0))
                above[key] = sign * (value or 1.0) * 10.0 ** random.randint(-15, 15)
            break
    return json.dumps(tree).encode()
