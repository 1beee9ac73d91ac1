"""Damage to files: bytes, words, lines and numbers, from a seed."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from random import Random
from typing import Final

__all__ = ["damage"]

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
