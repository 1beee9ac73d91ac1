"""Write a robot as a robot file, for robots changed by a program."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from bowstring.robot.model import Robot
from bowstring.robot.parts import Backbone
from bowstring.units import Quantity, printable


def to_yaml(robot: Robot, comment: str = "") -> str:
    """Text of a robot file that reads back as the same robot.

    Parameters
    ----------
    robot : Robot
    comment : str
        Comment lines at the top of the file.

    Returns
    -------
    str
        YAML with numbers in SI units, exact to the last digit; without defaults that nobody gave.
    """
    import yaml

    head = "".join(f"# {printable(line)}".rstrip() + "\n" for line in comment.splitlines())
    return head + yaml.safe_dump(_plain(robot), sort_keys=False, allow_unicode=True, width=100)


def _plain(part: BaseModel) -> dict[str, Any]:
    fields: dict[str, Any] = {}
    without = part.replaced if isinstance(part, Backbone) else ()
    for name, info in type(part).model_fields.items():
        value = getattr(part, name)
        unit = next((mark.si for mark in info.metadata if isinstance(mark, Quantity)), "")
        if value is None or value == "" or name in without:
            continue
        if value == () and not info.is_required():
            continue
        if name not in part.model_fields_set and value == info.default:
            continue
        if isinstance(value, BaseModel):
            fields[name] = _plain(value)
        elif isinstance(value, tuple) and all(isinstance(each, BaseModel) for each in value):
            fields[name] = [_plain(each) for each in value]
        elif unit:
            values = value if isinstance(value, tuple) else (value,)
            fields[name] = f"{' '.join(repr(float(each)) for each in values)} {unit}"
        else:
            fields[name] = value
    return fields
