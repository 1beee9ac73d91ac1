"""Safe YAML reader: nested dicts, lists and text, without type guesses, aliases and tags."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import yaml

from bowstring.errors import InputError
from bowstring.files.atomic_io import readable
from bowstring.units import quote

_MAX_DEPTH: Final = 20
_MAX_BYTES: Final = 1_000_000


@contextmanager
def reading(label: str) -> Iterator[None]:
    """Context manager that turns an error of reading a file into an `InputError`."""
    try:
        yield
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        reason = getattr(error, "strerror", None) or "its name is not valid"
        raise InputError(f"{label} cannot be read: {reason}.") from None


def text_of(path: Path, label: str, what: str) -> str:
    """Read the text of a small file, inside `reading`; `what` names its kind in the error."""
    with readable(path) as file:
        data = file.read(_MAX_BYTES + 1)
    if len(data) > _MAX_BYTES:
        raise InputError(f"{label} is too large; a {what} file has at most 1 MB.")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise InputError(f"{label}, line {line}: not UTF-8 text; save the file as UTF-8.") from None


def read_yaml(
    text: str, label: str, what: str = "robot", field: str = "segments"
) -> dict[str, Any]:
    """Read YAML as nested dicts, lists and text; each field converts its own text.

    YAML therefore never guesses types (yes, 017, 1:30, 1e3). Anchors, aliases and tags, which can
    expand a file or run code, are refused. `what` and `field` name the file's kind and its main
    field in errors.
    """
    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    try:
        tree = _Tree(label, what).read(yaml.parse(text, Loader=loader))
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        what = f"not valid YAML ({error.problem})"
        if mark and text.splitlines()[mark.line : mark.line + 1]:
            line = text.splitlines()[mark.line]
            if "\t" in line[: len(line) - len(line.lstrip())]:
                what = "the line begins with a tab; indent with spaces"
        raise InputError(f"{label}{place}: {what}.") from None
    except yaml.YAMLError as error:
        reason = getattr(error, "reason", "not readable")
        raise InputError(f"{label}: not valid YAML ({reason}).") from None
    if tree in (None, ""):
        raise InputError(f"{label} is empty; a {what} file has at least '{field}'.")
    if not isinstance(tree, dict):
        raise InputError(f"{label}: got {quote(tree)}; must be fields such as '{field}: ...'.")
    return tree


class _Tree:
    """Builder of the tree from YAML's events, each checked before it is used."""

    def __init__(self, label: str, what: str) -> None:
        self.label, self.what = label, what

    def fail(self, event: yaml.Event, sentence: str) -> InputError:
        mark = event.start_mark
        place = f", line {mark.line + 1}" if mark else ""
        return InputError(f"{self.label}{place}: {sentence}.")

    def read(self, events: Iterator[yaml.Event]) -> Any:
        tree: Any = None
        documents = 0
        for event in events:
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise self.fail(event, f"a second document starts; give one {self.what} a file")
            elif isinstance(event, yaml.NodeEvent):
                tree = self.node(event, events, 0)
        return tree

    def node(self, event: yaml.Event, events: Iterator[yaml.Event], depth: int) -> Any:
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise self.fail(event, "anchors and aliases (& and *) are not allowed; write it out")
        if getattr(event, "tag", None) not in (None, "!"):
            raise self.fail(event, "tags (!) are not allowed; write plain text")
        if depth > _MAX_DEPTH:
            raise self.fail(event, f"nested deeper than {_MAX_DEPTH} levels")
        if isinstance(event, yaml.ScalarEvent):
            return event.value
        if isinstance(event, yaml.SequenceStartEvent):
            items = []
            while not isinstance(event := next(events), yaml.SequenceEndEvent):
                items.append(self.node(event, events, depth + 1))
            return items
        fields: dict[str, Any] = {}
        while not isinstance(event := next(events), yaml.MappingEndEvent):
            key = self.node(event, events, depth + 1)
            if not isinstance(key, str):
                raise self.fail(event, "a field's name must be plain text")
            if key in fields:
                raise self.fail(event, f"the field {quote(key)} is given twice")
            fields[key] = self.node(next(events), events, depth + 1)
        return fields
