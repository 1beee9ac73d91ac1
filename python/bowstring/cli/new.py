"""Command new: a commented robot file from eight answers, or from a file of another program."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Collection, Mapping
from itertools import cycle
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Annotated, Any, Final, NamedTuple

import typer

from bowstring.cli import completion
from bowstring.cli.groups import Group, option
from bowstring.cli.output import Stopped, warn, write
from bowstring.errors import InputError
from bowstring.formatting import listed
from bowstring.units import Marker, number_with_unit, printable, quote, rounded

if TYPE_CHECKING:
    from bowstring.robot.draft import Draft
    from bowstring.robot.model import Robot

_CONTENT: Final = "robot file"
_EARTH: Final = 9.80665  # m/s^2
#: Typical E, nu and density: austenitic nitinol, spring steel, rods of unidirectional glass fibre
#: along the fibres, unfilled PEEK, dry nylon 66. All but steel vary by 20 % and more.
MATERIALS: Final = {
    "nitinol": ("60 GPa", "0.33", "6450 kg/m^3"),
    "steel": ("200 GPa", "0.29", "7850 kg/m^3"),
    "glass-fibre": ("40 GPa", "0.3", "1900 kg/m^3"),
    "peek": ("3.6 GPa", "0.38", "1300 kg/m^3"),
    "nylon": ("2.8 GPa", "0.39", "1140 kg/m^3"),
}
#: Gravity (m/s^2) in the base frame, and its comment, by where the straight robot points.
MOUNTS: Final = {
    "down": (f"0 0 {_EARTH}", "along +z, from base to tip: the robot hangs down"),
    "up": (f"0 0 -{_EARTH}", "along -z, from tip to base: the robot stands"),
    "side": (f"{_EARTH} 0 0", "along x, perpendicular to the backbone"),
    "none": ("0 0 0", "none"),
}


def _value(field: str, text: str) -> Any:
    """Value of the text of a field of the robot file, such as ``Disks.mass``."""
    from bowstring.robot import parts

    owner, name = field.split(".")
    metadata = getattr(parts, owner).model_fields[name].metadata
    return next(mark for mark in metadata if isinstance(mark, Marker)).read(text)


class _Question(NamedTuple):
    """A question, its default answer, and what the comma-separated parts of an answer are.

    Each part is one of some words, or a field of `bowstring.robot.parts`. An answer has at least
    `least` parts; 0 is for any number of the first.
    """

    form: str
    text: str
    default: str
    parts: tuple[Collection[str] | str, ...]
    least: int = 1

    def read(self, text: str) -> list[str]:
        """Parts of an answer; ValueError says what is wrong with it."""
        given = [" ".join(part.split()) for part in text.split(",")]
        if self.least and not self.least <= len(given) <= len(self.parts):
            count = "one value" if len(given) == 1 else f"{len(given)} values"
            raise ValueError(f"got {count}; write {self.form}, such as {self.default}")
        for part, value in zip(cycle(self.parts), given, strict=False):
            if isinstance(part, str):
                _value(part, value)
            elif value not in part:
                raise ValueError(f"got {quote(value)}; must be one of {', '.join(part)}")
        return given


#: By argument. The defaults are the robot of the start page.
_QUESTIONS: Final = {
    "material": _Question(
        "NAME[,E]",
        f'Material of the backbone ({", ".join(MATERIALS)}), and E if known: "steel,190 GPa"',
        "nitinol",
        (MATERIALS, "Backbone.E"),
    ),
    "diameter": _Question(
        "D[,BORE]",
        'Diameter of the backbone, and of its bore if it is a tube: "2 mm,1 mm"',
        "1.5 mm",
        ("Backbone.diameter", "Backbone.inner_diameter"),
    ),
    "lengths": _Question(
        "L,...",
        'Length of each segment, base to tip: "9 cm,6 cm"',
        "200 mm",
        ("Segment.length",),
        0,
    ),
    "disks": _Question("N", "Number of disks of each segment", "5", ("Disks.count",)),
    "tendons": _Question("N", "Number of tendons of each segment", "3", ("TendonRing.count",)),
    "pitch_radius": _Question(
        "R", "Distance of the tendons from the axis", "10 mm", ("TendonRing.pitch_radius",)
    ),
    "disk": _Question(
        "M,T", "Mass and thickness of a disk", "2 g,3 mm", ("Disks.mass", "Disks.thickness"), 2
    ),
    "mount": _Question(
        "|".join(MOUNTS), "Where the straight robot points; none: no gravity", "down", (MOUNTS,)
    ),
}


def _flag(name: str) -> Any:
    form, text, default, parts, *_ = _QUESTIONS[name]
    words = () if isinstance(parts[0], str) else parts[0]
    values = completion.words(*words) if words else None
    return option(form, f"{text}.  [default: {default}]", values=values)


def _flag_of(name: str) -> str:
    return "--" + name.replace("_", "-")


def _answers(
    material: Annotated[str | None, _flag("material")] = None,
    diameter: Annotated[str | None, _flag("diameter")] = None,
    lengths: Annotated[str | None, _flag("lengths")] = None,
    disks: Annotated[str | None, _flag("disks")] = None,
    tendons: Annotated[str | None, _flag("tendons")] = None,
    pitch_radius: Annotated[str | None, _flag("pitch_radius")] = None,
    disk: Annotated[str | None, _flag("disk")] = None,
    mount: Annotated[str | None, _flag("mount")] = None,
) -> dict[str, str]:
    return {name: text for name, text in locals().items() if text is not None}


def new(
    file: Annotated[
        Path, typer.Argument(metavar="ROBOT.yaml", help="The robot file to write, a new one.")
    ],
    flags: Annotated[dict[str, str], Group("Robot", _answers)],
    source: Annotated[
        Path | None,
        option(
            "FILE",
            "Convert the parameter file of another program: tdcr-modeling (.m, .cpp), "
            "opencr-mujoco (.json), soromox (.py). Numbers are read, no code is run.",
            "--from",
        ),
    ] = None,
) -> None:
    """Write a robot file: asks eight questions on a terminal, else takes flags and defaults."""
    from bowstring.files.atomic_io import check_file, write_whole_file
    from bowstring.robot.draft import plain_text
    from bowstring.robot.foreign import convert
    from bowstring.robot.reader import name_of, robot_of_text

    def check() -> Path:
        if os.path.lexists(file):
            raise InputError(
                f"cannot write the {_CONTENT} to {file}: it exists, and {_CONTENT}s are not "
                "overwritten; name another file, or move that one away"
            )
        return check_file(file, _CONTENT, (".yaml", ".yml"), b"")

    place, name = check(), plain_text(name_of(file))
    if source is None:
        draft, robot = _asked(flags, name, printable(str(file)))
    elif flags:
        named = listed([_flag_of(each) for each in flags])
        raise InputError(f"{named}: not with --from, which takes the whole robot from its file.")
    else:
        draft = convert(source)
        draft.fields = {"name": name, **draft.fields}
        robot = robot_of_text(draft.text, printable(str(source)))

    def fill(path: Path) -> None:
        path.write_text(draft.text, "utf-8")

    write_whole_file(place, _CONTENT, fill, check)
    warn(*robot.warnings)
    write(_summary(robot, draft, file))


def _asked(flags: Mapping[str, str], name: str, file: str) -> tuple[Draft, Robot]:
    """Draft and robot of the flags, of answers on a terminal, and of defaults.

    Answers that do not fit together are asked again, with the former ones as defaults.
    """
    from bowstring.robot.reader import robot_of_text

    answers = {each: question.read(question.default) for each, question in _QUESTIONS.items()}
    for each, text in flags.items():
        try:
            answers[each] = _QUESTIONS[each].read(text)
        except ValueError as error:
            raise InputError(f"{_flag_of(each)}: {error}.") from None
    ask = sys.stdin.isatty() and sys.stderr.isatty() and len(flags) < len(_QUESTIONS)
    own = set(flags)
    while True:
        for number, (each, question) in enumerate(_QUESTIONS.items(), 1):
            if ask and each not in flags:
                prompt = f"{number} of {len(_QUESTIONS)}  {question.text} "
                found = _answer(f"{prompt}[{','.join(answers[each])}]: ", question)
                if found is not None:
                    answers[each] = found
                    own.add(each)
        draft = _draft(name, answers, own)
        try:
            return draft, robot_of_text(draft.text, f"{file}, which was not written")
        except InputError as error:
            if not ask:
                raise
            print(f"  {error}\n  Answer again; Enter keeps an answer.", file=sys.stderr)


def _answer(prompt: str, question: _Question) -> list[str] | None:
    """Ask until the answer can be read; None for Enter."""
    while True:
        print(prompt, end="", file=sys.stderr, flush=True)
        line = sys.stdin.readline()
        if not line:  # Ctrl-D
            print(file=sys.stderr)
            raise Stopped("nothing was written.")
        try:
            return question.read(line) if line.strip() else None
        except ValueError as error:
            print(f"  {printable(str(error))}.", file=sys.stderr)


def _draft(name: str, answers: Mapping[str, list[str]], own: Collection[str]) -> Draft:
    """Draft of the file of a robot with disks; `own` are the questions that somebody answered."""
    from bowstring.robot.draft import Draft, Field

    def stated(question: str, comment: str, called: str = "", part: int = 0) -> Field:
        text = answers[question][part]
        if question in own:
            return Field(text, comment)
        return Field(text, f"{comment}; default, not yours", called or question.replace("_", " "))

    material, *modulus = answers["material"]
    young, nu, density = MATERIALS[material]
    typical = f"typical of {material}"
    backbone = {"diameter": stated("diameter", "outer diameter")}
    if len(answers["diameter"]) > 1:
        backbone["inner_diameter"] = Field(answers["diameter"][1], "bore of the tube")
    backbone["E"] = Field(young, f"Young's modulus, {typical}: measure yours", "E")
    if modulus:
        backbone["E"] = Field(modulus[0], "Young's modulus")
    backbone["nu"] = Field(nu, f"Poisson's ratio, {typical}", "nu")
    backbone["density"] = Field(density, typical, "density")
    pitch_radius = answers["pitch_radius"][0]
    radius = number_with_unit(1.2 * _value("TendonRing.pitch_radius", pitch_radius), "m")
    thickness = answers["disk"][1]
    disks = {
        "count": stated("disks", "evenly spaced, the last at the end"),
        "mass": stated("disk", "each", "disk mass"),
        "radius": Field(radius, "assumed: 1.2 pitch radii; for the inertia", "disk radius"),
        "thickness": stated("disk", "for the inertia", "disk thickness", 1),
        "clamped_length": Field(
            thickness, "assumed: held over its thickness; 0 mm if loose", "clamped length"
        ),
    }
    turn = 360.0 / int(answers["tendons"][0])
    lengths = answers["lengths"]
    segments = [
        {
            "length": stated("lengths", "straight backbone, base to end disk", part=k),
            "backbone": backbone,
            "disks": disks,
            "tendons": {
                "count": stated("tendons", f"{rounded(turn, 4)} degrees apart"),
                "pitch_radius": stated("pitch_radius", "from the backbone's axis"),
                "first_angle": Field(f"{rounded(turn * k / len(lengths), 12)} deg", "from x"),
            },
        }
        for k in range(len(lengths))
    ]
    gravity, direction = MOUNTS[answers["mount"][0]]
    down = stated("mount", direction, "gravity")._replace(text=f"{gravity} m/s^2")
    head = "A robot file of Bowstring. Measure what is assumed, and change it here."
    return Draft({"name": name, "gravity": down, "segments": segments}, head=head)


def _summary(robot: Robot, draft: Draft, file: Path) -> str:
    """What was written, what is assumed, and the next two commands."""
    import numpy as np

    from bowstring.inverse.limits import default_max_tension

    sentences = list(draft.notes)
    if draft.assumed:
        sentences.insert(0, f"Assumed, and marked in the file: {', '.join(draft.assumed)}.")
    called, tendons = shlex.quote(str(file)), len(robot.tendons.angle_rad)
    if tendons:
        # 36 degrees of its segment by the linear law
        tension = rounded(0.2 * float(default_max_tension(robot)[0]), 1)
        load = f'--tension "{",".join([f"{tension} N", *["0"] * (tendons - 1)])}"'
    else:
        stiffness = float(np.min(robot.bending_stiffness))
        load = f'--tip-force "{rounded(0.5 * stiffness / robot.length**2, 1)} N,0,0"'
    after = "study" if tendons and not robot.is_embedded else "modes"
    lines = [f"{printable(str(file))}: {robot._summary}"]
    for sentence in sentences:
        lines += wrap(sentence, 100)
    lines += ["Next:", f"  bowstring solve {called} {load}", f"  bowstring {after} {called}"]
    return "\n".join(lines) + "\n"
