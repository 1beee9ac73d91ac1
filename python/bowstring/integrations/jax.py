"""Equilibria in JAX: differentiable, compiled by `jax.jit` and batched by `jax.vmap`.

Needs the extra ``jax``. All values are in SI and in the base frame. T is the number of tendons, S
that of segments. The solver of `bowstring.solve_batch` is called by compiled programs directly,
through XLA's foreign function interface, on the processor (CPU).
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np

from bowstring._core import xla_targets
from bowstring.errors import InputError
from bowstring.integrations.differentiable import DifferentiableSolver, Equilibrium
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
    """Statics of a robot as a differentiable JAX function.

    `jax.grad`, `jax.jacfwd`, `jax.jacrev`, `jax.jvp`, `jax.vjp`, `jax.jit` and `jax.vmap` apply to
    it in any order. Under `jax.vmap` all loads are solved in one call, as by
    `bowstring.solve_batch`. Arguments and call are those of `DifferentiableSolver`.

    Notes
    -----
    Compiled programs may outlive their solver. Therefore robots, each counted once, are kept until
    the process ends.

    Examples
    --------
    How far one more newton on each tendon moves the tip along x, in mm:

    >>> import jax
    >>> import bowstring as bs
    >>> import bowstring.jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> solver = bowstring.jax.Solver(bs.load_robot("amouri2019"))
    >>> along_x = jax.grad(lambda tensions: solver(tensions).tip_position[0])
    >>> (1e3 * along_x(jax.numpy.array([40.0, 0.0, 0.0]))).round(2)
    Array([ 5.03, -2.39, -2.39], dtype=float64)
    """

    _library = "jax"

    @staticmethod
    def _equilibria(of: EquilibriumFunction, given: Iterable[Any]) -> Iterable[Any]:
        import jax
        import jax.numpy as jnp

        if jax.dtypes.canonicalize_dtype(np.float64) != np.float64:
            raise InputError(
                "Bowstring computes in float64, which JAX has disabled; call "
                'jax.config.update("jax_enable_x64", True) at the start of the program'
            )
        arguments = of.read(
            given, _array, lambda array, rows: jnp.broadcast_to(array, (*rows, array.shape[-1]))
        )
        _register()
        solve = _solve(of.core.key, of.threads, of.tendons, of.inputs[-1].count)
        return tuple(solve(*arguments))


def _array(about: Input, value: Any) -> Any:
    """Array in float64."""
    import jax.numpy as jnp

    try:
        array = jnp.asarray(value)
    except (OverflowError, TypeError, ValueError) as error:
        if type(error).__module__.startswith("jax"):
            raise  # a tracer in the wrong place, with an explanation of JAX
        array = None
    # bfloat16 is no kind of NumPy's
    floating = array is not None and jnp.issubdtype(array.dtype, jnp.floating)
    if array is None or not (floating or jnp.issubdtype(array.dtype, jnp.integer)):
        what = "not an array of numbers" if array is None else str(array.dtype)
        raise not_numbers(about, what)
    if floating and array.dtype != np.float64:
        raise single_precision(about, array.dtype, "make it by jax.numpy.float64")
    return array.astype(np.float64)


@cache
def _register() -> None:
    """Register the calls in XLA."""
    import jax

    for name, capsule in xla_targets().items():
        jax.ffi.register_ffi_target(name, capsule, platform="cpu")


@cache
def _solve(key: str, threads: int, tendons: int, segments: int) -> Any:
    """Function of tensions, gravity, tip force, tip moment and stiffness, with its derivatives.

    It is the same object for the same robot, so that JAX compiles it once.
    """
    import jax
    import jax.numpy as jnp
    from jax.custom_derivatives import SymbolicZero

    def call(target: str, arguments: Any, count: int = 0, **attributes: Any) -> Any:
        rows = arguments[0].shape[:-1]
        shapes: list[tuple[tuple[int, ...], Any]] = [
            ((3,), np.float64),
            ((3, 3), np.float64),
            ((tendons,), np.float64),
            ((), np.bool_),
            ((), np.bool_),
        ]
        if count:
            shapes.append(((6 + tendons, count), np.float64))
        results = [jax.ShapeDtypeStruct(rows + shape, dtype) for shape, dtype in shapes]
        called = jax.ffi.ffi_call(target, results, vmap_method="broadcast_all")
        return tuple(called(*arguments, robot=key, threads=np.int64(threads), **attributes))

    def linearised(gravity: bool) -> Any:
        count = tendons + 6 + segments + 3 * gravity

        def linearise(*arguments: Any) -> Any:
            return call("bowstring_linearise", arguments, count, gravity=np.int64(gravity))

        function = jax.custom_jvp(linearise)
        function.defjvp(differentiate_twice)
        return function

    def differentiate_twice(primals: Any, tangents: Any) -> Any:
        raise InputError(SECOND)

    solve = jax.custom_jvp(lambda *arguments: call("bowstring_solve", arguments))
    linearise = {gravity: linearised(gravity) for gravity in (False, True)}

    def differentiate(primals: Any, tangents: Any) -> Any:
        known = [type(tangent) is not SymbolicZero for tangent in tangents]
        *values, by = linearise[known[GRAVITY]](*primals)
        _, rotation, _, converged, _ = values
        change = jnp.zeros(by.shape[:-1])
        for index, own in columns(tendons, segments).items():
            if known[index]:
                change = change + jnp.einsum("...ij,...j->...i", by[..., own], tangents[index])
        turn, transposed = change[..., None, 3:6], jnp.swapaxes(rotation, -1, -2)
        none = np.zeros(converged.shape, jax.dtypes.float0)
        return tuple(values), (
            change[..., :3],
            jnp.swapaxes(jnp.cross(turn, transposed), -1, -2),
            change[..., 6:],
            none,
            none,
        )

    solve.defjvp(differentiate, symbolic_zeros=True)
    return solve
