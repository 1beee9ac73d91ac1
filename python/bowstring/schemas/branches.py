"""JSON of the command branches."""

from __future__ import annotations

from typing import Annotated, Literal

from bowstring.schemas.basic import Object, OfRobot, Vector, about


class BranchEvent(Object):
    """A limit point or a bifurcation."""

    kind: Annotated[
        Literal["limit_point", "bifurcation"],
        about("`limit_point`: the load factor has an extremum; `bifurcation`: branches meet."),
    ]
    factor: Annotated[float, about("Load factor.")]
    point: Annotated[int, about("Index of its point on the branch, from 0.")]
    multiplicity: Annotated[int, about("Number of eigenvalues that change their sign.")]


class BranchOfEquilibria(Object):
    """A branch of equilibria."""

    factor: Annotated[list[float], about("Load factor of each point.")]
    tip_position_m: Annotated[list[Vector], about("Tip at each point.")]
    stable: Annotated[
        list[bool | None],
        about("Whether each point is stable; `null` where it is not determined."),
    ]
    unstable_modes: Annotated[
        list[int | None],
        about("Negative eigenvalues of the second variation; `null` under a moment."),
    ]
    residual: Annotated[
        float, about("Largest moment imbalance of a point over (bending stiffness / length).")
    ]
    events: Annotated[list[BranchEvent], about("Limit points and bifurcations in order.")]
    origin: Annotated[
        list[int] | None,
        about(
            "Branch and event at which it begins, from 0; `null` for the first branch, those that "
            "begin at load factor 0 beside it, and those that deflation found."
        ),
    ]
    end: Annotated[
        Literal["range", "closed", "joined", "collision", "unstable", "points", "lost"],
        about(
            "Why it ends: `range` of the load factor; `closed`; `joined` at a bifurcation of "
            "another branch; `collision` of disks; `unstable`, not followed further; most "
            "`points`; `lost`, it does not converge."
        ),
    ]


class EquilibriumOnBranch(Object):
    """An equilibrium at load factor 1."""

    branch: Annotated[int, about("Its branch, from 0.")]
    point: Annotated[int, about("Its point on the branch, from 0.")]
    stable: Annotated[bool | None, about("Whether it is stable; `null` if not determined.")]
    tip_position_m: Annotated[Vector, about("Tip.")]


class CriticalValues(Object):
    """Where the first branch loses its stability."""

    factor: Annotated[float | None, about("Critical load factor; `null` if it stays stable.")]
    kind: Annotated[
        Literal["limit_point", "bifurcation", "oscillation"] | None,
        about("What happens; `oscillation`: under a moment small oscillations grow."),
    ]
    multiplicity: Annotated[int, about("Number of eigenvalues that change their sign.")]
    stable_to: Annotated[
        float | None, about("Largest load factor up to which the branch was found stable.")
    ]
    text: Annotated[str, about("The same as a sentence.")]


class DiagramValues(Object):
    """Branches of equilibria along a load."""

    elements: Annotated[int, about("Elements between two disks.")]
    theory: Annotated[Literal["cosserat", "kirchhoff"], about("Theory of the backbone.")]
    branches: Annotated[
        list[BranchOfEquilibria], about("Branches; the first one begins at load factor 0.")
    ]
    equilibria: Annotated[list[EquilibriumOnBranch], about("Equilibria found at load factor 1.")]
    critical: Annotated[CriticalValues, about("Loss of stability of the first branch.")]
    complete: Annotated[
        bool,
        about("Whether all bifurcations found were followed, and all branches to their ends."),
    ]
    deflated: Annotated[bool, about("Whether equilibria were also sought by deflation.")]


class Branches(OfRobot, DiagramValues):
    """Output of `bowstring branches`."""

    text: Annotated[list[str], about("What the diagram says, in sentences.")]
    file: Annotated[str | None, about("Figure; `null` if it could not be drawn.")]
