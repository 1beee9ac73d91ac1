"""Richardson's extrapolation, and a real mesh study."""

from __future__ import annotations

import numpy as np
import pytest

from bowstring.errors import InputError
from bowstring.fem import Settings
from bowstring.fem.convergence import extrapolated, study
from bowstring.fem.mesh import Fineness
from fem_robots import COARSE, needs_ccx, small_robot


@pytest.mark.parametrize("order", [1.0, 2.0, 3.7])
@pytest.mark.parametrize("sizes", [(1.0, 0.5, 0.25), (1 / 8, 1 / 12, 1 / 16), (10.0, 1.0, 0.1)])
def test_errors_of_one_order_are_removed(order: float, sizes: tuple[float, ...]) -> None:
    slope = np.array([[1.0, -2.0, 0.0]])
    values = np.array([np.array([[5.0, 6.0, 7.0]]) + slope * h**order for h in sizes])
    limit, uncertainty, seen = extrapolated(sizes, values)
    np.testing.assert_allclose(limit, [[5.0, 6.0, 7.0]], rtol=1e-9)
    np.testing.assert_allclose(uncertainty, np.abs(limit - values[2]), atol=1e-12)
    assert seen == pytest.approx(order, rel=1e-6)


@pytest.mark.parametrize("values", [(1.0, 2.0, 1.9), (1.0, 1.1, 1.3), (1.0, 1.0, 1.0)])
def test_without_an_order_changes_are_the_uncertainty(values: tuple[float, ...]) -> None:
    limit, uncertainty, seen = extrapolated((1.0, 0.5, 0.25), np.array(values)[:, None])
    assert limit == values[2]
    assert uncertainty == max(abs(values[1] - values[0]), abs(values[2] - values[1]))
    assert np.isnan(seen)


def test_a_component_without_convergence_is_not_extrapolated() -> None:
    sizes = np.array([1.0, 0.5, 0.25])
    settling, restless, slow = 1.0 + sizes**2, [1.0, 1.02, 1.01], [1.0, 1.001, 1.003]
    limit, uncertainty, seen = extrapolated(sizes, np.array([settling, restless, slow]).T)
    assert seen == pytest.approx(2.0)
    np.testing.assert_allclose(limit, [1.0, 1.01, 1.003], rtol=1e-12)
    np.testing.assert_allclose(uncertainty, [0.0625, 0.02, 0.002], rtol=1e-9)


@needs_ccx
@pytest.mark.usefixtures("own_cache")
def test_a_study_refines_one_thing_at_a_time() -> None:
    reported: list[float] = []
    found = study(
        small_robot(),
        [[40.0, 0, 0]],
        settings=COARSE,
        progress=lambda _, share: reported.append(share),
    )
    names = {r.name: r.labels for r in found.refinements}
    assert names == {
        "bricks along a module": ("2", "2", "4"),
        "bricks around": ("4", "8", "12"),
        "stiffness of disks": ("100", "300", "1000"),
    }
    assert reported == sorted(reported) and reported[-1] <= 1.0
    # 4 bricks around are too stiff: the limit bends more, and the error states the uncertainty
    assert found.limit[0, 0] > found.run.tip_position[0, 0]
    assert found.error[0] > 1e-6


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        (Settings(stiffness=50.0), "takes 5 as stiffness of disks: disks are 5 times"),
        (Settings(Fineness(4, 64, 1)), "takes 68 as bricks around: the mesh has 68"),
        (Settings(Fineness(200, 4, 1)), "takes 400 as bricks along a module: the mesh has 400"),
    ],
)
def test_impossible_refinements_are_reported_before_any_work(settings: Settings, says: str) -> None:
    with pytest.raises(InputError, match=says):
        study(small_robot(), [[40.0, 0, 0]], settings=settings)
