"""Arrays and container of a binary glTF 2.0 file."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

#: Numbers of an array by the standard's code of their type.
COMPONENTS: Final[Mapping[int, np.dtype[Any]]] = {
    5126: np.dtype("<f4"),
    5125: np.dtype("<u4"),
    5123: np.dtype("<u2"),
}
_CODES: Final = {kind: code for code, kind in COMPONENTS.items()}
_KINDS: Final = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
#: The standard's codes of what an array is used for.
VERTICES: Final = 34962
INDICES: Final = 34963


class GltfArrays:
    """Arrays of a file in one buffer.

    Attributes
    ----------
    data : bytearray
        The buffer.
    """

    def __init__(self) -> None:
        self.data = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []

    def add(
        self, values: NDArray[Any], *, limits: bool = False, target: int | None = VERTICES
    ) -> int:
        """Append an array (n,) or (n, k) of a type in `COMPONENTS`, and return its accessor.

        `limits` adds its smallest and largest numbers; `target` is `VERTICES`, `INDICES`, or None
        for neither.
        """
        self.data += b"\0" * (-len(self.data) % 4)
        table = np.ascontiguousarray(values).reshape(len(values), -1)
        raw = table.tobytes()
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(raw)}
        if target is not None:
            view["target"] = target
        self.data += raw
        accessor: dict[str, Any] = {
            "bufferView": len(self._views),
            "componentType": _CODES[values.dtype],
            "count": len(table),
            "type": _KINDS[table.shape[1]],
        }
        if limits:
            accessor |= {"min": table.min(axis=0).tolist(), "max": table.max(axis=0).tolist()}
        self._views.append(view)
        self._accessors.append(accessor)
        return len(self._accessors) - 1

    def content(self) -> dict[str, Any]:
        """Entries of the file's JSON."""
        return {
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": len(self.data)}],
        }


def glb(content: dict[str, Any], data: bytes | bytearray) -> bytes:
    """Binary file: a header, JSON, then the data, each of whole words."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False).encode("utf-8")
    chunks = b""
    for kind, part, fill in ((b"JSON", text, b" "), (b"BIN\0", bytes(data), b"\0")):
        part += fill * (-len(part) % 4)
        chunks += struct.pack("<I4s", len(part), kind) + part
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
