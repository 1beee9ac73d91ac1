"""Equilibria in PyTorch: differentiable by `torch.autograd` and batched by `torch.vmap`.

Needs PyTorch, which is installed by itself (``pip install torch``). All values are in SI and in the
base frame. T is the number of tendons, S that of segments. The solver of `bowstring.solve_batch`
runs on the processor (CPU).
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np

from bowstring.errors import InputError
from bowstring.integrations.differentiable import DifferentiableSolver, Equilibrium
from bowstring.optional import load_extra
from bowstring.statics.equilibria import (
    GRAVITY,
    SECOND,
    EquilibriumFunction,
    Input,
    columns,
    not_numbers,
    single_precision,
)

__all__ = ["Equilibrium", "Solver"]


class Solver(DifferentiableSolver):
    """Statics of a robot as a differentiable function of PyTorch tensors.

    Reverse mode (``backward``), `torch.func.grad`, `torch.func.jacrev` and `torch.vmap` apply to
    it. Arguments and call are those of `DifferentiableSolver`.
    """

    _library = "torch"

    @staticmethod
    def _equilibria(of: EquilibriumFunction, given: Iterable[Any]) -> Iterable[Any]:
        arguments = of.read(
            given, _tensor, lambda tensor, rows: tensor.expand((*rows, tensor.shape[-1]))
        )
        return tuple(_solve().apply(of, *arguments))


@cache
def _torch() -> Any:
    return load_extra("torch")


def _tensor(about: Input, value: Any) -> Any:
    """Tensor in float64 on the CPU; numbers that are not in a tensor are converted."""
    torch = _torch()
    if not isinstance(value, torch.Tensor):
        try:
            value = torch.as_tensor(value, dtype=torch.float64)
        except (OverflowError, TypeError, ValueError, RuntimeError):
            raise not_numbers(about, "not an array of numbers") from None
    if value.device.type != "cpu":
        raise InputError(f"{about.name} is on {value.device}, it must be on the CPU")
    if value.dtype.is_floating_point and value.dtype != torch.float64:
        raise single_precision(about, value.dtype, "convert it by tensor.double()")
    if value.dtype.is_complex or value.dtype == torch.bool:
        raise not_numbers(about, str(value.dtype))
    return value.to(torch.float64)


def _evaluate(
    of: EquilibriumFunction, arguments: Any, *, derivatives: bool, gravity: bool = False
) -> dict[str, Any]:
    """Results of the core as tensors with the leading dimensions of the arguments."""
    torch = _torch()
    rows = arguments[0].shape[:-1]
    tables = [
        np.ascontiguousarray(argument.detach().numpy()).reshape(-1, argument.shape[-1])
        for argument in arguments
    ]
    found = of.core.evaluate(tables, of.threads, derivatives, gravity)
    return {
        name: torch.from_numpy(value).reshape((*rows, *value.shape[1:]))
        for name, value in found.items()
        if value is not None
    }


def _in_front(size: int, dims: Any, arguments: Any) -> tuple[Any, ...]:
    """Arguments with the dimension of `torch.vmap` in front."""
    return tuple(
        argument.expand((size, *argument.shape)) if dim is None else argument.movedim(dim, 0)
        for dim, argument in zip(dims, arguments, strict=True)
    )


@cache
def _linearise() -> Any:
    """Function that gives the derivatives of the equilibria and has none itself."""
    torch = _torch()

    class Linearise(torch.autograd.Function):  # type: ignore[misc, name-defined]
        @staticmethod
        def forward(of: EquilibriumFunction, gravity: bool, *arguments: Any) -> Any:
            found = _evaluate(of, arguments, derivatives=True, gravity=gravity)
            return found["jacobians"], found["tip_rotation"]

        @staticmethod
        def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
            pass

        @staticmethod
        def backward(ctx: Any, *cotangents: Any) -> Any:
            raise InputError(SECOND)

        @staticmethod
        def vmap(
            info: Any, dims: Any, of: EquilibriumFunction, gravity: bool, *arguments: Any
        ) -> Any:
            arguments = _in_front(info.batch_size, dims[2:], arguments)
            return Linearise.apply(of, gravity, *arguments), (0, 0)

    return Linearise


@cache
def _solve() -> Any:
    """Function of the equilibria, with its derivatives in reverse mode."""
    torch = _torch()

    class Solve(torch.autograd.Function):  # type: ignore[misc, name-defined]
        @staticmethod
        def forward(of: EquilibriumFunction, *arguments: Any) -> Any:
            found = _evaluate(of, arguments, derivatives=False)
            return tuple(found[name] for name in Equilibrium._fields)

        @staticmethod
        def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
            ctx.function, *arguments = inputs
            ctx.save_for_backward(*arguments)
            ctx.mark_non_differentiable(*output[3:])

        @staticmethod
        def backward(ctx: Any, position: Any, rotation: Any, lengths: Any, *_: Any) -> Any:
            of, needed = ctx.function, ctx.needs_input_grad[1:]
            by, rotated = _linearise().apply(of, needed[GRAVITY], *ctx.saved_tensors)
            # moment of the cotangents of the three axes about the base's
            turn = torch.linalg.cross(rotated, rotation, dim=-2).sum(-1)
            changes = torch.cat([position, turn, lengths], dim=-1)
            found: list[Any] = [None] * len(of.inputs)
            for index, own in columns(of.tendons, of.inputs[-1].count).items():
                if needed[index]:
                    found[index] = torch.einsum("...ij,...i->...j", by[..., own], changes)
            return (None, *found)

        @staticmethod
        def vmap(info: Any, dims: Any, of: EquilibriumFunction, *arguments: Any) -> Any:
            arguments = _in_front(info.batch_size, dims[1:], arguments)
            return Solve.apply(of, *arguments), (0,) * 5

    return Solve
