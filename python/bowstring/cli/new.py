"""Command new: a commented robot file from eight answers, or from a file of another program."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Annotated, Any, Final, NamedTuple

import typer

from bowstring.cli import completion
from bowstring.cli.groups import option
from bowstring.cli.output import Stopped, say, write
from bowstring.errors import InputError
from bowstring.formatting import listed
from bowstring.units import printable, quote, rounded

if TYPE_CHECKING:
    from bowstring.robot.draft import Draft
    from bowstring.robot.model import Robot

_CONTENT: Final = "robot file"
_WIDTH: Final = 100
#: Of the robot of the start page, by argument.
_DEFAULTS: Final = {
    "material": "nitinol",
    "diameter": "1.5 mm",
    "lengths": "200 mm",
    "disks": "5",
    "tendons": "3",
    "pitch_radius": "10 mm",
    "disk": "2 g,3 mm",
    "mount": "down",
}


class _Question(NamedTuple):
    """A question: the argument that it is for, its text, and what reads the answer."""

    name: str
    text: str
    read: Callable[[str], dict[str, Any]]

    @property
    def flag(self) -> str:
        return "--" + self.name.replace("_", "-")

    @property
    def default(self) -> str:
        return _DEFAULTS[self.name]


def _flag(form: str, name: str, text: str, **more: Any) -> Any:
    return option(form, f"{text}  [default: {_DEFAULTS[name]}]", **more)


def new(
    file: Annotated[
        Path, typer.Argument(metavar="ROBOT.yaml", help="The robot file to write, a new one.")
    ],
    material: Annotated[
        str | None,
        _flag(
            "NAME[,E]",
            "material",
            "Material of the backbone, and its Young's modulus if known, as in "
            '"glass-fibre,35 GPa": nitinol, steel, glass-fibre, peek, nylon.',
        ),
    ] = None,
    diameter: Annotated[
        str | None,
        _flag(
            "D[,D]", "diameter", 'Diameter of the backbone; of a tube and its bore: "2 mm,1 mm".'
        ),
    ] = None,
    lengths: Annotated[
        str | None, _flag("L,...", "lengths", 'Length of each segment, base to tip: "9 cm,6 cm".')
    ] = None,
    disks: Annotated[str | None, _flag("N", "disks", "Spacer disks of each segment.")] = None,
    tendons: Annotated[
        str | None, _flag("N", "tendons", "Tendons that end in each segment.")
    ] = None,
    pitch_radius: Annotated[
        str | None,
        _flag("R", "pitch_radius", "Distance of the tendons' holes from the backbone's axis."),
    ] = None,
    disk: Annotated[str | None, _flag("M,T", "disk", "Mass and thickness of a disk.")] = None,
    mount: Annotated[
        str | None,
        _flag(
            "down|up|side|none",
            "mount",
            "Where the unloaded robot points, for gravity; none is without gravity.",
            values=completion.words("down", "up", "side", "none"),
        ),
    ] = None,
    source: Annotated[
        Path | None,
        option(
            "FILE",
            "Convert the parameter file of another program instead: tdcr-modeling (.m, .cpp), "
            "opencr-mujoco (.json), soromox (.py), SoRoSim (.m). Numbers are read, no code is run.",
            "--from",
        ),
    ] = None,
) -> None:
    """Write a robot file: asks eight questions on a terminal, else takes flags and defaults."""
    from bowstring.atomic_io import check_file, write_whole_file
    from bowstring.robot.draft import drafted, plain_text
    from bowstring.robot.foreign import convert
    from bowstring.robot.reader import name_of, robot_of_text

    def check() -> Path:
        if os.path.lexists(file):
            raise InputError(
                f"cannot write the {_CONTENT} to {file}: it exists, and {_CONTENT}s are not "
                "overwritten; name another file, or move that one away"
            )
        return check_file(file, _CONTENT, (".yaml", ".yml"), b"")

    place, questions = check(), _questions()
    given = (material, diameter, lengths, disks, tendons, pitch_radius, disk, mount)
    if source is not None:
        flags = [q.flag for q, text in zip(questions, given, strict=True) if text is not None]
        if flags:
            raise InputError(
                f"{listed(flags)}: not with --from, which takes the whole robot from its file."
            )
        draft = convert(source)
        draft.fields = {"name": plain_text(name_of(file)), **draft.fields}
    else:
        answers, defaults = _answers(questions, given)
        draft = drafted(name_of(file), **answers, defaults=defaults)
    label = f"the draft of {file}" if source is None else printable(str(source))
    robot = robot_of_text(draft.text, label)

    def fill(path: Path) -> None:
        path.write_text(draft.text, "utf-8")

    write_whole_file(place, _CONTENT, fill, check)
    for sentence in robot.warnings:
        say("Warning", sentence)
    write(_summary(robot, draft, file))


def _answers(
    questions: Sequence[_Question], given: Sequence[str | None]
) -> tuple[dict[str, Any], set[str]]:
    """Answers by argument, and the arguments that keep their default.

    Flags come first; on a terminal the others are asked, and asked again after a bad answer.
    """
    ask = sys.stdin.isatty() and sys.stderr.isatty()
    answers: dict[str, Any] = {}
    defaults: set[str] = set()
    for number, (question, flag) in enumerate(zip(questions, given, strict=True), 1):
        if flag is not None:
            try:
                found = question.read(" ".join(flag.split()))
            except ValueError as error:
                raise InputError(f"{question.flag}: {error}.") from None
        elif ask:
            found, own = _asked(f"{number} of {len(questions)}  {question.text}", question)
            defaults |= set() if own else found.keys()
        else:
            found = question.read(question.default)
            defaults |= found.keys()
        answers |= found
    return answers, defaults


def _asked(prompt: str, question: _Question) -> tuple[dict[str, Any], bool]:
    """Ask until the answer can be read; say whether it is one, not the default."""
    while True:
        print(f"{prompt} [{question.default}]: ", end="", file=sys.stderr, flush=True)
        line = sys.stdin.readline()
        if not line:  # Ctrl-D
            print(file=sys.stderr)
            raise Stopped("nothing was written.")
        try:
            return question.read(line.strip() or question.default), bool(line.strip())
        except ValueError as error:
            print(f"  {printable(str(error))}.", file=sys.stderr)


def _questions() -> list[_Question]:
    from bowstring.robot.draft import MATERIALS, MOUNTS
    from bowstring.robot.parts import MAX_SEGMENTS, Backbone, Disks, Segment, TendonRing

    def material(text: str) -> dict[str, Any]:
        name, comma, modulus = (part.strip() for part in text.partition(","))
        if name not in MATERIALS:
            raise ValueError(f"got {quote(name)}; must be one of {', '.join(MATERIALS)}")
        if comma:
            _read(Backbone, "E", modulus)
        return {"material": name, "E": modulus}

    def diameter(text: str) -> dict[str, Any]:
        sizes = _split(text, 2, "the diameter, and that of the bore of a tube")
        outer = _read(Backbone, "diameter", sizes[0])
        if len(sizes) == 2 and not 0 < _read(Backbone, "inner_diameter", sizes[1]) < outer:
            raise ValueError(f"got a bore of {sizes[1]}; must be smaller than {sizes[0]}")
        return {"diameter": sizes}

    def lengths(text: str) -> dict[str, Any]:
        each = _split(text, MAX_SEGMENTS, "the length of each segment")
        for length in each:
            _read(Segment, "length", length)
        return {"lengths": each}

    def count(part: Any, argument: str) -> Callable[[str], dict[str, Any]]:
        return lambda text: {argument: str(_read(part, "count", text))}

    def pitch_radius(text: str) -> dict[str, Any]:
        return {"pitch_radius": (text, _read(TendonRing, "pitch_radius", text))}

    def disk(text: str) -> dict[str, Any]:
        both = _split(text, 2, "mass and thickness")
        if len(both) != 2:
            raise ValueError("got one number; write mass and thickness, such as 2 g,3 mm")
        _read(Disks, "mass", both[0])
        _read(Disks, "thickness", both[1])
        return {"disk": tuple(both)}

    def mount(text: str) -> dict[str, Any]:
        if text not in MOUNTS:
            raise ValueError(f"got {quote(text)}; must be one of {', '.join(MOUNTS)}")
        return {"mount": text}

    known = ", ".join(MATERIALS)
    return [
        _Question(
            "material",
            f"Material of the backbone: {known}; with E if known, steel,190 GPa",
            material,
        ),
        _Question("diameter", "Its diameter; a tube: outer,inner", diameter),
        _Question("lengths", "Length of each segment, base to tip", lengths),
        _Question("disks", "Spacer disks of each segment", count(Disks, "disks")),
        _Question("tendons", "Tendons of each segment", count(TendonRing, "tendons")),
        _Question(
            "pitch_radius", "Pitch radius: from the axis to the tendons' holes", pitch_radius
        ),
        _Question("disk", "Mass,thickness of a disk", disk),
        _Question("mount", "Points down, up or to the side (gravity), or none", mount),
    ]


def _split(text: str, most: int, what: str) -> list[str]:
    parts = [part.strip() for part in text.split(",")]
    if len(parts) > most:
        raise ValueError(f"got {len(parts)} numbers; write {what}")
    return parts


def _read(part: Any, name: str, text: str) -> Any:
    """Value of a field of the robot file; ValueError says what is wrong with its text."""
    mark = next(each for each in part.model_fields[name].metadata if hasattr(each, "read"))
    return mark.read(text.strip())


def _summary(robot: Robot, draft: Draft, file: Path) -> str:
    """What was written, what is assumed, and the next two commands."""
    import numpy as np

    lines = [f"{printable(str(file))}: {robot._summary}"]
    if draft.assumed:
        lines += wrap(f"Assumed, and marked in the file: {', '.join(draft.assumed)}.", _WIDTH)
    for note in draft.notes:
        lines += wrap(note, _WIDTH)
    called = shlex.quote(str(file))
    stiffness, tendons = np.asarray(robot.bending_stiffness), len(robot.tendons.angle_rad)
    if tendons:
        from bowstring.inverse.kinematics import default_max_tension

        # 36 degrees of its segment by the linear law
        tension = rounded(0.2 * float(default_max_tension(robot)[0]), 1)
        load = f'--tension "{",".join([f"{tension} N", *["0"] * (tendons - 1)])}"'
        after = f"bowstring {'modes' if robot.is_embedded else 'study'} {called}"
    else:
        force = rounded(0.5 * float(stiffness.min()) / robot.length**2, 1)
        load, after = f'--tip-force "{force} N,0,0"', f"bowstring modes {called}"
    lines += ["Next:", f"  bowstring solve {called} {load}", f"  {after}"]
    return "\n".join(lines) + "\n"
