"""Mass and inertia of a drilled disk against integrals, and robots whose disks have a density."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bowstring.errors import InputError
from bowstring.robot.disk import distinct_holes, drilled_disk, room_for_holes
from bowstring.robot.model import Robot
from bowstring.robot.reader import load_robot

HEAVY = {"segments.0.disks.density": "1200 kg/m^3", "segments.0.disks.hole_diameter": "2 mm"}


def by_integration(density, radius, thickness, bore, holes, width):
    """Mass and moments of full cylinders minus holes, each summed over a polar grid (exact)."""
    total = np.zeros(4)  # mass, about x, about y, about z
    nodes, weights = np.polynomial.legendre.leggauss(6)
    angles = math.tau / 16 * np.arange(16)
    cylinders = [(1, radius, 0, 0), (-1, bore / 2, 0, 0), *((-1, width / 2, *h) for h in holes)]
    for sign, r, x0, y0 in cylinders:
        for u, w in zip(nodes, weights, strict=True):
            s = r * (u + 1) / 2
            x, y = x0 + s * np.cos(angles), y0 + s * np.sin(angles)
            m = sign * density * thickness * s * w * r / 2 * math.tau / 16
            zz = thickness**2 / 12
            total += m * np.array([16, (y**2 + zz).sum(), (x**2 + zz).sum(), (x**2 + y**2).sum()])
    return total


@settings(max_examples=50)
@given(
    st.lists(st.floats(0, math.tau), max_size=6),
    st.floats(0.1, 10),
    st.floats(0, 0.4),
    st.floats(0.001, 0.2),
)
def test_mass_and_moments_match_integration(angles, thickness, bore, width):
    holes = [(0.7 * math.cos(a), 0.7 * math.sin(a)) for a in angles]
    made = drilled_disk(1200.0, 1.0, thickness, bore, holes, width)
    mass, x, y, z = by_integration(1200.0, 1.0, thickness, bore, holes, width)
    np.testing.assert_allclose(made, [mass, (x + y) / 2, z], rtol=1e-12)


def test_three_holes_make_all_diameters_equal():
    holes = [
        (0.7 * math.cos(a), 0.7 * math.sin(a))
        for a in (0.2, 0.2 + math.tau / 3, 0.2 + 2 * math.tau / 3)
    ]
    _, x, y, _ = by_integration(1.0, 1.0, 0.1, 0.2, holes, 0.2)
    assert x == pytest.approx(y, rel=1e-12)


def test_shared_holes_count_once():
    assert len(load_robot("rao2021").holes(0)) == 3
    crl = load_robot("crl-ftdcr-v4")
    assert [len(crl.holes(k)) for k in range(3)] == [9, 6, 3]
    almost = [[1.0, 0.0], [0.0, 1.0], [1.0 + 1e-12, 1e-12], [1.001, 0.0]]
    assert distinct_holes(almost).tolist() == [[1, 0], [0, 1], [1.001, 0]]
    assert distinct_holes([]).shape == (0, 2)


def test_hole_clearance_ends_at_rim_bore_or_neighbour():
    cases = [(0.9, "rim", 0.2), (0.3, "backbone", 0.4), (0.6, "each other", 0.12)]
    for away, what, angle in cases:
        holes = [(away, 0.0), (away * math.cos(angle), away * math.sin(angle))]
        limit, fault = room_for_holes(holes[: 1 if what != "each other" else 2], 1.0, 0.2)
        assert what in fault
        expected = {"rim": 0.2, "backbone": 0.4}.get(what, 2 * away * math.sin(angle / 2))
        assert limit == pytest.approx(expected, rel=1e-12)


def test_density_gives_the_masses_of_a_robot():
    robot = load_robot("amouri2019", HEAVY)
    rho, t = 1200, 0.003
    area = math.pi * (0.032**2 - 0.0025**2 - 3 * 0.001**2)
    np.testing.assert_allclose(robot.disks.mass_kg, rho * t * area, rtol=1e-14)
    axial = (
        rho * t * math.pi / 2 * (0.032**4 - 0.0025**4 - 3 * (0.001**4 + 2 * (0.001 * 0.029) ** 2))
    )
    np.testing.assert_allclose(robot.disks.inertia_kg_m2[:, 1], axial, rtol=1e-13)
    # the built-in robot without a density is unchanged
    plain = load_robot("amouri2019")
    np.testing.assert_allclose(plain.disks.inertia_kg_m2[:, 1], 0.02 * 0.032**2 / 2, rtol=1e-15)


def test_the_bore_of_an_end_disk_fits_the_thicker_backbone():
    path = "segments.{}.disks."
    made = load_robot(
        "rao2021",
        {
            "segments.1.backbone.diameter": "2 mm",
            **{path.format(k) + "density": "1200 kg/m^3" for k in (0, 1)},
            **{path.format(k) + "hole_diameter": "1 mm" for k in (0, 1)},
        },
    )
    assert made.disks.bore_m.tolist() == [0.0014] * 9 + [0.002] * 11
    first, end = made.disks.mass_kg[[0, 9]]
    ring = 1200 * 0.002 * math.pi / 4 * (0.002**2 - 0.0014**2)
    assert first - end == pytest.approx(ring, rel=1e-9)


def test_density_matters_to_motion_and_hash():
    one, two = (load_robot("amouri2019", HEAVY | {"gravity": "0 0 -9.81"}) for _ in range(2))
    heavier = one.with_({"segments.0.disks.density": 2400})
    wider = one.with_({"segments.0.disks.hole_diameter": "4 mm"})
    assert one.hash == two.hash
    assert len({one.hash, heavier.hash, wider.hash}) == 3
    # geometry that no model uses is not in the hash
    plain = load_robot("amouri2019")
    drawn = plain.with_(
        {"segments.0.disks.hole_diameter": "2 mm", "segments.0.tendons.diameter": "1 mm"}
    )
    assert drawn.hash == plain.hash
    assert drawn.tendons.diameter_m.tolist() == [0.001] * 3
    assert np.isnan(plain.tendons.diameter_m).all()


def test_mass_and_density_replace_each_other():
    robot = load_robot("amouri2019", HEAVY)
    assert robot.segments[0].disks.mass is None
    again = robot.with_({"segments.0.disks.mass": "20 g"})
    assert (again.segments[0].disks.mass, again.segments[0].disks.density) == (0.02, None)
    assert Robot.model_validate(robot.model_dump(mode="json", exclude_none=True)) == robot


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"segments.0.disks.density": 1200}, "hole_diameter: missing; with density"),
        ({"segments.0.disks.mass": None}, "mass and density: missing; write exactly one"),
        (
            {"segments.0.disks.hole_diameter": "6 mm"},
            "hole_diameter: got 6 mm; the disk does not hold such holes, they would break out of "
            "its rim; must be smaller than 6 mm",
        ),
        (
            {
                "segments.0.tendons.pitch_radius": "4 mm",
                "segments.0.disks.hole_diameter": "4 mm",
            },
            "they would meet the hole of the backbone; must be smaller than 3 mm",
        ),
        (
            {"segments.0.tendons.count": 100, "segments.0.disks.hole_diameter": "2 mm"},
            "they would meet each other; must be smaller than 1.822 mm",
        ),
        (
            {"segments.0.disks.hole_diameter": "2 mm", "segments.0.tendons.diameter": "2 mm"},
            "segments[0].tendons.diameter: got 2 mm; must be smaller than the holes that it "
            "passes, segments[0].disks.hole_diameter = 2 mm",
        ),
    ],
)
def test_impossible_disks_are_refused(change, says):
    with pytest.raises(InputError) as caught:
        load_robot("amouri2019", change)
    assert says in str(caught.value)


def test_a_density_in_the_wrong_unit_gives_a_warning():
    robot = load_robot("amouri2019", HEAVY | {"segments.0.disks.density": "1.2 kg/m^3"})
    assert any("disks.density = 1.2 kg/m^3" in w for w in robot.warnings)
    assert not load_robot("amouri2019", HEAVY).warnings
