"""Topics of a ROS bag in the format MCAP, as the columns of tables."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any, Final

from bowstring.errors import InputError, library_errors
from bowstring.optional import load_extra
from bowstring.units import quote

_MAGIC: Final = b"\x89MCAP"
_OTHERS: Final = {b"#ROSBAG": "ROS 1", b"SQLite format 3\0": "SQLite (.db3)"}
_MOST_BYTES: Final = 1_000_000_000  # of all chunks, unpacked
_MOST_FIXED: Final = 100_000  # entries of a message whose number its definition of ROS 1 fixes
_LONGEST: Final = 200  # entries of an array, more are those of an image or a scan
_MOST_COLUMNS: Final = 10_000
_NAME: Final = r"[A-Za-z]\w*"
#: Lines of a definition of ROS 1 that say what a message holds.
_FIELD: Final = re.compile(
    rf"(?:{_NAME}/)?{_NAME}(?:\[\d*\])? {_NAME}|MSG: {_NAME}/{_NAME}|=+", re.ASCII
)
_TIME: Final = "time"
_NAMES: Final = ("child_frame_id", "name")  # of the entries of an array of messages

Row = dict[str, str]


def is_bag(data: bytes) -> bool:
    """Whether a file with this content is a bag in the format MCAP."""
    return data.startswith(_MAGIC)


def other_bag(data: bytes) -> str:
    """Format of a bag that is not MCAP; empty for other files."""
    return next((name for begin, name in _OTHERS.items() if data.startswith(begin)), "")


def topics(path: Path, data: bytes) -> list[str]:
    """Topics whose first decoded message has numbers, in the order of the first messages.

    Raises
    ------
    InputError
        If the file cannot be read, or none of its messages.
    """
    found: dict[str, bool] = {}
    first: Exception | None = None
    with library_errors(f"{path}: this bag cannot be read", kind=True):
        for topic, _, decoded in _messages(path, data, None):
            if isinstance(decoded, Exception):
                first = first or decoded
            else:
                found[topic] = any(True for _ in _numbers(decoded, topic))
        if first is not None and not found:
            raise first
    return [topic for topic, has_numbers in found.items() if has_numbers]


def read_topic(path: Path, data: bytes, topic: str) -> tuple[dict[str, list[str]], list[str]]:
    """Read the numbers of the messages of a topic.

    Parameters
    ----------
    path : Path
        Path in messages.
    data : bytes
        Content of the file.
    topic : str

    Returns
    -------
    dict of str to list of str
        Cells by the name of the column: ``time`` in s, ``/topic.pose.position.x`` for a field, and
        ``/topic.data_1``, ``/topic.data_2`` and so on for an array; entries that have names, as
        those of joints and transforms, by these. Rows are in the order of time; a number that a
        message does not have is blank.
    list of str
        Sentences on what the time is, on messages that are left out, and on numbers of one name.

    Raises
    ------
    InputError
        If the file cannot be read, or the topic has no numbers.
    """
    rows: list[tuple[int, int | None, Row]] = []
    names: dict[str, None] = {}
    first, lost, twice = None, 0, dict[str, None]()
    with library_errors(f"{path}: this bag cannot be read", kind=True):
        for _, logged, decoded in _messages(path, data, topic):
            if isinstance(decoded, Exception):
                first, lost = first or decoded, lost + 1
                continue
            row: Row = {}
            for name, number in islice(_numbers(decoded, topic), _MOST_COLUMNS + 1):
                if name in row:
                    twice[name] = None
                row[name] = number
            rows.append((logged, _stamp(decoded), row))
            names |= dict.fromkeys(row)
            if len(names) > _MOST_COLUMNS:
                raise InputError(
                    f"{path}: the messages of {quote(topic)} have more than {_MOST_COLUMNS} "
                    "different numbers; a table has one column for each, name another topic"
                )
        if first is not None and not rows:
            raise first
    if not names:
        raise InputError(
            f"{path}: there are no numbers of a topic {quote(topic)}; topics with numbers: "
            f"{in_words(topics(path, data))}"
        )
    is_stamped = all(stamp is not None for _, stamp, _ in rows)
    times = [stamp if is_stamped and stamp is not None else logged for logged, stamp, _ in rows]
    order = sorted(range(len(rows)), key=lambda i: times[i])
    columns = {_TIME: [_seconds(times[i]) for i in order]}
    columns |= {name: [rows[i][2].get(name, "") for i in order] for name in names}
    what = "the stamp of its header" if is_stamped else "the time at which it was recorded"
    notes = [f"time of a message of {topic} is {what}"]
    if first is not None:
        why = " ".join(f"{type(first).__name__} {first}".split())[:200]
        whole = len(rows) + lost
        notes.append(
            f"{lost} of {whole} messages of {topic} cannot be decoded, and are left out: {why}"
        )
    if twice:
        notes.append(
            f"several numbers of a message have the same name, the last one is read: "
            f"{in_words(list(twice))}"
        )
    return columns, notes


def _messages(path: Path, data: bytes, topic: str | None) -> Iterator[tuple[str, int, Any]]:
    """Topic, time of recording (ns) and content of messages, or why it cannot be decoded.

    Without a topic those of each up to the first that can be. Encodings that are not read are left
    out.
    """
    reader = load_extra("rosbag", "mcap.reader").make_reader(io.BytesIO(data))
    decoders = [
        load_extra("rosbag", f"{module}.decoder").DecoderFactory()
        for module in ("mcap_ros2", "mcap_ros1")
    ]
    summary = reader.get_summary()
    if summary is None or (not summary.chunk_indexes and not summary.channels):
        raise InputError(
            f"{path}: the bag has no index, because its recording was interrupted; write it anew "
            "with mcap recover"
        )
    if sum(chunk.uncompressed_size for chunk in summary.chunk_indexes) > _MOST_BYTES:
        raise InputError(
            f"{path}: the bag would unpack to more than {_MOST_BYTES // 10**6} MB, and is not "
            "read; write the topics that are needed into a bag of their own, with mcap filter"
        )
    asked = [topic] if topic else list(dict.fromkeys(c.topic for c in summary.channels.values()))
    for each in asked:
        for schema, channel, message in reader.iter_messages(topics=[each]):
            try:
                decode = _decoder(path, decoders, channel.message_encoding, schema)
                content = None if decode is None else decode(message.data)
            except Exception as error:  # of any kind: a damaged message
                yield each, message.log_time, error
                continue
            if decode is not None:
                yield each, message.log_time, content
            if topic is None:
                break


def _decoder(
    path: Path, decoders: Sequence[Any], encoding: str, schema: Any
) -> Callable[[bytes], Any] | None:
    """Decoder of messages; None for an encoding that is not read, such as Protobuf."""
    if encoding == "json":
        return json.loads
    if getattr(schema, "encoding", None) == "ros1msg":
        schema = replace(schema, data=_fields_alone(path, schema).encode())
    return next(filter(None, (each.decoder_for(encoding, schema) for each in decoders)), None)


def _fields_alone(path: Path, schema: Any) -> str:
    """Definition of ROS 1 without comments and constants: its library runs code made of it.

    Raises
    ------
    InputError
        If other lines than fields remain, or arrays of fixed length are too long.
    """
    lines = (" ".join(line.split("#")[0].split()) for line in schema.data.decode().splitlines())
    fields = [line for line in lines if line and "=" not in line.strip("=")]
    for line in [f"MSG: {schema.name}", *fields]:
        if not _FIELD.fullmatch(line):
            raise InputError(
                f"{path}: this bag cannot be read: {quote(line[:60])} in the definition of "
                f"{quote(schema.name[:60])} is no field"
            )
    if _fixed_entries(schema.name, fields) > _MOST_FIXED:  # made even for a message without data
        raise InputError(
            f"{path}: this bag cannot be read: by its definition {quote(schema.name[:60])} has "
            f"arrays with more than {_MOST_FIXED} entries in all"
        )
    return "\n".join(fields)


def _fixed_entries(name: str, fields: Sequence[str]) -> int:
    """Number of entries of a message of ROS 1, arrays of any length being empty."""
    kinds: dict[str, list[str]] = {}
    message = name
    for line in fields:
        kind, *field = line.split()
        if kind == "MSG:":
            message = field[0]
        elif field:
            kinds.setdefault(message, []).append(kind)

    @cache
    def entries(message: str) -> int:
        count = 1
        for each in kinds.get(message, ()):
            kind, _, length = each.partition("[")
            times = int(length.rstrip("]") or 0) if length else 1
            package = message.partition("/")[0]
            count += times * entries(kind if "/" in kind else f"{package}/{kind}")
        return count

    return entries(name)


def _fields(value: Any) -> Mapping[str, Any]:
    """Fields of a message, which is a JSON object or one of the libraries."""
    if isinstance(value, dict):
        return value
    return {name: getattr(value, name) for name in getattr(value, "__slots__", ())}


def _numbers(value: Any, name: str) -> Iterator[tuple[str, str]]:
    """Names and numbers of a message, without those of headers."""
    if isinstance(value, bool):
        yield name, str(int(value))
    elif isinstance(value, (int, float)):
        yield name, str(value)
    elif isinstance(value, (list, tuple)):
        yield from _entries(value, name, range(1, len(value) + 1))
    elif not isinstance(value, (str, bytes)):
        fields = _fields(value)
        labels = fields.get("name")  # those of joints
        if not isinstance(labels, (list, tuple)) or len(set(map(str, labels))) < len(labels):
            labels = ()
        for key, each in fields.items():
            if isinstance(each, (list, tuple)) and len(each) == len(labels):
                yield from _entries(each, f"{name}.{key}", labels)
            elif key != "header":
                yield from _numbers(each, f"{name}.{key}")


def _entries(values: Sequence[Any], name: str, labels: Sequence[Any]) -> Iterator[tuple[str, str]]:
    """Names and numbers of the entries of an array, with the label of each."""
    if len(values) > _LONGEST:
        return
    for label, value in zip(labels, values, strict=True):
        fields = _fields(value)
        own = next((fields[key] for key in _NAMES if isinstance(fields.get(key), str)), label)
        yield from _numbers(value, f"{name}_{own}")


def _stamp(message: Any) -> int | None:
    """Time of a message's header, ns; None without one."""
    stamp = _fields(_fields(_fields(message).get("header")).get("stamp"))
    seconds = stamp.get("sec", stamp.get("secs"))
    parts = stamp.get("nanosec", stamp.get("nsecs", stamp.get("nsec", 0)))
    if not isinstance(seconds, int) or not isinstance(parts, int):
        return None
    return seconds * 10**9 + parts or None


def _seconds(nanoseconds: int) -> str:
    seconds, rest = divmod(abs(nanoseconds), 10**9)
    return f"{'-' * (nanoseconds < 0)}{seconds}.{rest:09d}"


def in_words(names: Sequence[str]) -> str:
    """List the first of some topics."""
    listed = ", ".join(map(quote, names[:12])) + (", ..." if len(names) > 12 else "")
    return listed or "none that can be read"
