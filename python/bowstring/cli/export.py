"""Command export: the robot as a solid, as rigid links, or as plain numbers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from bowstring.cli import completion
from bowstring.cli.actuation import Actuation
from bowstring.cli.flags import of_flag, tendon_count
from bowstring.cli.groups import option
from bowstring.cli.options import AsJson, Gravity, RobotArgument
from bowstring.cli.output import provenance_of, write, write_json
from bowstring.cli.solids import write_solids
from bowstring.errors import InputError
from bowstring.formatting import plain, significant

if TYPE_CHECKING:
    from bowstring.cli.schemas.program import Export
    from bowstring.robot.model import Robot
    from bowstring.statics.load import Load

_SOLIDS: Final = (".step", ".stp", ".stl", ".glb", ".gltf")
_LINKS: Final = (".xml", ".urdf")
_NUMBERS: Final = ".json"
#: Flags that a kind of file does not use.
_UNUSED: Final = {
    "a solid": ("--gravity", "--joints"),
    "rigid links": ("--displacement", "--angle", "--picture", "--drawing"),
    "plain numbers": (
        *("--tension", "--displacement", "--angle", "--gravity", "--joints"),
        *("--picture", "--drawing"),
    ),
}
_COMPILED: Final = "compiled robot"
_MARK: Final = b'"format": "bowstring compiled robot"'


def export(
    robot: RobotArgument,
    actuation: Actuation,
    gravity: Gravity,
    out: Annotated[
        str | None,
        option(
            "FILE",
            "By its ending a solid (.step, .stp, .stl, .glb, .gltf), rigid links with springs "
            "(.xml for MuJoCo, .urdf), or plain numbers for the C library and the playground "
            "(.json).",
            values=completion.formats(*_SOLIDS, *_LINKS, _NUMBERS),
        ),
    ] = None,
    picture: Annotated[
        str | None,
        option(
            "FILE",
            "A rendered picture of the solid: .png, .pdf or .svg.",
            values=completion.formats(".png", ".pdf", ".svg"),
        ),
    ] = None,
    drawing: Annotated[
        str | None,
        option(
            "FILE",
            "The disks with dimensions: .svg, .pdf or .png.",
            values=completion.formats(".svg", ".pdf", ".png"),
        ),
    ] = None,
    joints: Annotated[
        int | None,
        option(
            "N",
            "Rigid links: joints between two disks, 1 or an even number up to 32.  [default: 2]",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write a robot for other programs: CAD, MuJoCo, robotics viewers, the C library.

    A solid is unloaded, or in equilibrium under an actuation; it needs the extra cad, except for
    the drawing. Rigid links come with the error of their tip against the rod under tensions, by
    default half of the most of ik on the first tendon.
    """
    if out is None and picture is None and drawing is None:
        raise InputError("nothing to write: give --out FILE, --picture FILE or --drawing FILE.")
    ending = Path(out).suffix.lower() if out else _SOLIDS[0]
    if ending not in (*_SOLIDS, *_LINKS, _NUMBERS):
        raise InputError(
            f"--out: got {out}; end it in {', '.join(_SOLIDS)} (solid), {' or '.join(_LINKS)} "
            f"(rigid links for MuJoCo, for viewers) or {_NUMBERS} (plain numbers)."
        )
    kind = "a solid" if ending in _SOLIDS else "rigid links"
    kind = "plain numbers" if ending == _NUMBERS else kind
    given = {
        "--tension": actuation and actuation.tensions,
        "--displacement": actuation and actuation.displacements,
        "--angle": actuation and actuation.angles,
        "--gravity": gravity,
        "--joints": joints,
        "--picture": picture,
        "--drawing": drawing,
    }
    for flag in _UNUSED[kind]:
        if given[flag] is not None:
            raise InputError(f"{flag}: {kind} ({ending}) cannot use it; leave it out.")
    if kind == "a solid":
        return write_solids(robot, actuation, out, picture, drawing, as_json)
    assert out is not None
    if kind == "plain numbers":
        return _write_numbers(robot, Path(out), as_json)
    return _write_links(robot, out, actuation, gravity, 2 if joints is None else joints, as_json)


def _write_links(
    robot: Robot,
    out: str,
    actuation: Load | None,
    gravity: list[float] | None,
    joints: int,
    as_json: bool,
) -> None:
    import numpy as np

    from bowstring.integrations.rigid_links.chain import LinkChain
    from bowstring.integrations.rigid_links.mjcf import check_mjcf, write_mjcf
    from bowstring.integrations.rigid_links.urdf import check_urdf, write_urdf
    from bowstring.inverse.limits import default_max_tension
    from bowstring.statics.load import Load
    from bowstring.statics.rod import solve

    mjcf = not out.lower().endswith(".urdf")
    file = of_flag("--out", check_mjcf if mjcf else check_urdf, out)
    if actuation is None:
        tensions = [0.0] * tendon_count(robot)
        if tensions:
            tensions[0] = float(f"{0.5 * default_max_tension(robot)[0]:.3g}")
        actuation = Load(tensions)
    acting = actuation.replace(gravity=gravity)
    tensions = np.asarray(acting.tensions).tolist()
    chain = LinkChain(robot, joints)
    rod = solve(robot, load=acting).raise_for_status()
    assert rod.tip is not None
    if mjcf:
        angles = chain.solve(acting)
        written = write_mjcf(chain, file, load=acting)
    else:
        angles = chain.angles_of(rod)
        written = write_urdf(chain, file)
    error = float(np.linalg.norm(chain.pose(angles).tip - rod.tip.position))
    count, name = len(chain.bodies), "MJCF" if mjcf else "URDF"
    if as_json:
        content: Export = {
            "file": str(written),
            "format": "MJCF" if mjcf else "URDF",
            "joints": count,
            "tensions_N": tensions,
            "tip_error_m": error,
            **provenance_of(robot, joints=joints, tensions_N=tensions, gravity_m_per_s2=gravity),
        }
        return write_json(content)
    share = significant(100.0 * error / robot.length, 2)
    against = "in its equilibrium"
    if not mjcf:
        against = "with the angles of the rod; URDF has no springs and no tendons"
    under = f"under {', '.join(f'{t:g}' for t in tensions)} N" if tensions else "without tendons"
    write(
        f"{name} model: {written}\n"
        f"{count} joints of three hinges; tip error against the rod "
        f"{significant(1e3 * error, 2)} mm, {share} % of the length,\n"
        f"{under}, {against} (simulated)\n"
    )


def _write_numbers(robot: Robot, out: Path, as_json: bool) -> None:
    """Write the robot in SI with all defaults: the C library reads no robot files."""
    from bowstring.files.atomic_io import check_file, write_whole_file
    from bowstring.inverse.compiled import compile_robot

    def check(path: Path) -> Path:
        return check_file(path, _COMPILED, (_NUMBERS,), _MARK)

    file = of_flag("--out", check, out)
    content = {**compile_robot(robot), **provenance_of(robot)}
    text = json.dumps(plain(content), allow_nan=False, indent=1) + "\n"

    def fill(new: Path) -> None:
        new.write_text(text, "utf-8")

    write_whole_file(file, _COMPILED, fill, lambda: check(file))
    if as_json:
        return write_json(content)
    write(f"Compiled robot: {file}\n")
