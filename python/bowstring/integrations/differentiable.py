"""Base of the differentiable solvers for JAX and PyTorch."""

from __future__ import annotations

from functools import partial
from typing import Any, ClassVar

from bowstring.robot.model import Robot
from bowstring.statics.equilibria import differentiable
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel

__all__ = ["DifferentiableSolver"]


class DifferentiableSolver:
    """Statics of a robot as a function that a library differentiates."""

    _library: ClassVar[str]

    def __init__(
        self, robot: Robot, load: Load | None, model: RodModel | None, threads: int
    ) -> None:
        self._function = differentiable(robot, load, model, threads)

    @property
    def robot(self) -> Robot:
        """Robot of the solver."""
        return self._function.robot

    @property
    def model(self) -> RodModel:
        """Model of the rod."""
        return self._function.model

    def __repr__(self) -> str:
        return f"<bowstring.{self._library}.Solver of {self.robot.name}>"

    def __reduce__(self) -> tuple[Any, ...]:
        of = self._function
        return partial(type(self), load=of.load, model=of.model, threads=of.threads), (of.robot,)
