"""Directives that write reference tables from the program itself.

``{command} solve`` has what a command does, its arguments and its flags, as its help has them;
``{robot-fields} Backbone`` the fields of a part of the robot file as its JSON Schema has them;
``{json} solve`` the keys of the JSON of a command and of its objects, by `bowstring.cli.schemas`;
``{json} shared`` those of the objects that several commands have;
``{api} bowstring.dynamics`` documents the names that its content lists, from their docstrings.
"""

from __future__ import annotations

import importlib
import inspect
import re
from functools import cache
from typing import Any, get_args

import typer
from docutils import nodes
from pydantic import TypeAdapter
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import bowstring
from bowstring.cli import main, schemas
from bowstring.cli.schemas import basic
from bowstring.cli.schemas.results import object_of
from bowstring.data.measurements import MeasurementIssue
from bowstring.data.rigid import Rigid
from bowstring.pose import Pose
from bowstring.results import unit_of


class _Table(SphinxDirective):
    """A directive whose content is a table in Markdown."""

    required_arguments = 1
    final_argument_whitespace = True

    def rows(self, name: str) -> list[list[str]]:
        """The table, its heading first."""
        raise NotImplementedError

    def run(self) -> list[nodes.Node]:
        """Parse the table as a part of the page."""
        return self.parse_text_to_nodes("\n".join(_table(self.rows(self.arguments[0]))))


def _table(rows: list[list[str]]) -> list[str]:
    lines = ["| " + " | ".join(_cell(text) for text in row) + " |" for row in rows]
    return [lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


class Command(SphinxDirective):
    """What a command does, its arguments and its flags, in the groups of its help."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """Write the help in Markdown and parse it."""
        command: Any = typer.main.get_command(main.app)
        for word in self.arguments[0].split():
            command = command.commands[word]
        groups: dict[str, list[list[str]]] = {"": []}
        for parameter in command.params:
            if not parameter.hidden and parameter.name != "help":
                group = getattr(parameter, "rich_help_panel", None) or ""
                groups.setdefault(group, []).append(_flag(parameter))
        lines = [inspect.cleandoc(command.help or "")]
        for group, rows in groups.items():
            lines += ["", f"**{group}**"] * bool(group)
            lines += ["", *_table([["flag", "value", "meaning"], *rows])]
        return self.parse_text_to_nodes("\n".join(lines))


def _flag(parameter: Any) -> list[str]:
    """Names of a flag or an argument, the value behind it, and what it means."""
    text = (parameter.help or "").strip()
    if parameter.default not in (None, False, (), []) and not callable(parameter.default):
        text += f" Default: `{parameter.default}`."
    if parameter.opts[0].startswith("-"):
        names = [*parameter.opts, *parameter.secondary_opts]
        value = "" if parameter.is_flag else _value(parameter)
    else:
        names, value = [parameter.metavar or parameter.name.upper()], ""
    return [", ".join(f"`{n}`" for n in names), f"`{value}`" if value else "", text]


def _value(parameter: Any) -> str:
    """What the help shows behind a flag."""
    if parameter.metavar:
        return str(parameter.metavar)
    kind = parameter.type_descriptor.annotation
    return "|".join(map(str, get_args(kind))) or str(getattr(kind, "__name__", kind)).upper()


class RobotFields(_Table):
    """Fields of a part of the robot file."""

    def rows(self, name: str) -> list[list[str]]:
        schema = bowstring.robot_schema()
        part = schema if name == "Robot" else schema["$defs"][name]
        required = set(part.get("required", ()))
        found = [["field", "example", "needed", "meaning"]]
        for field, about in part["properties"].items():
            kinds = [about, *about.get("anyOf", ())]
            example = next((e for kind in kinds for e in kind.get("examples", ())), "")
            found.append(
                [
                    f"`{field}`",
                    f"`{example}`" if example != "" else "",
                    "yes" if field in required else "",
                    about.get("description", ""),
                ]
            )
        return found


_LISTS = {2: "`[low, high]`", 3: "`[x, y, z]`"}


@cache
def _json_objects() -> dict[str, list[dict[str, Any]]]:
    """Schemas of objects by section: those that are shared, then each command and what is new."""
    common = (basic.OfRobot, basic.MadeBy, *map(object_of, (Pose, Rigid, MeasurementIssue)))
    found: dict[str, list[dict[str, Any]]] = {}
    seen: dict[str, dict[str, Any]] = {}
    commands = {name: (kind,) for name, kind in schemas.COMMANDS.items()}
    for section, kinds in {"shared": common, **commands}.items():
        found[section] = []
        for kind in kinds:
            whole = TypeAdapter(kind).json_schema()
            parts = whole.pop("$defs", {})
            for part in _reached(whole, parts, []):
                if seen.setdefault(part["title"], part) is part:
                    found[section].append(part)
                elif seen[part["title"]] != part:
                    raise ValueError(f"two schemas have the name {part['title']}")
    return found


def _reached(part: Any, parts: dict[str, Any], found: list[Any]) -> list[Any]:
    """An object and all objects in it, in the order of the keys."""
    found.append(part)
    for name in re.findall(r"'#/\$defs/(\w+)'", str(part["properties"])):
        if parts[name] not in found:
            _reached(parts[name], parts, found)
    return found


def _json_kind(about: dict[str, Any]) -> str:
    """A JSON type in words."""
    if "$ref" in about:
        name = about["$ref"].rpartition("/")[2]
        return f"[{name}](#json-{name.lower()})"
    if "anyOf" in about:
        return " or ".join(map(_json_kind, about["anyOf"]))
    if values := about.get("enum", [about["const"]] if "const" in about else []):
        return " or ".join(f"`{value}`" for value in values)
    if about.get("type") == "array":
        items, count = about["items"], about.get("minItems")
        kinds = {each.get("type", "object") for each in items.get("anyOf", [items])}
        if count is None or kinds - {"number", "null"}:
            kind = f"({_json_kind(items)})" if "anyOf" in items else _json_kind(items)
            return f"list of {kind}" if count is None else f"list of {count} {kind}"
        return _LISTS.get(count, f"{count} numbers") + ", numbers or null" * ("anyOf" in items)
    if isinstance(values := about.get("additionalProperties"), dict):
        return f"object of {_json_kind(values)} by name"
    return str(about.get("type", "any"))


class JsonObjects(SphinxDirective):
    """Objects of a command's JSON: one table each."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """Write the tables in Markdown and parse them."""
        lines: list[str] = []
        for part in _json_objects()[self.arguments[0]]:
            title, keys, more = part["title"], part["properties"], ""
            if title != "OfRobot" and _of_robot().items() <= keys.items():
                keys = {key: about for key, about in keys.items() if key not in _of_robot()}
                more = " It has the keys of [OfRobot](#json-ofrobot) too."
            lines += ["", f"(json-{title.lower()})=", f"**{title}.** {part['description']}{more}"]
            rows = [
                _json_row(key, about, key in part.get("required", ()))
                for key, about in keys.items()
            ]
            lines += ["", *_table([["key", "type", "unit", "meaning"], *rows])]
        return self.parse_text_to_nodes("\n".join(lines))


def _of_robot() -> dict[str, Any]:
    return next(p["properties"] for p in _json_objects()["shared"] if p["title"] == "OfRobot")


def _json_row(key: str, about: dict[str, Any], required: bool) -> list[str]:
    unit = about.get("unit", unit_of(key)[0])
    text = about.get("description", "")
    if not text:  # the object behind the key says the same, and pydantic has it there alone
        name = about["$ref"].rpartition("/")[2]
        parts = (part for section in _json_objects().values() for part in section)
        text = next(part["description"] for part in parts if part["title"] == name)
    return [f"`{key}`", _json_kind(about), unit, text if required else f"{text} Else absent."]


#: Bases whose members are not listed: those of libraries, and the base of results.
_FOREIGN = ("Result", "tuple", "dict", "BaseException", "Env", "VectorEnv", "EzPickle", "BaseModel")


class Api(SphinxDirective):
    """Public names of a module, one a line: a table of first lines, then the docstrings."""

    required_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        """Write the page's part in Markdown and parse it."""
        module = self.arguments[0]
        names = [line.strip() for line in self.content if line.strip()]
        table, docs = ["| name | what it is |", "|---|---|"], []
        for name in names:
            value = getattr(importlib.import_module(module), name)
            first = (inspect.getdoc(value) or "").split("\n\n")[0]
            kind = "class" if inspect.isclass(value) else "function"
            role = "func" if kind == "function" else kind
            table.append(f"| {{py:{role}}}`~{module}.{name}` | {_cell(first)} |")
            docs += ["", "```{eval-rst}", f".. auto{kind}:: {module}.{name}"]
            if kind == "class":
                docs += ["   :members:", f"   :inherited-members: {', '.join(_FOREIGN)}"]
                docs += ["   :special-members: __call__"]
            docs.append("```")
        return self.parse_text_to_nodes("\n".join([*table, *docs]))


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    app.add_directive("command", Command)
    app.add_directive("robot-fields", RobotFields)
    app.add_directive("json", JsonObjects)
    app.add_directive("api", Api)
    return {"version": bowstring.__version__, "parallel_read_safe": True}
