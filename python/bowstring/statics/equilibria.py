"""Equilibria as a function with derivatives, as `bowstring.jax` and `bowstring.torch` call it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bowstring import validation
from bowstring._core import Equilibria
from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.robot.laws import OF_COMMANDS
from bowstring.robot.model import check_robot, check_without_laws
from bowstring.statics.load import Load
from bowstring.statics.load_tables import with_arrays
from bowstring.statics.model import as_model

if TYPE_CHECKING:
    from bowstring._core import RodModel
    from bowstring.robot.model import Robot

#: Index of gravity among the inputs.
GRAVITY = 1

#: Why a second derivative is refused.
SECOND = (
    "second derivatives of an equilibrium are not available here; take first derivatives only, as "
    "gradient descent, BFGS and Gauss-Newton do, or bowstring.directional_derivatives"
)


@dataclass(frozen=True)
class Input:
    """An argument of the function: its name, size of a row, unit, and value if left out."""

    name: str
    """Name of the argument."""
    count: int
    """Numbers in a row."""
    unit: str
    """Unit of the numbers."""
    default: Floats | None
    """Row (count,) if it is left out; None if it must be given."""


@dataclass(frozen=True, eq=False)
class EquilibriumFunction:
    """Equilibria of a robot under constant loads, with checked settings."""

    robot: Robot
    """The robot."""
    load: Load
    """Dead loads that are no arguments."""
    model: RodModel
    """Model of the physics."""
    threads: int
    """Number of threads of a batch; 0 takes all cores."""
    core: Equilibria
    """The function in the core."""
    inputs: tuple[Input, ...]
    """All arguments, tensions first."""

    @property
    def tendons(self) -> int:
        """Number of tendons."""
        return self.inputs[0].count

    def read(
        self,
        given: Iterable[Any],
        convert: Callable[[Input, Any], Any],
        broadcast: Callable[[Any, tuple[int, ...]], Any],
    ) -> list[Any]:
        """Convert arguments and give them the same leading dimensions."""
        arrays = []
        for about, value in zip(self.inputs, given, strict=True):
            value = about.default if value is None else value
            if value is None:
                raise InputError(
                    f"{about.name} is None, it must be {about.count} numbers, in {about.unit}"
                )
            array = convert(about, value)
            shape = tuple(array.shape)
            if not shape or shape[-1] != about.count:
                raise InputError(
                    f"{about.name} has shape {shape}, it must have (..., {about.count}), "
                    f"in {about.unit}"
                )
            arrays.append(array)
        try:
            rows = np.broadcast_shapes(*(tuple(array.shape[:-1]) for array in arrays))
        except ValueError:
            shapes = ", ".join(
                f"{about.name} {tuple(array.shape)}"
                for about, array in zip(self.inputs, arrays, strict=True)
            )
            raise InputError(
                f"the leading dimensions cannot be broadcast together: {shapes}"
            ) from None
        return [
            array if tuple(array.shape) == (*rows, about.count) else broadcast(array, rows)
            for about, array in zip(self.inputs, arrays, strict=True)
        ]


def differentiable(
    robot: Robot, load: Load | None, model: RodModel | None, threads: int
) -> EquilibriumFunction:
    """Check settings and make the function."""
    check_robot(robot)
    load, model = validation.instance("load", load, Load), as_model(model)
    threads = validation.whole("threads", threads, 0, 1024)
    for name in ("tensions", "displacements", "angles"):
        if getattr(load, name) is not None:
            raise InputError(f"load has {name}; give tensions when the solver is called")
    check_without_laws(
        robot,
        ", which derivatives do not model",
        but=OF_COMMANDS,
    )
    if robot.is_embedded or model.tendon_path == "continuous":
        raise InputError(
            "continuous and embedded tendons have no derivatives; take tendons in disks and "
            'tendon_path="straight"'
        )

    def vector(name: str, unit: str, otherwise: Any) -> Input:
        given = getattr(load, name)
        value = otherwise if given is None else given
        return Input(name, 3, unit, validation.row(name, value, 3, unit))

    core = robot.core
    inputs = (
        Input("tensions", core.tendon_count, "N", None),
        vector("gravity", "m/s^2", robot.gravity),
        vector("tip_force", "N", np.zeros(3)),
        vector("tip_moment", "N m", np.zeros(3)),
        Input("stiffness", len(robot.segments), "1", np.ones(len(robot.segments))),
    )
    constant = load.replace(gravity=None, tip_force=None, tip_moment=None)
    made = Equilibria(core, with_arrays(constant), model)
    return EquilibriumFunction(robot, load, model, threads, made, inputs)


def columns(tendons: int, segments: int) -> dict[int, slice]:
    """Columns of the derivatives by the index of their input."""
    found, start = {}, 0
    for index, count in ((0, tendons), (2, 3), (3, 3), (4, segments), (GRAVITY, 3)):
        found[index] = slice(start, start + count)
        start += count
    return found


def not_numbers(about: Input, what: str) -> InputError:
    """Error for an argument that is not an array of numbers."""
    return InputError(
        f"{about.name} is {what}, it must be numbers (..., {about.count}), in {about.unit}"
    )


def single_precision(about: Input, dtype: object, cure: str) -> InputError:
    """Error for numbers that are not float64."""
    return InputError(f"{about.name} is {dtype}, it must be float64; {cure}")
