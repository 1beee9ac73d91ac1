"""Command export: a robot as rigid links for other simulators and viewers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from bowstring.cli import completion
from bowstring.cli.flags import PerTendon, of_flag, tendon_count
from bowstring.cli.groups import option
from bowstring.cli.options import AsJson, Gravity, RobotArgument
from bowstring.cli.output import provenance_of, write, write_json
from bowstring.errors import InputError
from bowstring.formatting import significant

if TYPE_CHECKING:
    from bowstring.schemas.program import Export


def export(
    robot: RobotArgument,
    out: Annotated[
        str,
        option(
            "FILE",
            "The model: .xml for MuJoCo (MJCF), .urdf for viewers and planners.",
            values=completion.formats(".xml", ".urdf"),
        ),
    ],
    tension: Annotated[
        list[float] | None,
        PerTendon(
            "N",
            '"80 N",0,0',
            "Tendon tensions at which the tip error is stated; if left out, half of the most of ik "
            "on the first tendon.",
        ),
    ],
    gravity: Gravity,
    joints: Annotated[
        int, option("N", "Joints between two disks: 1, or an even number up to 32.")
    ] = 2,
    as_json: AsJson = False,
) -> None:
    """A robot as rigid links with springs, for MuJoCo and robotics tools.

    It states how far the tip of the links is from that of the rod under one load.
    """
    import numpy as np

    from bowstring.integrations.rigid_links.chain import LinkChain
    from bowstring.integrations.rigid_links.mjcf import check_mjcf, write_mjcf
    from bowstring.integrations.rigid_links.urdf import check_urdf, write_urdf
    from bowstring.inverse.kinematics import default_max_tension
    from bowstring.statics.load import Load
    from bowstring.statics.rod import solve

    ending = Path(out).suffix.lower()
    if ending not in (".xml", ".urdf"):
        raise InputError(f"--out: got {out}; end it in .xml (MJCF for MuJoCo) or .urdf.")
    file = of_flag("--out", check_urdf if ending == ".urdf" else check_mjcf, out)
    if tension is None:
        tension = [0.0] * tendon_count(robot)
        tension[0] = float(f"{0.5 * default_max_tension(robot)[0]:.3g}")
    acting = Load(tension, gravity=gravity)
    chain = LinkChain(robot, joints)
    rod = solve(robot, load=acting).raise_for_status()
    assert rod.tip is not None
    if ending == ".xml":
        angles = chain.solve(acting)
        written = write_mjcf(chain, file, load=acting)
    else:
        angles = chain.angles_of(rod)
        written = write_urdf(chain, file)
    error = float(np.linalg.norm(chain.pose(angles).tip - rod.tip.position))
    count = len(chain.bodies)
    if as_json:
        content: Export = {
            "file": str(written),
            "format": "MJCF" if ending == ".xml" else "URDF",
            "joints": count,
            "tensions_N": tension,
            "tip_error_m": error,
            **provenance_of(robot, joints=joints, tensions_N=tension, gravity_m_per_s2=gravity),
        }
        return write_json(content)
    share = significant(100.0 * error / robot.length, 2)
    against = (
        "in its equilibrium"
        if ending == ".xml"
        else "with the angles of the rod; URDF has no springs and no tendons"
    )
    write(
        f"{'MJCF' if ending == '.xml' else 'URDF'} model: {written}\n"
        f"{count} joints of three hinges; tip error against the rod "
        f"{significant(1e3 * error, 2)} mm, {share} % of the length,\n"
        f"under {', '.join(f'{t:g}' for t in tension)} N, {against} (simulated)\n"
    )
