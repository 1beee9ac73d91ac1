"""The command new: robot files from answers, flags and files of other programs."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from bowstring.cli.new import MATERIALS, MOUNTS
from bowstring.robot.reader import load_robot
from shell import Shell, on_terminal

pytestmark = pytest.mark.usefixtures("here")

SMALL = Path(__file__).parents[1] / "examples" / "small.yaml"
FLAGS = {
    "--material": "steel,190 GPa",
    "--diameter": "2 mm,1.6 mm",
    "--lengths": "150 mm, 0.1 m",
    "--disks": "6",
    "--tendons": "4",
    "--pitch-radius": "8 mm",
    "--disk": "1.5 g,2 mm",
    "--mount": "side",
}


def test_without_answers_it_is_the_robot_of_the_start_page(shell: Shell, here: Path) -> None:
    code, out, err = shell("new", "mine.yaml")
    assert (code, err) == (0, "")
    assert load_robot("mine.yaml").hash == load_robot(SMALL).hash
    assert [path.name for path in here.iterdir()] == ["mine.yaml"]
    lines = Path("mine.yaml").read_text().splitlines()
    fields = [line for line in lines if re.search(r": \S", line) and "name: " not in line]
    assert all("  # " in line for line in fields[1:]), "a comment at each field"
    # what nobody gave is in the output and marked in the file
    assert "Assumed, and marked in the file: " in out and "disk mass 2 g" in " ".join(out.split())
    assert sum("default, not yours" in line for line in lines) == 8


def test_flags_are_written_as_they_are_given(shell: Shell) -> None:
    code, out, _ = shell("new", "mine.yaml", *(text for pair in FLAGS.items() for text in pair))
    robot = load_robot("mine.yaml")
    inner, outer = robot.segments
    assert code == 0 and "not yours" not in Path("mine.yaml").read_text()
    assert (inner.length, outer.length) == (0.15, 0.1)
    assert (inner.backbone.diameter, inner.backbone.inner_diameter) == (0.002, 0.0016)
    assert (inner.backbone.E, inner.backbone.nu) == (190e9, 0.29)
    assert (outer.disks.count, outer.disks.mass, outer.disks.clamped_length) == (6, 0.0015, 0.002)
    assert outer.disks.radius == pytest.approx(0.0096)
    assert robot.gravity == (9.80665, 0, 0)
    # the outer tendons have holes of their own: 90 degrees apart, and 45 from the inner ones
    angles = sorted(round(each) for each in robot.tendons.angle_rad * 180 / 3.141592653589793)
    assert angles == [0, 45, 90, 135, 180, 225, 270, 315]
    assert "clamped length 2 mm" in " ".join(out.split()) and "disk mass" not in out


@pytest.mark.parametrize("given", [[], ["--lengths", "100 mm,100 mm"]])
def test_the_next_commands_work(shell: Shell, given: list[str]) -> None:
    _, out, _ = shell("new", "my robot.yaml", *given)
    solve, study = (shlex.split(line)[1:] for line in out.splitlines()[-2:])
    assert (solve[0], study[:2]) == ("solve", ["study", "my robot.yaml"])
    tip = shell.json(*solve)["tip"]
    bend = shell.json(*solve, "--theory", "kirchhoff")["tip"]["position_m"][0]
    assert tip["position_m"][0] > 0.01 and bend > 0.01


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("mount", MOUNTS)
def test_materials_and_mounts_are_plausible(shell: Shell, material: str, mount: str) -> None:
    thick = ["--diameter", "4 mm"] if material in ("peek", "nylon") else []
    given = ("--material", material, "--mount", mount, *thick)
    assert shell("new", "mine.yaml", *given)[::2] == (0, "")


@pytest.mark.parametrize(
    ("flag", "text", "says"),
    [
        ("--material", "wood", 'got "wood"; must be one of nitinol, steel'),
        ("--material", "steel,190", "got 190 without a unit; write for example"),
        ("--material", "steel,2 kg", '"kg" is not a unit of stress'),
        ("--diameter", "1.5", "without a unit"),
        ("--diameter", "2 mm,1 mm,1 mm", "got 3 values; write D[,BORE], such as 1.5 mm"),
        ("--lengths", "200 mm,", "got nothing"),
        ("--lengths", "-1 mm", "must lie between"),
        ("--disks", "2.5", "must be a whole number"),
        ("--tendons", "0", "must be a whole number"),
        ("--pitch-radius", "1 kg", "is not a unit of length"),
        ("--disk", "2 g", "got one value; write M,T, such as 2 g,3 mm"),
        ("--disk", "3 mm,2 g", "is not a unit of mass"),
        ("--mount", "left", "must be one of down, up, side, none"),
        ("--from", "gone.json", "gone.json is not a file"),
    ],
)
def test_bad_flags(shell: Shell, here: Path, flag: str, text: str, says: str) -> None:
    said = shell.error("new", "mine.yaml", flag, text)
    assert says in said and (flag == "--from" or said.startswith(f"{flag}: "))
    assert not list(here.iterdir())


def test_what_does_not_fit_together_is_not_written(shell: Shell, here: Path) -> None:
    said = shell.error("new", "mine.yaml", "--pitch-radius", "0.5 mm")
    assert "mine.yaml, which was not written" in said and "pitch_radius: got 0.5 mm" in said
    assert "inner_diameter: got 2 mm" in shell.error("new", "a.yaml", "--diameter", "2 mm,2 mm")
    assert "--disks: not with --from" in shell.error(
        "new", "a.yaml", "--disks", "5", "--from", "b.json"
    )
    assert "must end in .yaml or .yml" in shell.error("new", "mine.txt")
    assert not list(here.iterdir())


def test_robot_files_are_not_overwritten(shell: Shell) -> None:
    shell("new", "mine.yaml")
    before = Path("mine.yaml").read_bytes()
    assert "it exists" in shell.error("new", "mine.yaml", "--disks", "7")
    assert Path("mine.yaml").read_bytes() == before


def test_a_name_that_yaml_would_misread(shell: Shell) -> None:
    assert shell("new", "1: #2.yaml")[0] == 0
    assert load_robot("1: #2.yaml").name == "1: #2"


def test_a_file_of_another_program(shell: Shell) -> None:
    """A bare rod has no tendons to pull: the next commands are for a tip force."""
    Path("rod.json").write_text(
        '{"joint_config_mode": "material", "total_length": 0.3, "radius": 0.01, '
        '"material_properties": {"density": 1100, "youngs_modulus": 1e7, "poisson_ratio": 0.4}, '
        '"gravity": "0 0 0"}'
    )
    code, out, _ = shell("new", "rod.yaml", "--from", "rod.json")
    assert code == 0 and load_robot("rod.yaml").length == 0.3
    assert "Not converted: actuator_properties" in out and "Assumed" not in out
    solve, modes = (shlex.split(line)[1:] for line in out.splitlines()[-2:])
    assert shell.json(*solve)["tip"]["position_m"][0] > 0.01 and modes == ["modes", "rod.yaml"]


def answered(answers: str) -> tuple[str, int]:
    return on_terminal("new", "mine.yaml", "--mount", "up", typed=answers, NO_COLOR="1")


def test_questions_on_a_terminal() -> None:
    """A bad answer is asked again with the reason, Enter keeps a default, a flag is not asked."""
    text, code = answered("oak\nglass-fibre\n\n0.25\n250 mm\n4\n\n9 mm\n3 g,2 mm\n")
    assert code == 0, text
    assert text.count("1 of 8") == 2 and 'got "oak"; must be one of' in text
    assert text.count("3 of 8") == 2 and "got 0.25 without a unit" in text
    assert "8 of 8" not in text
    robot = load_robot("mine.yaml")
    (segment,) = robot.segments
    assert (segment.length, segment.disks.count, segment.disks.mass) == (0.25, 4, 0.003)
    assert segment.backbone.E == 40e9 and robot.gravity == (0, 0, -9.80665)
    marked = [line for line in Path("mine.yaml").read_text().splitlines() if "not yours" in line]
    assert [line.split(":")[0].strip() for line in marked] == ["diameter", "count"]


def test_answers_that_do_not_fit_together_are_asked_again() -> None:
    """The former answers are the defaults then."""
    text, code = answered("\n\n250 mm\n\n\n0.5 mm\n\n" + "\n\n\n\n\n9 mm\n\n")
    assert code == 0, text
    assert "pitch_radius: got 0.5 mm" in text and "Answer again; Enter keeps an answer." in text
    assert text.count("[200 mm]") == text.count("[250 mm]") == 1
    robot = load_robot("mine.yaml")
    assert (robot.length, robot.tendons.pitch_radius_m[0]) == (0.25, 0.009)


def test_the_end_of_input_writes_nothing(here: Path) -> None:
    text, code = answered("steel\n\x04")
    assert code == 130 and "Stopped: nothing was written." in text
    assert not list(here.iterdir())
