"""Read built-in robots and robot files; JSON Schema of a file."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any, Final

from bowstring.errors import InputError
from bowstring.robot.messages import build, build_changed
from bowstring.robot.model import Robot
from bowstring.robot.overrides import check_mapping, override
from bowstring.robot.safe_yaml import read_yaml, reading, text_of
from bowstring.units import printable, quote
from bowstring.validation import shown

_BUILT_IN: Final = Path(__file__).with_name("builtin")


def robot_names() -> list[str]:
    """Return the names of the built-in robots.

    Returns
    -------
    list of str
        Sorted names, each accepted by `load_robot`.
    """
    return sorted(path.stem for path in _BUILT_IN.glob("*.yaml"))


def robot_schema() -> dict[str, Any]:
    """Return the JSON Schema of a robot file, for completion and checks in an editor.

    Returns
    -------
    dict
        JSON Schema (draft 2020-12) of fields, types and the form of units; only `load_robot`
        checks consistency between fields.
    """
    schema = Robot.model_json_schema()
    for part in (schema, *schema["$defs"].values()):
        part["description"] = part["description"].partition("\n")[0]  # docstrings' first line
        for field in part["properties"].values():
            field.pop("default", None)  # defaults are SI numbers, which a file cannot have
            field.pop("title", None)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def load_robot(source: str | Path, overrides: Mapping[str, Any] | None = None) -> Robot:
    """Load a built-in robot or a robot file.

    Parameters
    ----------
    source : str or Path
        Name of a built-in robot (see `robot_names`) or path of a YAML file.
    overrides : mapping from path to value, optional
        Changed fields, as for `Robot.with_`.

    Returns
    -------
    Robot
        Checked robot; `Robot.warnings` lists implausible numbers.

    Raises
    ------
    InputError
        If there is no such robot or the file is not valid; the message lists all problems.

    Examples
    --------
    >>> robot = load_robot("amouri2019", {"segments.0.disks.clamped_length": "3 mm"})
    >>> robot.length
    0.641
    """
    if not isinstance(source, (str, Path)):
        raise InputError(f"robot is {shown(source)}, it must be a built-in robot's name or a path")
    check_mapping(overrides or {})
    names = robot_names()
    if str(source) in names:
        path, label = _BUILT_IN / f"{source}.yaml", str(source)
    else:
        path, label = Path(source), str(source)
    if len(label) > 200 or not label.isprintable():
        label = f"Robot file {quote(label)}"
    tree = read_yaml(_read_text(path, label, names), label)
    tree.setdefault("name", name_of(path))

    def make(changes: Mapping[str, Any]) -> Robot:
        return build(Robot, override(deepcopy(tree), changes), label)

    return build_changed(make, overrides or {})


def name_of(path: Path) -> str:
    """Name of a robot whose file has none."""
    return printable(path.stem)[:100].strip() or "robot"


def robot_of_text(text: str, label: str) -> Robot:
    """Robot of the text of a robot file; `label` begins the message of an error."""
    return build(Robot, read_yaml(text, label), label)


def _near_files(path: Path) -> list[str]:
    """The YAML file in the same folder with the most similar name, if one is similar."""
    if not str(path).isprintable() or not path.parent.is_dir():
        return []
    names = (file.name for file in path.parent.iterdir() if file.suffix in (".yaml", ".yml"))
    beside = [name for name in names if name.isprintable()]
    near = difflib.get_close_matches(path.name, beside, n=1, cutoff=0.8)
    return [str(path.with_name(name)) for name in near]


def _read_text(path: Path, label: str, names: list[str]) -> str:
    with reading(label):
        if not path.exists():
            near = difflib.get_close_matches(label, names, n=1) or _near_files(path)
            hint = f"did you mean {near[0]}? " if near else ""
            raise InputError(
                f"{label} is neither a file nor a built-in robot; {hint}"
                f"built in are {', '.join(names)}."
            )
        if not path.is_file():
            what = "folder" if path.is_dir() else "device or pipe"
            raise InputError(f"{label} is a {what}; give a robot file (YAML).")
        return text_of(path, label, "robot")
