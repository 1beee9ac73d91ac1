"""Result folders: check before replacing, JSON files, and a list of all files."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import Field
from typing_extensions import NotRequired

from bowstring.errors import InputError
from bowstring.files.atomic_io import check_whole_folder
from bowstring.files.json_files import Content, read_json, structured

_MOST_FILES: Final = 1_000_000
_MOST_BYTES: Final = 1_000_000_000
_CALLED: Final = {"fe": "finite elements"}  # name in messages, if not its own
_ENDINGS_OF_FILES: Final = [
    ".csv",
    ".html",
    ".json",
    ".nc",
    ".pdf",
    ".png",
    ".svg",
    ".yaml",
    ".yml",
]


class _Folder(Content):
    """Structure of what is read of the JSON file of a folder."""

    files: Annotated[list[str], Field(max_length=_MOST_FILES)]
    sha256: NotRequired[Annotated[dict[str, str], Field(max_length=_MOST_FILES)]]


def check_folder(out: str | Path, what: str = "study") -> Path:
    """Check before any work that results may be written to a folder.

    Parameters
    ----------
    out : str or Path
        The folder; it need not exist.
    what : str
        Kind of result: ``"study"``, ``"modes"``, ``"fit"`` or ``"fe"``; its JSON file lists the
        files that may be replaced.

    Returns
    -------
    Path
        The same folder, absolute, links resolved.

    Raises
    ------
    InputError
        If the folder exists and is no result of Bowstring, contains files that Bowstring did not
        write, or cannot be written.
    """
    called = _CALLED.get(what, what)
    if Path(out).suffix.lower() in _ENDINGS_OF_FILES and not Path(out).is_dir():
        raise InputError(
            f"cannot write the {called} to {out}: it is a folder, and this name has the ending of "
            "a file; leave the ending out"
        )

    def check_content(folder: Path, why: str) -> None:
        if next(_files_in(folder), None) is None:
            return
        listed = _listed(folder / f"{what}.json")
        if listed is None:  # before listing all files, which may be those of a whole drive
            raise InputError(
                f"{why}: it holds files but no {called} of Bowstring, and existing files are "
                "not overwritten; name a new or an empty folder"
            )
        cannot = f"cannot replace the {called} in {folder}"
        for file in sorted(_files_in(folder)):
            if file not in listed:
                raise InputError(
                    f"{cannot}: it also holds {file}, which Bowstring did not write; move that "
                    "away or name another folder"
                )
            digest = listed[file]
            if digest is not None and _sha256(folder / file) != digest:
                raise InputError(
                    f"{cannot}: {file} was changed since Bowstring wrote it; move that away or "
                    "name another folder"
                )

    return check_whole_folder(out, called, check_content)


def _files_in(folder: Path) -> Iterator[str]:
    """Yield relative paths of all files; raise `OSError` for an unreadable folder."""

    def give_up(error: OSError) -> None:
        raise error

    for place, folders, files in os.walk(folder, onerror=give_up):
        links = [name for name in folders if os.path.islink(os.path.join(place, name))]
        for name in (*files, *links):
            yield Path(place, name).relative_to(folder).as_posix()


def _listed(file: Path) -> dict[str, str | None] | None:
    """Read the files listed in a folder's JSON file, with their SHA-256 if given."""
    try:
        former = structured(read_json(file, _MOST_BYTES), _Folder)
    except (OSError, ValueError):
        return None
    return {name: former.get("sha256", {}).get(name) for name in former["files"]}


def _sha256(file: Path) -> str:
    if file.is_symlink() or not file.is_file():
        return "not a file"
    digest = hashlib.sha256()
    with file.open("rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def write_listing(file: Path, content: Mapping[str, Any]) -> None:
    """Write the JSON file of a folder: content, and a list of all files for `check_folder`."""
    written = sorted(_files_in(file.parent))
    hashes = {name: _sha256(file.parent / name) for name in written}
    files = sorted([*written, file.name])
    write_json(file, {**content, "files": files, "sha256": hashes})


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write indented JSON; NaN raises an error."""
    text = json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)
    # The json module does not escape DEL and later control characters, nor lone surrogates.
    text = re.sub("[\x7f-\x9f\ud800-\udfff]", lambda found: f"\\u{ord(found[0]):04x}", text)
    path.write_text(text + "\n", encoding="utf-8")
