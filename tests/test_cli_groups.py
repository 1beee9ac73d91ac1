"""Groups of flags: how they are spread into plain flags, and the objects that they make."""

from __future__ import annotations

import inspect
from typing import Annotated, Any

import pytest
import typer

from bowstring.cli import main
from bowstring.cli.flags import Number, Vector, ZeroVector
from bowstring.cli.groups import Command, Group, option, spread
from bowstring.errors import InputError
from shell import Shell


def _box(
    size: Annotated[float, Number("m", '"2 mm"', "Size.", default="1 mm", must_be="positive")],
    at: Annotated[list[float] | None, Vector("m", "0,0,1", "Place.")] = None,
    count: Annotated[int, option("N", "Number.")] = 2,
) -> dict[str, Any]:
    return {"size": size, "at": at, "count": count}


Box = Annotated[dict[str, Any], Group("Box", _box)]
Place = Annotated[dict[str, Any], Group("Box", _box, "size", "at")]


def _held(box: Box, grip: Annotated[float, Number("N", "1", "Grip.", default=...)]) -> Any:
    return box, grip


def _twice(held: Any, factor: Annotated[int, option("K", "Factor.")] = 2) -> float:
    grip: float = factor * held[1]
    return grip


Held = Annotated[Any, Group("Hand", _held)]
Twice = Annotated[float, Group("Hand", _twice)]


def called(command: Any, **texts: Any) -> Any:
    """What a command gets of these texts and of the defaults of the other flags."""
    made: list[Any] = []
    run = spread(command(made))
    names = {name: flag.default for name, flag in inspect.signature(run).parameters.items()}
    run(**{**names, **texts})
    return made[0]


def placed(made: list[Any]) -> Any:
    def command(
        box: Place, shift: Annotated[list[float], ZeroVector("m", "1,0,0", "Shift.")]
    ) -> None:
        """Place."""
        made.append((box, shift))

    return command


def held(made: list[Any]) -> Any:
    def command(held: Held, force: Twice) -> None:
        """Hold."""
        made.append((held, force))

    return command


def test_texts_become_values_of_the_group() -> None:
    box, shift = called(placed, size="3 mm", at="0,0,5 mm")
    assert box == {"size": 0.003, "at": [0.0, 0.0, 0.005], "count": 2}
    assert shift == [0.0, 0.0, 0.0]


def test_defaults_are_texts_and_flags_left_out_keep_those_of_the_function() -> None:
    assert called(placed)[0] == {"size": 0.001, "at": None, "count": 2}
    names = list(inspect.signature(spread(placed([]))).parameters)
    assert names == ["size", "at", "shift", "quiet"]


def test_a_group_takes_what_is_made_before_it_by_name() -> None:
    (box, grip), force = called(held, grip="3", count=4, factor=5)
    assert (box["count"], grip, force) == (4, 3.0, 15.0)


@pytest.mark.parametrize(
    ("texts", "says"),
    [
        ({"size": "0"}, "--size: got 0 m; must be positive."),
        ({"size": "2 N"}, '--size: got "2 N", but "N" is not a unit of length; write for example'),
        ({"at": "1,2"}, "--at: got 2 numbers; write x, y and z, for example --at 0,0,1."),
    ],
)
def test_errors_name_the_flag(texts: dict[str, str], says: str) -> None:
    with pytest.raises(InputError) as error:
        called(placed, **texts)
    assert str(error.value).startswith(says)


def test_two_flags_of_one_name_are_a_bug() -> None:
    def command(one: Box, other: Box) -> None: ...

    with pytest.raises(AssertionError, match="two flags have the parameter size"):
        spread(command)


def test_the_help_has_a_heading_for_each_group(shell: Shell) -> None:
    _, said, _ = shell("solve", "--help")
    headings = [line[:-1] for line in said.splitlines() if line[:1].isupper() and line[-1:] == ":"]
    assert headings == ["Arguments", "Options", "Actuation", "Loads", "Rod"]
    assert said.index("Loads:") < said.index("--plane x,y,z") < said.index("Rod:")


def test_the_help_of_the_program_names_all_commands(shell: Shell) -> None:
    _, said, _ = shell("--help")
    whole = typer.main.get_command(main.app)
    for name, command in whole.commands.items():  # type: ignore[attr-defined]
        assert f"\n  {name} " in said
        assert isinstance(command, Command) == (name not in ("bench", "data"))
