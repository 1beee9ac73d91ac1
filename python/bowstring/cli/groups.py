"""Flags and groups of flags, each declared once; commands take the objects made of them.

A command's function has a parameter for each object that it needs. Its annotation says how the
object is made of the command line: by a `Flag`, which reads a text, by a `Group`, which has a
function of flags, or by typer alone. `spread` makes the function of plain flags that typer calls.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from copy import copy
from functools import partial
from inspect import Parameter, Signature, signature
from typing import Annotated, Any, Final

import typer

from bowstring.cli.output import be_quiet

#: Makes an object of the texts of all flags and of the objects before it.
_Step = Callable[[dict[str, Any], dict[str, Any]], Any]

Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="No progress and no warnings on stderr, errors only.")
]


def option(
    form: str | None, text: str, *names: str, values: Callable[..., list[str]] | None = None
) -> Any:
    """Make a flag from the form of its value and its help; its default name is the argument's.

    ``values`` are offered by completion.
    """
    return typer.Option(*names, metavar=form, help=text, autocompletion=values)


class Flag:
    """A flag whose text becomes a value; errors name the flag.

    Parameters
    ----------
    form, text : str
        Form of the value, and help.
    name : str
        Such as ``--tip``; that of the parameter if left out.
    default : str, optional
        Text that is read where the flag is left out; None for a value of None, ``...`` for a
        required flag.
    values : callable, optional
        Values for completion.
    """

    #: What typer reads.
    kind: Any = str

    def __init__(
        self,
        form: str | None,
        text: str,
        name: str = "",
        *,
        default: Any = None,
        values: Any = None,
    ) -> None:
        self.form, self.text, self.name = form, text, name
        self.default, self.values = default, values

    def read(self, flag: str, text: Any, robot: Any) -> Any:
        """Value of a text, or InputError that names the flag; the robot is that of the command."""
        return text

    def value(self, flag: str, text: Any, robot: Any) -> Any:
        """Value of a text, or None without it."""
        return None if text is None else self.read(flag, text, robot)

    def parameter(self, name: str, panel: str) -> Parameter:
        """Parameter of typer."""
        names = [self.name] if self.name else []
        info = option(self.form, self.text, *names, values=self.values)
        info.rich_help_panel = panel
        kind = self.kind if self.default is not None else self.kind | None
        default = Parameter.empty if self.default is ... else self.default
        return _parameter(name, default, Annotated[kind, info])


class Group:
    """Flags under one heading of the help, and the function of them that makes an object.

    A parameter of the function without annotation for the command line, such as ``robot``, takes
    the object that the command has under this name. With ``only`` the other flags are left out and
    keep the defaults of the function.
    """

    def __init__(self, panel: str, make: Callable[..., Any], *only: str) -> None:
        self.panel, self.make, self.only = panel, make, only


def _parameter(name: str, default: Any, kind: Any) -> Parameter:
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind)


def _steps(group: Group, flags: dict[str, Parameter], above: set[str]) -> dict[str, _Step]:
    """Add the flags of a group, and return how each argument of its function is made."""
    steps: dict[str, _Step] = {}
    place = sys.modules[group.make.__module__].__dict__
    for name, given in signature(group.make).parameters.items():
        if group.only and name not in (*group.only, "robot"):
            continue
        try:
            kind = eval(given.annotation, place)
        except NameError:  # a class that is imported for type checks alone
            if name not in above:
                raise
            kind = None
        mark = getattr(kind, "__metadata__", (None,))[0]
        if mark is None and name in above:
            steps[name] = partial(lambda name, texts, made: made[name], name)
            continue
        if isinstance(mark, Group):
            steps[name] = _maker(mark, flags, above | set(steps))
            continue
        assert name not in flags, f"two flags have the parameter {name}"
        if isinstance(mark, Flag):
            flags[name] = mark.parameter(name, group.panel)
            flag = mark.name or "--" + name.replace("_", "-")
            steps[name] = partial(_read, mark, name, flag)
            continue
        if mark is not None:
            mark = copy(mark)
            mark.rich_help_panel = group.panel
            kind = Annotated[kind.__origin__, mark]
        flags[name] = _parameter(name, given.default, kind)
        steps[name] = partial(lambda name, texts, made: texts[name], name)
    return steps


def _read(flag: Flag, name: str, called: str, texts: dict[str, Any], made: dict[str, Any]) -> Any:
    return flag.value(called, texts[name], made.get("robot"))


def _maker(group: Group, flags: dict[str, Parameter], above: set[str]) -> _Step:
    steps = _steps(group, flags, above)

    def make(texts: dict[str, Any], made: dict[str, Any]) -> Any:
        own: dict[str, Any] = {}
        for name, step in steps.items():
            own[name] = step(texts, {**made, **own})
        return group.make(**own)

    return make


def spread(command: Callable[..., None]) -> Callable[..., None]:
    """Turn a command into a function of plain flags for typer, and add the flag --quiet."""
    flags: dict[str, Parameter] = {}
    make = _maker(Group("", command), flags, set())

    def run(*, quiet: bool, **texts: Any) -> None:
        if quiet:
            be_quiet(True)
        make(texts, {})

    flags["quiet"] = _parameter("quiet", False, Quiet)
    run.__name__, run.__doc__ = command.__name__, command.__doc__
    run.__signature__ = Signature(list(flags.values()))  # type: ignore[attr-defined]
    run.__annotations__ = {name: flag.annotation for name, flag in flags.items()}
    return run


_FIRST: Final = ("Arguments", "Options")


class Command(typer.core.TyperCommand):
    """A command whose help shows the flags of each group under their heading."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        sections: dict[str, list[tuple[str, str]]] = {title: [] for title in _FIRST}
        for each in self.get_params(ctx):
            row = each.get_help_record(ctx)
            if row is not None:
                own = getattr(each, "rich_help_panel", None) or "Options"
                title = "Arguments" if each.param_type_name == "argument" else own
                sections.setdefault(title, []).append(row)
        for title, rows in sections.items():
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)
