"""Equilibria in PyTorch: the numbers and derivatives of the core."""

from __future__ import annotations

import pickle
import sys
from typing import Any

import numpy as np
import pytest

import bowstring as bs
import bowstring.torch
from bowstring.integrations import torch as module
from objects import refused

LOADED = {
    "gravity": np.array([0.0, 0.0, -9.81]),
    "tip_force": np.array([0.2, -0.3, 0.1]),
    "tip_moment": np.array([0.03, 0.05, -0.02]),
}
TENSIONS = np.array([30.0, 12.0, 5.0])


@pytest.fixture(scope="module")
def torch() -> Any:
    return pytest.importorskip("torch", reason="needs torch", exc_type=ImportError)


def rows(count: int) -> np.ndarray:
    return np.random.default_rng(1).uniform(0.0, 40.0, (count, 3))


def test_numbers_are_those_of_the_core(torch: Any, robot: bs.Robot) -> None:
    solver = bowstring.torch.Solver(robot)
    one = solver(TENSIONS, **LOADED)
    expected = bs.solve(robot, TENSIONS, load=bs.Load(**LOADED))
    np.testing.assert_array_equal(one.tip_position, expected.tip.position)
    np.testing.assert_array_equal(one.tip_rotation, expected.tip.rotation)
    np.testing.assert_array_equal(one.tendon_lengths, expected.tendon_lengths)
    tensions = torch.from_numpy(rows(1000))
    batch = bs.solve_batch(robot, rows(1000), disks=False)
    for found in (solver(tensions), torch.vmap(solver)(tensions)):
        np.testing.assert_array_equal(found.tip_position, batch.tip_position)
        np.testing.assert_array_equal(found.tip_rotation, batch.tip_rotation)
        np.testing.assert_array_equal(found.tendon_lengths, batch.tendon_lengths)
        np.testing.assert_array_equal(found.converged, batch.converged)
        assert found.converged.dtype == torch.bool


def test_derivatives_are_those_of_the_core(torch: Any, robot: bs.Robot) -> None:
    solver = bowstring.torch.Solver(robot)
    solution = bs.solve(robot, TENSIONS, load=bs.Load(**LOADED))
    by = bs.jacobians(solution)
    names = {
        "tensions": "tension",
        "tip_force": "tip_force",
        "tip_moment": "tip_moment",
        "stiffness": "stiffness",
    }
    given = {"tensions": TENSIONS, **LOADED, "stiffness": np.ones(1)}
    given = {name: torch.from_numpy(value.copy()) for name, value in given.items()}
    position, rotation, lengths = (
        torch.func.jacrev(lambda of, k=k: solver(**{**given, **of})[k])(
            {name: given[name] for name in names}
        )
        for k in range(3)
    )
    for argument, name in names.items():
        turns = getattr(by, f"tip_rotation_by_{name}")
        rotated = [np.cross(turn, solution.tip.rotation.T).T for turn in turns.T]
        for found, wanted in (
            (position, getattr(by, f"tip_position_by_{name}")),
            (rotation, np.stack(rotated, axis=-1)),
            (lengths, getattr(by, f"lengths_by_{name}")),
        ):
            np.testing.assert_allclose(found[argument], wanted, rtol=1e-10, atol=1e-12)


def test_backward_of_batches(torch: Any, robot: bs.Robot) -> None:
    solver = bowstring.torch.Solver(robot)
    tensions = torch.from_numpy(rows(20)).requires_grad_()
    factor = torch.ones(1, dtype=torch.float64, requires_grad=True)
    weights = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)

    def losses(tensions: Any, factor: Any) -> Any:
        found = solver(tensions, stiffness=factor)
        return found.tip_position @ weights + found.tip_rotation[..., 0, 2]

    losses(tensions, factor).sum().backward()
    single = torch.func.grad(losses, argnums=(0, 1))
    each = [single(row, factor.detach()) for row in tensions.detach()]
    np.testing.assert_allclose(tensions.grad, torch.stack([e[0] for e in each]), rtol=1e-9)
    np.testing.assert_allclose(factor.grad, sum(e[1] for e in each), rtol=1e-9)
    mapped = torch.vmap(single, (0, None))(tensions.detach(), factor.detach())
    np.testing.assert_allclose(mapped[0], tensions.grad, rtol=1e-9)
    assert torch.autograd.gradcheck(
        lambda t, f, g: tuple(solver(t, tip_force=f, gravity=g))[:3],
        (
            tensions[:2].detach().requires_grad_(),
            torch.zeros(3).double().requires_grad_(),
            torch.tensor([0.0, 0.1, -9.81]).double().requires_grad_(),
        ),
        eps=1e-3,
        atol=1e-6,
    )


def test_rows_without_equilibrium_are_nan(torch: Any, robot: bs.Robot) -> None:
    found = bowstring.torch.Solver(robot)([[10.0, 0, 0], [-1.0, 0, 0], [1e7, 0, 0]])
    np.testing.assert_array_equal(found.converged, [True, False, False])
    assert found.tip_position.isnan().any(1).tolist() == [False, True, True]


def test_wrong_arguments(torch: Any, robot: bs.Robot) -> None:
    solver = bowstring.torch.Solver(robot)
    again = pickle.loads(pickle.dumps(solver))
    assert repr(again) == "<bowstring.torch.Solver of amouri2019>"
    refused("float32, it must be float64", lambda: solver(torch.ones(3)))
    refused("must have (..., 3), in N", lambda: solver(torch.ones(4).double()))
    refused("bool", lambda: solver(torch.ones(3, dtype=torch.bool)))
    for none in ("none", 10**400, [10**400, 0, 0]):
        refused("not an array of numbers", lambda none=none: solver(none))
    refused("on meta", lambda: solver(torch.ones(3, device="meta")))
    tensions = torch.from_numpy(TENSIONS.copy()).requires_grad_()
    (slope,) = torch.autograd.grad(solver(tensions).tip_position[0], tensions, create_graph=True)
    refused("second derivatives", lambda: slope.sum().backward())


def test_without_torch(robot: bs.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    module._torch.cache_clear()
    refused("pip install torch", lambda: bowstring.torch.Solver(robot))


def test_torch_without_its_libraries(robot: bs.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(name: str) -> None:
        raise OSError("libcudart.so.12:\n cannot open shared object file")

    monkeypatch.setattr("importlib.import_module", broken)
    module._torch.cache_clear()
    says = "(libcudart.so.12: cannot open shared object file); install it: pip install torch"
    refused(says, lambda: bowstring.torch.Solver(robot))
