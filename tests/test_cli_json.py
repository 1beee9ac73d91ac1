"""The JSON of every command is as its schema has it; `shell.json` checks all that tests print."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import typer
from pydantic import TypeAdapter

from bowstring.cli import main
from bowstring.cli.schemas import COMMANDS, study
from bowstring.cli.schemas.results import object_of
from bowstring.study.study import Study
from shell import Shell, adapter

UNITS = {"", "1 or Pa", "rad/m of displacement"}  # that the end of a key does not name
ENDS = {"m", "mm", "rad", "deg", "N", "Pa", "MPa", "kg", "s", "m3", "Nm", "hz", "percent"}
BENCH = str(Path(__file__).parents[1] / "examples" / "bench.csv")


def test_every_command_with_json_has_a_schema() -> None:
    def commands(group: Any, words: tuple[str, ...] = ()) -> Iterator[str]:
        for name, command in group.commands.items():
            if hasattr(command, "commands"):
                yield from commands(command, (*words, name))
            elif any("--json" in parameter.opts for parameter in command.params):
                yield " ".join((*words, name))

    found = set(commands(typer.main.get_command(main.app)))
    known = {command.partition(" --")[0] for command in COMMANDS}  # a flag may change the object
    assert found == {*known, "schema"}  # which prints a JSON Schema itself


@pytest.mark.parametrize("command", COMMANDS)
def test_every_key_is_described(command: str) -> None:
    schema = adapter(command).json_schema()
    for part in (schema, *schema.get("$defs", {}).values()):
        assert part["description"] and part["additionalProperties"] is False
        for key, about in part["properties"].items():
            # pydantic leaves out a description that equals that of the object behind the key
            behind = schema["$defs"][about["$ref"].rpartition("/")[2]] if "$ref" in about else {}
            text = about.get("description", behind.get("description", ""))
            assert text.endswith("."), (part["title"], key)


@pytest.mark.parametrize("command", COMMANDS)
def test_numbers_have_known_units_and_texts_have_none(command: str) -> None:
    schema = adapter(command).json_schema()
    parts = (schema, *schema.get("$defs", {}).values())
    keys = {f"`{key}`" for part in parts for key in part["properties"]}
    for part in parts:
        for key, about in part["properties"].items():
            unit = about.get("unit", "")
            assert unit in UNITS | keys, (part["title"], key)  # or the key that has the unit
            if about.get("type") in ("string", "boolean"):
                assert not unit and key.rpartition("_")[2] not in ENDS, (part["title"], key)


@pytest.mark.parametrize(
    "arguments",
    [
        ("robots",),
        ("doctor",),
        ("data", "list"),
        ("fk", "rao2021", "--lengths", "0.2,0.2,0.2,0.39,0.41,0.4"),
        ("solve", "rao2021", "--displacement", "1 mm,0,0,0,2 mm,0"),
        (
            *("solve", "amouri2019", "--tension", "20,0,0"),
            *("--set", "segments.0.backbone.yield_strength=1 GPa"),
            *("--set", "segments.0.backbone.strain_limit=0.02"),
        ),
        ("modes", "amouri2019", "--tension", "20,0,0", "--count", "2"),
        ("simulate", "rao2021", "--tension", "0,0,0,1,0,0", "--rise", "0.1", "--hold", "0"),
        ("bench", "check", BENCH),
        ("bench", "check", BENCH, "--robot", "amouri2019"),
        ("bench", "simulate", "amouri2019", "--masses", "0:2:8", "--unload", "--out", "b.csv"),
        (
            *("bench", "simulate", "amouri2019", "--displacements", "0:10 mm:0.03"),
            *("--actual", "segments.0.backbone.E=+5 %", "--out", "b.csv"),
        ),
        pytest.param(
            ("study", "amouri2019", "--points", "3", "--measurements", BENCH),
            marks=pytest.mark.slow,
        ),
    ],
    ids=lambda arguments: " ".join(arguments[:2]),
)
def test_json_of_commands(arguments: tuple[str, ...], shell: Shell, here: Path) -> None:
    """Variants that no other test prints; the schema is all that is asked here."""
    shell.json(*arguments)


def test_study_in_python(paper: Study) -> None:
    check = TypeAdapter(object_of(study.StudyResults)).validate_python
    still = replace(paper, dynamics=None, without_dynamics="The robot has no mass.")
    for found in (paper, still):
        check(found.to_dict(), strict=True)
