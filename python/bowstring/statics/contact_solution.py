"""Result of a contact of the tip with a plane."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final, Literal

import numpy as np

from bowstring.aliases import Floats
from bowstring.display import short_repr
from bowstring.errors import NoSolutionError, StabilityWarning
from bowstring.results import Key, Result
from bowstring.statics.plane import Plane
from bowstring.statics.solution import Solution

if TYPE_CHECKING:
    from typing_extensions import Self

    from bowstring.statics.messages import StaticsStatus

State = Literal["separated", "sticking", "sliding"]

_BEYOND: Final = 1e-6  # distance over length from which a disk counts as beyond the plane


@short_repr
@dataclass(frozen=True, eq=False)
class ContactSolution(Result):
    """Equilibrium of a robot whose tip may touch a plane; made by `solve_contact`."""

    plane: Plane
    """The plane."""
    status: StaticsStatus
    """``"converged"``, or the reason of failure as in `Solution.status`. The other values are None
    or NaN then."""
    state: State | None
    """State of the contact; None without one."""
    solution: Solution | None
    """The equilibrium under the load and the contact force as a dead tip force. Its `stable` is
    that without the constraint."""
    force: Annotated[Floats, Key("force_N")]
    """Contact force (3,) on the tip in the base frame, N."""
    normal_force: Annotated[float, Key("normal_force_N")]
    """Component of the contact force along the normal, N; never negative."""
    gap: Annotated[float, Key("gap_m")]
    """Distance of the tip from the plane, m: zero within the tolerance in contact."""
    point: Annotated[Floats | None, Key("point_m")]
    """Point (3,) of the plane that the tip touches, m; None if separated. A sticking tip is held
    there."""
    residual: Annotated[float, Key()]
    """Largest violation of the contact conditions: distances over the length, forces over the
    larger of the contact force and (least bending stiffness / length squared). At most 1e-9."""
    stable: Annotated[bool | None, Key()]
    """Whether the constrained equilibrium is stable; None where this is not proven: with friction
    in contact, and under a moment in contact."""

    @property
    def known_state(self) -> Annotated[State, Key("state")]:
        """``separated``; ``sticking``, friction holds the tip in its place; ``sliding``, the tip is
        in contact and slides, or is free to slide on a frictionless plane."""
        if self.state is None:
            raise NoSolutionError(self.message, status=self.status)
        return self.state

    @property
    def converged(self) -> bool:
        """Whether the contact conditions are proven."""
        return self.status == "converged"

    @property
    def disks_beyond(self) -> Annotated[tuple[int, ...], Key()]:
        """Numbers, from 1, of disks before the tip whose centres are beyond the plane.

        The plane acts on the tip only.
        """
        if self.solution is None or self.solution.disk_positions is None:
            return ()
        gaps = self.plane.gap(self.solution.disk_positions[:-1])
        beyond = np.flatnonzero(gaps < -_BEYOND * self.solution.robot.length)
        return tuple((beyond + 1).tolist())

    @property
    def message(self) -> Annotated[str, Key()]:
        """The contact as a sentence."""
        if not self.converged:
            return (
                "No contact equilibrium was found that is stable under its contact force as a "
                f"dead force ({self.status}); approach it in smaller steps of the load "
                "(bowstring.sweep_contact), or move the plane."
            )
        if self.state == "separated":
            return f"The tip is {1e3 * self.gap:.6g} mm from the plane."
        what = "sticks to" if self.state == "sticking" else "slides on"
        if self.plane.friction == 0:
            what = "touches"
        said = f"The tip {what} the plane with a normal force of {self.normal_force:.6g} N"
        if self.plane.friction > 0:
            tangential = np.linalg.norm(
                self.force - self.normal_force * np.array(self.plane.normal)
            )
            said += f" and {tangential:.6g} N of friction"
        return said + "."

    def warnings(self) -> tuple[str, ...]:
        """Warning of disks before the tip that are beyond the plane, as sentences."""
        beyond = self.disks_beyond
        if not beyond:
            return ()
        one = len(beyond) == 1
        numbers = ", ".join(map(str, beyond))
        return (
            f"{'disk' if one else 'disks'} {numbers} {'is' if one else 'are'} beyond the plane, "
            "which acts on the tip only",
        )

    def raise_for_status(self) -> Self:
        """Return self if converged, else raise.

        Raises
        ------
        NoSolutionError
            The message has advice.

        Warns
        -----
        StabilityWarning
            If the equilibrium is unstable, or its stability is unknown for a reason other than
            friction.
        """
        if self.solution is None:
            raise NoSolutionError(self.message, status=self.status)
        if not self.stable and (self.state == "separated" or self.plane.friction == 0):
            word = "unstable" if self.stable is False else "not known to be stable"
            said = f"{self.solution.robot.name}: the equilibrium is {word}. {self.message}"
            warnings.warn(said, StabilityWarning, stacklevel=2)
        return self
