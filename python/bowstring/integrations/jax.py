"""Equilibria in JAX: differentiable, compiled by `jax.jit` and batched by `jax.vmap`.

Needs the extra ``jax``. All values are in SI and in the base frame. T is the number of tendons, S
that of segments. The solver of `bowstring.solve_batch` is called by compiled programs directly,
through XLA's foreign function interface, on the processor (CPU).
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bowstring._core import xla_targets
from bowstring.errors import InputError
from bowstring.integrations.differentiable import DifferentiableSolver
from bowstring.optional import load_extra
from bowstring.statics.equilibria import (
    GRAVITY,
    SECOND,
    Input,
    columns,
    not_numbers,
    single_precision,
)

if TYPE_CHECKING:
    from bowstring._core import RodModel
    from bowstring.robot.model import Robot
    from bowstring.statics.load import Load

__all__ = ["Equilibrium", "Solver"]


class Equilibrium(NamedTuple):
    """Equilibria as JAX arrays, with the leading dimensions of the arguments; made by a `Solver`.

    Where there is no equilibrium, numbers are NaN and `converged` is False.

    Attributes
    ----------
    tip_position : jax.Array (..., 3)
        Position of the tip in m.
    tip_rotation : jax.Array (..., 3, 3)
        Rotation of the tip, body to base.
    tendon_lengths : jax.Array (..., T)
        Lengths of the tendons from the base hole to the hole of the end disk, in m.
    converged : jax.Array of bool (...)
        Whether there is an equilibrium.
    stable : jax.Array of bool (...)
        Whether it is known to be stable, as `bowstring.Solution.stable`.
    """

    tip_position: Any
    tip_rotation: Any
    tendon_lengths: Any
    converged: Any
    stable: Any


class Solver(DifferentiableSolver):
    """Statics of a robot as a differentiable JAX function.

    `jax.grad`, `jax.jacfwd`, `jax.jacrev`, `jax.jvp`, `jax.vjp`, `jax.jit` and `jax.vmap` apply to
    it in any order. Under `jax.vmap` all loads are solved in one call, as by
    `bowstring.solve_batch`. Derivatives are those of `bowstring.jacobians` and, by gravity, alike:
    exact for the discretised robot.

    Its ``robot`` and ``model`` are those that it was made with.

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
        If JAX is missing, an argument is wrong, or the tendons have no derivatives.

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

    def __init__(
        self,
        robot: Robot,
        *,
        load: Load | None = None,
        model: RodModel | None = None,
        threads: int = 0,
    ) -> None:
        load_extra("jax")
        super().__init__(robot, load, model, threads)
        _register()

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
            If an argument has a wrong shape or is float32, if JAX has 64-bit numbers disabled, and
            for second derivatives.
        """
        import jax
        import jax.numpy as jnp

        if jax.dtypes.canonicalize_dtype(np.float64) != np.float64:
            raise InputError(
                "Bowstring computes in float64, which JAX has disabled; call "
                'jax.config.update("jax_enable_x64", True) at the start of the program'
            )
        of = self._function
        arguments = of.read(
            (tensions, gravity, tip_force, tip_moment, stiffness),
            _array,
            lambda array, rows: jnp.broadcast_to(array, (*rows, array.shape[-1])),
        )
        segments = of.inputs[-1].count
        solve = _solve(of.core.key, of.threads, of.tendons, segments)
        return Equilibrium(*solve(*arguments))


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
