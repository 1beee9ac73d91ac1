"""Base of the differentiable solvers for JAX and PyTorch."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from functools import partial
from typing import Any, ClassVar, NamedTuple

from bowstring.optional import load_extra
from bowstring.robot.model import Robot
from bowstring.statics.equilibria import EquilibriumFunction, differentiable
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel

__all__ = ["DifferentiableSolver", "Equilibrium"]


class Equilibrium(NamedTuple):
    """Equilibria as arrays of JAX or tensors of PyTorch, made by a `Solver`.

    They have the leading dimensions of the arguments. Where there is no equilibrium, numbers are
    NaN and `converged` is False.

    Attributes
    ----------
    tip_position : jax.Array or torch.Tensor (..., 3)
        Position of the tip in m.
    tip_rotation : jax.Array or torch.Tensor (..., 3, 3)
        Rotation of the tip, body to base.
    tendon_lengths : jax.Array or torch.Tensor (..., T)
        Lengths of the tendons from the base hole to the hole of the end disk, in m.
    converged : jax.Array or torch.Tensor of bool (...)
        Whether there is an equilibrium.
    stable : jax.Array or torch.Tensor of bool (...)
        Whether it is known to be stable, as `bowstring.Solution.stable`.
    """

    tip_position: Any
    tip_rotation: Any
    tendon_lengths: Any
    converged: Any
    stable: Any


class DifferentiableSolver(ABC):
    """Statics of a robot as a function that a library differentiates.

    Derivatives are those of `bowstring.jacobians` and, by gravity, alike: exact for the discretised
    robot. Its ``robot`` and ``model`` are those that it was made with.

    Parameters
    ----------
    robot : Robot
        Robot with straight tendons without friction.
    load : Load, optional
        Constant loads: on disks, point loads, and forces per length. Its gravity, tip force and tip
        moment are used where a call does not give them. It has no tensions.
    model : RodModel, optional
        As for `bowstring.solve`.
    threads : int
        Number of threads for a batch; 0 takes one for each core. The results do not depend on it.

    Raises
    ------
    InputError
        If the library is missing, an argument is wrong, or the tendons have no derivatives.
    """

    _library: ClassVar[str]

    def __init__(
        self,
        robot: Robot,
        *,
        load: Load | None = None,
        model: RodModel | None = None,
        threads: int = 0,
    ) -> None:
        load_extra(self._library)
        self._function = differentiable(robot, load, model, threads)

    def __call__(
        self,
        tensions: Any,
        *,
        tip_force: Any = None,
        tip_moment: Any = None,
        gravity: Any = None,
        stiffness: Any = None,
    ) -> Equilibrium:
        """Find the equilibria under loads, each from the straight robot.

        Leading dimensions are those of a batch. They are broadcast against each other.

        Parameters
        ----------
        tensions : array_like (..., T)
            Tension of each tendon before its base hole in N, none negative.
        tip_force, tip_moment : array_like (..., 3), optional
            Dead loads at the tip in base axes, N and N m.
        gravity : array_like (..., 3), optional
            Gravity in base axes in m/s^2; that of the load or robot if left out.
        stiffness : array_like (..., S), optional
            Factors of all stiffnesses of each segment's backbone; 1 if left out.

        Returns
        -------
        Equilibrium
            NaN where there is no equilibrium, or where a number is not allowed, such as a negative
            tension: a compiled program cannot raise an error.

        Raises
        ------
        InputError
            If an argument has a wrong shape, is not float64 or not on the CPU, if JAX has 64-bit
            numbers disabled, and for second derivatives.
        """
        given = tensions, gravity, tip_force, tip_moment, stiffness
        return Equilibrium(*self._equilibria(self._function, given))

    @staticmethod
    @abstractmethod
    def _equilibria(of: EquilibriumFunction, given: Iterable[Any]) -> Iterable[Any]:
        """Fields of `Equilibrium` for the arguments of a call, in the order of the inputs."""

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
