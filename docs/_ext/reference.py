"""Directives that write reference tables from the program itself.

``{command} solve`` lists the arguments and flags of a command as the parser has them;
``{robot-fields} Backbone`` the fields of a part of the robot file as its JSON Schema has them;
``{api} bowstring.dynamics`` documents the names that its content lists, from their docstrings.
"""

from __future__ import annotations

import importlib
import inspect
from typing import Any, get_args

import typer
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import bowstring
from bowstring.cli import main


class _Table(SphinxDirective):
    """A directive whose content is a table in Markdown."""

    required_arguments = 1
    final_argument_whitespace = True

    def rows(self, name: str) -> list[list[str]]:
        """The table, its heading first."""
        raise NotImplementedError

    def run(self) -> list[nodes.Node]:
        """Parse the table as a part of the page."""
        rows = self.rows(self.arguments[0])
        lines = ["| " + " | ".join(_cell(text) for text in row) + " |" for row in rows]
        lines.insert(1, "|---" * len(rows[0]) + "|")
        return self.parse_text_to_nodes("\n".join(lines))


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


class CommandTable(_Table):
    """Arguments and flags of a command."""

    def rows(self, name: str) -> list[list[str]]:
        command: Any = typer.main.get_command(main.app)
        for word in name.split():
            command = command.commands[word]
        found = [["flag", "value", "meaning"]]
        for parameter in command.params:
            if parameter.hidden or parameter.name == "help":
                continue
            text = (parameter.help or "").strip()
            if parameter.default not in (None, False, (), []) and not callable(parameter.default):
                text += f" Default: `{parameter.default}`."
            if parameter.opts[0].startswith("-"):
                names = [*parameter.opts, *parameter.secondary_opts]
                value = "" if parameter.is_flag else _value(parameter)
            else:
                names, value = [parameter.metavar or parameter.name.upper()], ""
            found.append([", ".join(f"`{n}`" for n in names), f"`{value}`" if value else "", text])
        return found


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
            docs += ["   :members:"] * (kind == "class") + ["```"]
        return self.parse_text_to_nodes("\n".join([*table, *docs]))


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    app.add_directive("command", CommandTable)
    app.add_directive("robot-fields", RobotFields)
    app.add_directive("api", Api)
    return {"version": bowstring.__version__, "parallel_read_safe": True}
