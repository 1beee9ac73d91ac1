"""Equilibria in JAX: the numbers and derivatives of the core, under every transformation."""

from __future__ import annotations

import doctest
import pickle
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import bowstring as bs
import bowstring.jax
from objects import refused

jax = pytest.importorskip("jax", reason="needs the extra jax", exc_type=ImportError)
jnp = jax.numpy

#: Loads beside the tensions, by the arguments of a call.
LOADED = {
    "gravity": np.array([0.0, 0.0, -9.81]),
    "tip_force": np.array([0.2, -0.3, 0.1]),
    "tip_moment": np.array([0.03, 0.05, -0.02]),
}
TENSIONS = np.array([30.0, 12.0, 5.0])


@pytest.fixture(autouse=True)
def float64() -> Iterator[None]:
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


def rows(count: int) -> np.ndarray:
    return np.random.default_rng(1).uniform(0.0, 40.0, (count, 3))


def test_numbers_are_those_of_the_core(robot: bs.Robot) -> None:
    solver = bowstring.jax.Solver(robot)
    one = solver(TENSIONS, **LOADED)
    expected = bs.solve(robot, TENSIONS, load=bs.Load(**LOADED))
    np.testing.assert_array_equal(one.tip_position, expected.tip.position)
    np.testing.assert_array_equal(one.tip_rotation, expected.tip.rotation)
    np.testing.assert_array_equal(one.tendon_lengths, expected.tendon_lengths)
    assert one.converged and bool(one.stable) is (expected.stable is True)
    assert one.tip_position.dtype == np.float64 and one.converged.dtype == np.bool_
    tensions = rows(1000)
    batch = bs.solve_batch(robot, tensions, disks=False)
    for found in (
        solver(tensions),
        jax.vmap(solver)(tensions),
        jax.jit(jax.vmap(solver))(tensions),
        jax.tree.map(
            lambda x: x.reshape(1000, *x.shape[2:]),
            jax.vmap(jax.vmap(solver))(tensions.reshape(20, 50, 3)),
        ),
    ):
        np.testing.assert_array_equal(found.tip_position, batch.tip_position)
        np.testing.assert_array_equal(found.tip_rotation, batch.tip_rotation)
        np.testing.assert_array_equal(found.tendon_lengths, batch.tendon_lengths)
        np.testing.assert_array_equal(found.converged, batch.converged)
        np.testing.assert_array_equal(found.stable, [bool(stable) for stable in batch.stable])


@pytest.mark.parametrize("transform", ["jacfwd", "jacrev", "jit of jacfwd", "jacrev of jit"])
def test_derivatives_are_those_of_the_core(rao: bs.Robot, transform: str) -> None:
    solver = bowstring.jax.Solver(rao)
    tensions = np.array([8.0, 1.0, 3.0, 2.0, 6.0, 4.0])[: rao.core.tendon_count]

    def function(given: dict[str, Any]) -> bowstring.jax.Equilibrium:
        found = solver(**given, gravity=LOADED["gravity"])
        return found[:3]

    given = {
        "tensions": jnp.asarray(tensions),
        "tip_force": jnp.asarray(LOADED["tip_force"]),
        "tip_moment": jnp.asarray(LOADED["tip_moment"]),
        "stiffness": jnp.ones(len(rao.segments)),
    }
    differentiate = {
        "jacfwd": jax.jacfwd(function),
        "jacrev": jax.jacrev(function),
        "jit of jacfwd": jax.jit(jax.jacfwd(function)),
        "jacrev of jit": jax.jacrev(jax.jit(function)),
    }[transform]
    position, rotation, lengths = differentiate(given)
    solution = bs.solve(rao, tensions, load=bs.Load(**LOADED))
    by = bs.jacobians(solution)
    rotated = solution.tip.rotation
    names = {"tensions": "tension", **{name: name for name in list(given)[1:]}}
    for argument, name in names.items():
        turns = getattr(by, f"tip_rotation_by_{name}")
        expected = np.stack([np.cross(turn, rotated.T).T for turn in turns.T], axis=-1)
        for found, wanted in (
            (position, getattr(by, f"tip_position_by_{name}")),
            (rotation, expected),
            (lengths, getattr(by, f"lengths_by_{name}")),
        ):
            wanted = np.asarray(wanted)
            np.testing.assert_allclose(found[argument], wanted, rtol=1e-10, atol=1e-12)


def test_derivatives_agree_with_differences(robot: bs.Robot) -> None:
    """Richardson's extrapolation of central differences, with loads on disks and backbone."""
    forces = np.zeros((9, 3))
    forces[4] = [0.1, 0.2, 0.0]
    load = bs.Load(
        disk_forces=forces,
        point_loads=[bs.PointLoad(force=[0.1, 0, 0], point=[0.01, 0, 0], follower=True)],
    )
    solver = bowstring.jax.Solver(robot, load=load, model=bs.RodModel(elements=2))

    def function(x: Any) -> Any:
        found = solver(x[:3], tip_force=x[3:6], stiffness=x[6:7], gravity=x[7:])
        return jnp.concatenate(
            [found.tip_position, found.tip_rotation.ravel(), found.tendon_lengths]
        )

    at = np.array([20.0, 3.0, 6.0, 0.1, 0.2, -0.1, 1.1, 0.5, 0.0, -9.81])
    steps = np.array([0.2, 0.2, 0.2, 0.02, 0.02, 0.02, 0.02, 0.1, 0.1, 0.1])
    found = jax.jit(jax.jacrev(function))(at)

    def difference(k: int, h: float) -> np.ndarray:
        moved = np.zeros_like(at)
        moved[k] = h
        return np.asarray(function(at + moved) - function(at - moved)) / (2 * h)

    for k, h in enumerate(steps):
        expected = (4 * difference(k, h / 2) - difference(k, h)) / 3
        np.testing.assert_allclose(found[:, k], expected, rtol=1e-6, atol=3e-9)


def test_batches_of_derivatives(robot: bs.Robot) -> None:
    solver = bowstring.jax.Solver(robot)
    tensions = rows(50)

    def loss(tensions: Any, factor: Any) -> Any:
        found = solver(tensions, stiffness=factor[None])
        return found.tip_position @ jnp.array([1.0, 2.0, 3.0]) + found.tip_rotation[0, 2]

    factors = np.linspace(0.9, 1.1, 50)
    batched = jax.jit(jax.vmap(jax.grad(loss, argnums=(0, 1))))(tensions, factors)
    gradient = jax.jit(jax.grad(loss, argnums=(0, 1)))
    for k in (0, 17, 49):
        single = gradient(tensions[k], factors[k])
        np.testing.assert_allclose(batched[0][k], single[0], rtol=1e-9, atol=1e-14)
        np.testing.assert_allclose(batched[1][k], single[1], rtol=1e-9, atol=1e-14)
    # one factor for all rows: the derivative is the sum over the rows
    total = jax.jit(jax.grad(lambda f: jax.vmap(loss, (0, None))(tensions, f).sum()))(1.0)
    each = jax.jit(jax.vmap(jax.grad(loss, argnums=1), (0, None)))(tensions, 1.0)
    np.testing.assert_allclose(total, each.sum(), rtol=1e-12)
    # directional derivatives in both modes, also of a batch without vmap
    direction = np.cos(np.arange(150.0)).reshape(50, 3)
    _, forward = jax.jvp(lambda t: solver(t).tip_position, (tensions,), (direction,))
    _, backward = jax.vjp(lambda t: solver(t).tip_position, tensions)
    weights = np.sin(np.arange(150.0)).reshape(50, 3)
    np.testing.assert_allclose(
        (forward * weights).sum(), (backward(weights)[0] * direction).sum(), rtol=1e-12
    )


def test_leading_dimensions_are_broadcast(robot: bs.Robot) -> None:
    solver = bowstring.jax.Solver(robot, load=bs.Load(tip_force=[0.1, 0.0, 0.0]))
    found = solver(rows(4)[:, None], gravity=[[0, 0, -9.81], [0, 0, 9.81], [9.81, 0, 0]])
    assert found.tip_position.shape == (4, 3, 3) and found.tip_rotation.shape == (4, 3, 3, 3)
    assert found.converged.shape == (4, 3) and found.converged.all()
    expected = bs.solve(
        robot, rows(4)[2], load=bs.Load(gravity=[0, 0, 9.81], tip_force=[0.1, 0, 0])
    )
    np.testing.assert_allclose(found.tip_position[2, 1], expected.tip.position, atol=1e-12)
    none = solver(np.zeros((0, 3)))
    assert none.tip_position.shape == (0, 3) and none.converged.shape == (0,)


def test_scans_and_conditions(robot: bs.Robot) -> None:
    solver = bowstring.jax.Solver(robot)

    def along(scale: Any) -> Any:
        def step(total: Any, tensions: Any) -> Any:
            return total + solver(scale * tensions).tip_position[0], None

        return jax.lax.scan(step, 0.0, jnp.asarray(rows(4)))[0]

    each = [jax.grad(lambda s, t=t: solver(s * t).tip_position[0])(1.0) for t in rows(4)]
    np.testing.assert_allclose(jax.jit(jax.grad(along))(1.0), sum(each), rtol=1e-10)


def test_rows_without_equilibrium_are_nan(robot: bs.Robot) -> None:
    solver = bowstring.jax.Solver(robot)
    tensions = np.array([[10.0, 0, 0], [-1.0, 0, 0], [np.nan, 0, 0], [1e7, 0, 0], [20.0, 0, 0]])
    found = jax.jit(jax.vmap(solver))(tensions)
    good = np.array([True, False, False, False, True])
    np.testing.assert_array_equal(found.converged, good)
    np.testing.assert_array_equal(found.stable, good)
    for values in found[:3]:
        known = np.isfinite(values).reshape(5, -1)
        np.testing.assert_array_equal(known.all(1), good)
        np.testing.assert_array_equal(known.any(1), good)
    slopes = jax.vmap(jax.grad(lambda t: solver(t).tip_position[0]))(tensions)
    np.testing.assert_array_equal(np.isfinite(slopes).all(1), good)
    for factor in (-1.0, 1e308, 1e-320):  # the stiffness is then negative, infinite or zero
        assert not solver(TENSIONS, stiffness=[factor]).converged


def test_compiled_functions_outlive_their_solver(robot: bs.Robot) -> None:
    compiled = jax.jit(lambda t: bowstring.jax.Solver(robot)(t).tip_position)
    first = compiled(TENSIONS)
    bowstring.jax.Solver(robot.with_({"segments.0.backbone.E": "30 GPa"}))(TENSIONS)
    np.testing.assert_array_equal(compiled(TENSIONS), first)
    softer = bowstring.jax.Solver(robot.with_({"segments.0.backbone.E": "30 GPa"}))(TENSIONS)
    assert np.abs(softer.tip_position - first).max() > 1e-3
    again = pickle.loads(pickle.dumps(bowstring.jax.Solver(robot, threads=1)))
    np.testing.assert_array_equal(again(TENSIONS).tip_position, first)
    assert repr(again) == "<bowstring.jax.Solver of amouri2019>"


def test_calls_from_several_threads(robot: bs.Robot) -> None:
    solver = bowstring.jax.Solver(robot)
    tip = jax.jit(lambda t: solver(t).tip_position)
    expected = [np.asarray(tip(t)) for t in rows(40)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda t: np.asarray(tip(t)), rows(40)))
    np.testing.assert_array_equal(found, expected)


def test_stiffness_is_that_of_the_backbone(robot: bs.Robot) -> None:
    """A factor of all stiffnesses is one of Young's modulus at the same Poisson's ratio."""
    factor = 0.8
    backbone = robot.segments[0].backbone
    softer = robot.with_(
        {
            "segments.0.backbone.E": factor * backbone.young,
            "segments.0.backbone.G": factor * backbone.shear_modulus,
        }
    )
    expected = bs.solve(softer, TENSIONS, load=bs.Load(**LOADED))
    found = bowstring.jax.Solver(robot)(TENSIONS, stiffness=[factor], **LOADED)
    np.testing.assert_allclose(found.tip_position, expected.tip.position, atol=1e-12)


def test_wrong_arguments(robot: bs.Robot) -> None:
    solver = bowstring.jax.Solver(robot)
    single = jnp.ones(3, jnp.float32)
    refused("float32, it must be float64", lambda: solver(single))
    refused("float32", lambda: jax.jit(solver)(single))
    half = jnp.ones(3, jnp.bfloat16)
    refused("bfloat16, it must be float64", lambda: solver(half))
    refused("must have (..., 3), in N", lambda: solver(jnp.ones(4)))
    refused("shape ()", lambda: solver(1.0))
    refused("bool", lambda: solver(jnp.ones(3, bool)))
    for none in ("none", 10**400, [10**400, 0, 0]):
        refused("not an array of numbers", lambda none=none: solver(none))
    refused("tensions is None", lambda: solver(None))
    refused("broadcast", lambda: solver(np.ones((4, 3)), gravity=np.ones((5, 3))))
    refused(
        "second derivatives",
        lambda: jax.hessian(lambda t: solver(t).tip_position[0])(jnp.asarray(TENSIONS)),
    )
    load = bs.Load([1.0, 0.0, 0.0])
    refused("load has tensions", lambda: bowstring.jax.Solver(robot, load=load))
    rough = robot.with_({"segments.0.tendons.friction": 0.1})
    refused("friction", lambda: bowstring.jax.Solver(rough))
    continuous = bs.RodModel(tendon_path="continuous")
    refused("continuous", lambda: bowstring.jax.Solver(robot, model=continuous))
    refused("threads", lambda: bowstring.jax.Solver(robot, threads=-1))
    refused("Robot", lambda: bowstring.jax.Solver("amouri2019"))  # type: ignore[arg-type]
    jax.config.update("jax_enable_x64", False)
    refused("jax_enable_x64", lambda: solver(TENSIONS))


def test_without_jax(robot: bs.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "jax", None)
    refused("pip install 'bowstring[jax]'", lambda: bowstring.jax.Solver(robot))


def test_calls_that_do_not_fit_are_refused(robot: bs.Robot) -> None:
    """As of an exported program in a process without the solver, which XLA raises as an error."""
    key = bowstring.jax.Solver(robot)._function.core.key
    shapes = [((3,), float), ((3, 3), float), ((3,), float), ((), bool), ((), bool)]
    results = [jax.ShapeDtypeStruct(*shape) for shape in shapes]
    arguments = [np.ones(3)] * 4 + [np.ones(1)]

    def said(robot: str, arguments: Any, results: Any, threads: Any = 0) -> str:
        call = jax.ffi.ffi_call("bowstring_solve", results)
        with pytest.raises(jax.errors.JaxRuntimeError) as error:
            jax.block_until_ready(call(*arguments, robot=robot, threads=np.int64(threads)))
        return str(error.value)

    assert "robot 00 is not known in this process: make its" in said("00", arguments, results)
    assert "4 arguments" in said(key, arguments[:4], results)
    assert "4 results" in said(key, arguments, results[:4])
    wrong = [np.ones(4), *arguments[1:]]
    assert "tensions has 4 entries of type 12, it must have 3" in said(key, wrong, results)
    single = [np.ones(3, np.float32), *arguments[1:]]
    assert "entries of type 11, it must have 3 of type 12" in said(key, single, results)
    assert "attributes robot and threads" in said(key, arguments, results, threads=-1)


def test_keys_are_the_same_in_every_process(robot: bs.Robot) -> None:
    """JAX may keep compiled programs on disk: a key must not mean another robot there."""
    code = (
        "import bowstring as bs, bowstring.jax\n"
        "robot = bs.load_robot('amouri2019')\n"
        "softer = robot.with_({'segments.0.backbone.E': '30 GPa'})\n"
        "for each in (softer, robot):\n"
        "    print(bowstring.jax.Solver(each)._function.core.key)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    softer, own = done.stdout.split()
    assert own == bowstring.jax.Solver(robot)._function.core.key != softer


def test_examples_of_the_docstrings() -> None:
    result = doctest.testmod(bowstring.integrations.jax)
    assert result.attempted and not result.failed
