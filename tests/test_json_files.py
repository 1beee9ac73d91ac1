"""Structure of the JSON files that are read back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typing_extensions import NotRequired

from bowstring.files.json_files import Content, Row, Table, Triple, parsed, read_json, structured


class _Part(Content):
    force: Triple


class _Whole(Content):
    row: Row
    table: NotRequired[Table]
    parts: NotRequired[list[_Part]]
    count: NotRequired[int]


def test_arrays_and_keys_of_other_versions() -> None:
    found = structured({"row": [1, 2.5], "table": [], "new": [None]}, _Whole)
    np.testing.assert_array_equal(found["row"], [1.0, 2.5])
    assert found["table"].shape == (0, 0) and "new" not in found


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (5, "must be a valid dictionary"),
        ({}, "it has no row"),
        ({"row": 5}, "row must be a list of numbers"),
        ({"row": ["1"]}, "row must be a list of numbers"),
        ({"row": [True]}, "row must be a list of numbers"),
        ({"row": [10**400]}, "row must be finite numbers"),
        ({"row": [float("nan")]}, "row must be finite numbers"),
        ({"row": [[1]]}, "row must be a list of numbers"),
        ({"row": [], "table": [1]}, "table must be rows of numbers"),
        ({"row": [], "table": [[1], [1, 2]]}, "table must be rows of the same length"),
        ({"row": [], "table": [[10**400]]}, "table must be finite numbers"),
        ({"row": [], "parts": [{}]}, r"parts\[0\] has no force"),
        ({"row": [], "parts": [{"force": [1, 2]}]}, r"parts\[0\]\.force"),
        ({"row": [], "parts": [{"force": [1, 2, 10**400]}]}, r"parts\[0\]\.force\[2\]"),
        ({"row": [], "count": 1.0}, "count must be a valid integer"),
        ({"row": [], "count": True}, "count must be a valid integer"),
    ],
)
def test_another_structure_is_refused(content: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says) as error:
        structured(content, _Whole)
    assert "\n" not in str(error.value) and len(str(error.value)) < 200


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, '{"a": ' * 300, "1" * 10_000, b"\xff"])
def test_what_is_no_json(text: str | bytes) -> None:
    with pytest.raises(ValueError, match="it is no JSON"):
        parsed(text)


def test_a_file_is_an_object_of_limited_size(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_text("[1, 2]")
    with pytest.raises(ValueError, match="it is no object of JSON"):
        read_json(file, 100)
    with pytest.raises(ValueError, match="it is larger than 5e-06 MB"):
        read_json(file, 5)
