"""Fields of a run against closed forms and brute force."""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import bowstring as bs
from bowstring import load_robot
from bowstring.errors import InputError
from bowstring.robot.model import Robot
from bowstring.statics import fields
from made_frames import made_frames

TIMES = np.arange(0.0, 0.5, 0.05)
ROBOT = load_robot("amouri2019")
TUBE = load_robot("amouri2019", {"segments.0.backbone.inner_diameter": "4 mm"})
STEPPED = load_robot("rao2021", {"segments.1.backbone.diameter": "1 mm"})


def wrench(robot, rng, times=TIMES, scale=1.0):
    """Fields with random internal force and moment."""
    frames = made_frames(robot, times)
    shape = frames.force.shape
    return dataclasses.replace(
        frames, force=scale * rng.normal(0, 50, shape), moment=scale * rng.normal(0, 2, shape)
    )


def brute_force(robot, frames, count=20_000):
    """Largest von Mises stress around each section, by the textbook formulas, one by one."""
    psi = np.linspace(-math.pi, math.pi, count, endpoint=False)
    out = np.empty(frames.force.shape[:2])
    for t, p in np.ndindex(out.shape):
        rod = robot.segments[robot.disks.segment[frames.module[p]]].backbone
        ro, ri = rod.diameter / 2, rod.inner_diameter / 2
        area = math.pi * (ro**2 - ri**2)
        second = math.pi / 4 * (ro**4 - ri**4)
        fx, fy, fz = frames.force[t, p]
        mx, my, mz = frames.moment[t, p]

        def square(a, ro=ro, ri=ri):
            x, y = ro * np.cos(a), ro * np.sin(a)
            sigma = fz / area + (mx * y - my * x) / second  # noqa: B023
            # Q / (I b) at the neutral axis: Q is the half ring's moment of area, b both walls
            parabolic = 2 / 3 * (ro**3 - ri**3) / (second * 2 * (ro - ri))  # noqa: B023
            tau = mz * ro / (2 * second)  # noqa: B023
            tau = tau + parabolic * (-fx * np.sin(a) + fy * np.cos(a))  # noqa: B023
            return sigma**2 + 3 * tau**2

        best = psi[square(psi).argmax()]
        low, high = best - 2 * math.pi / count, best + 2 * math.pi / count
        for _ in range(60):
            a, b = low + (high - low) / 3, high - (high - low) / 3
            low, high = (a, high) if square(a) < square(b) else (low, b)
        out[t, p] = math.sqrt(square(0.5 * (low + high)))
    return out


@pytest.mark.parametrize("robot", [ROBOT, TUBE, STEPPED], ids=["solid", "tube", "stepped"])
def test_von_mises_is_the_maximum_around_the_surface(robot):
    frames = wrench(robot, np.random.default_rng(1), TIMES[:2])
    data = fields.to_dataset(robot, frames, {})
    expected = brute_force(robot, frames)
    np.testing.assert_allclose(data.von_mises, expected, rtol=1e-9)
    np.testing.assert_allclose(data.von_mises_max, expected.max(axis=1), rtol=1e-9)
    top = expected.argmax(axis=1)
    np.testing.assert_array_equal(data.von_mises_max_arc_length, frames.station[top])
    np.testing.assert_array_equal(
        data.von_mises_max_place, data.von_mises_place.values[[0, 1], top]
    )


def test_planar_bending_with_compression():
    """The largest axial stress is |M| d / (2 I) + |N| / A, where both are compressive."""
    frames = made_frames(ROBOT, TIMES, force=(0.0, 0.0, -80.0))
    data = fields.to_dataset(ROBOT, frames, {})
    rod = ROBOT.segments[0].backbone
    bending = abs(frames.moment[..., 1]) * rod.diameter / (2 * rod.second_moment)
    largest = bending + 80.0 / rod.area
    np.testing.assert_allclose(data.normal_stress, largest, rtol=1e-12)
    np.testing.assert_allclose(data.von_mises, largest, rtol=1e-12)
    np.testing.assert_allclose(data.axial_stress, -80.0 / rod.area, rtol=1e-12)
    # bent towards +x, so the inner side is at angle 0
    np.testing.assert_allclose(data.von_mises_angle[1:], 0.0, atol=1e-6)
    inner = frames.position + 0.5 * rod.diameter * frames.rotation[..., 0]
    np.testing.assert_allclose(data.von_mises_place[1:], inner[1:], atol=1e-8)


def test_parts_of_the_stress():
    frames = wrench(ROBOT, np.random.default_rng(2))
    data = fields.to_dataset(ROBOT, frames, {})
    rod = ROBOT.segments[0].backbone
    d, area, second = rod.diameter, rod.area, rod.second_moment
    force, moment = frames.force, frames.moment
    bending = np.hypot(moment[..., 0], moment[..., 1]) * d / (2 * second)
    shear = 4 / 3 * np.hypot(force[..., 0], force[..., 1]) / area
    np.testing.assert_allclose(data.bending_stress, bending, rtol=1e-12)
    np.testing.assert_allclose(data.axial_stress, force[..., 2] / area, rtol=1e-12)
    np.testing.assert_allclose(data.shear_stress, shear, rtol=1e-12)
    np.testing.assert_allclose(data.torsion_stress, abs(moment[..., 2]) * d / (4 * second), 1e-12)
    assert (
        data.von_mises <= np.hypot(data.normal_stress, 3**0.5 * (shear + data.torsion_stress))
    ).all()


def test_a_thin_tube_carries_shear_at_twice_the_mean():
    robot = load_robot("amouri2019", {"segments.0.backbone.inner_diameter": "4.999 mm"})
    frames = made_frames(robot, TIMES[:1], force=(3.0, 4.0, 0.0))
    data = fields.to_dataset(robot, frames, {})
    np.testing.assert_allclose(
        data.shear_stress, 2.0 * 5.0 / robot.segments[0].backbone.area, rtol=1e-4
    )


COEFFICIENT = st.floats(-1e9, 1e9).map(lambda x: 0.0 if abs(x) < 1e-3 else x)
THREE = st.tuples(COEFFICIENT, COEFFICIENT, COEFFICIENT)


@settings(max_examples=300, deadline=None)
@given(THREE, THREE, st.sampled_from(["any", "no shear", "no mean", "round", "flat"]))
def test_maximum_in_all_special_cases(sigma, tau, case):
    s, t = np.array(sigma), np.array(tau)
    if case == "no shear":
        t[:] = 0.0
    if case == "no mean":
        s[0] = t[0] = 0.0
    if case in ("round", "flat"):  # the square's quadratic form is a circle
        t[1:] = np.array([-s[2], s[1]]) / math.sqrt(3.0)
    if case == "flat":  # nearly constant around the circumference
        s[0] *= 1e-9
        t[0] *= 1e-9
    value, c, w = fields.von_mises(s[:, None], t[:, None])

    def at(psi):
        normal = s[0] + s[1] * np.cos(psi) + s[2] * np.sin(psi)
        shear = t[0] + t[1] * np.cos(psi) + t[2] * np.sin(psi)
        return np.sqrt(normal**2 + 3.0 * shear**2)

    psi = np.linspace(-math.pi, math.pi, 2001)
    near = psi[at(psi).argmax()] + np.linspace(-0.004, 0.004, 2001)
    near = near[at(near).argmax()] + np.linspace(-5e-6, 5e-6, 101)
    scale = abs(s).max() + abs(t).max()
    assert value[0] >= at(near).max() * (1 - 1e-12) - 1e-15 * scale
    assert value[0] == pytest.approx(
        float(at(math.atan2(w[0], c[0]))), rel=1e-12, abs=1e-13 * scale
    )
    assert math.hypot(c[0], w[0]) == pytest.approx(1.0, abs=1e-12)


def test_curvature_of_an_arc_and_strain():
    frames = made_frames(ROBOT, TIMES, force=(3.0, 0.0, -80.0))
    kappa = 2.0 * np.sin(2.0 * TIMES)
    rod = ROBOT.segments[0].backbone
    data = fields.to_dataset(ROBOT, frames, {"theory": "cosserat"})
    np.testing.assert_allclose(
        data.curvature.sel(axis="y"), np.tile(kappa[:, None], frames.station.size), rtol=1e-12
    )
    assert not data.curvature.sel(axis=["x", "z"]).any()
    np.testing.assert_allclose(data.strain.sel(axis="z"), -80.0 / (rod.E * rod.area), rtol=1e-12)
    np.testing.assert_allclose(
        data.strain.sel(axis="x"), 3.0 / (rod.shear_modulus * rod.area), rtol=1e-12
    )
    kirchhoff = fields.to_dataset(ROBOT, frames, {"theory": "kirchhoff"})
    assert not kirchhoff.strain.any()
    turned = dataclasses.replace(frames, moment=frames.moment[..., [0, 2, 1]])
    twisted = fields.to_dataset(ROBOT, turned, {})
    np.testing.assert_allclose(
        twisted.curvature.sel(axis="z"), (1.3 * data.curvature.sel(axis="y")), rtol=1e-12
    )  # G J = E I / (1 + nu)
    assert not fields.to_dataset(ROBOT, turned, {"twist": False}).curvature.any()


def test_clamped_backbone_is_rigid():
    robot = load_robot("amouri2019", {"segments.0.disks.clamped_length": "30 mm"})
    data = fields.to_dataset(robot, made_frames(robot, TIMES[1:2]), {})
    distance = abs(data.arc_length - data.disk_arc_length).min("disk")
    assert ((data.curvature.sel(axis="y")[0] == 0.0) == (distance < 0.015)).all()


def test_tip_displacement_and_energy():
    frames = made_frames(STEPPED, TIMES)
    data = fields.to_dataset(STEPPED, frames, {})
    kappa = 2.0 * np.sin(2.0 * TIMES)
    length = STEPPED.disks.station_m[STEPPED.tendons.end_disk]
    np.testing.assert_allclose(
        data.tendon_displacement, STEPPED.tendons.hole_m[:, 0] * length * kappa[:, None], atol=1e-15
    )
    np.testing.assert_allclose(data.tip_displacement[0], 0.0, atol=1e-15)
    np.testing.assert_allclose(
        data.tip_displacement, frames.disk_position[:, -1] - [0, 0, STEPPED.length], atol=1e-15
    )
    np.testing.assert_allclose(data.energy_balance, 0.001 * TIMES, atol=1e-12)
    assert np.isnan(data.span_length.sel(disk=11, tendon=[1, 2, 3])).all()
    assert data.segment.sel(station=[0, -1]).values.tolist() == [1, 2]
    assert data.module[-1] == 20


def test_every_variable_is_described():
    data = fields.to_dataset(ROBOT, made_frames(ROBOT, TIMES), {})
    for name, variable in data.data_vars.items():
        assert variable.attrs["units"], name
        assert variable.attrs["long_name"], name
        assert ("frame" in variable.attrs) or not ({"axis", "row"} & set(variable.dims)), name
        assert variable.dims[0] == "time" and variable.dtype == np.float64
    for name, coordinate in data.coords.items():
        assert coordinate.attrs["long_name"], name
    assert data.attrs["data_origin"] == "simulated"
    assert data.attrs["robot_hash"] == ROBOT.hash


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"time": TIMES[::-1]}, "time of the frames must be finite and increase"),
        ({"time": np.full(10, np.nan)}, "must be finite"),
        ({"module": np.full(45, 9)}, "0 to 8"),
        ({"force": np.zeros((10, 45, 2))}, r"force of the frames has shape \(10, 45, 2\)"),
        ({"tension": np.zeros((10, 4))}, "must be \\(10, 3\\) for amouri2019"),
        ({"work": np.zeros(9)}, "work of the frames"),
    ],
)
def test_bad_frames(change, says):
    frames = dataclasses.replace(made_frames(ROBOT, TIMES), **change)
    with pytest.raises(InputError, match=says):
        fields.to_dataset(ROBOT, frames, {})


@pytest.mark.parametrize("value", [lambda t: t, math.nan, np.array([math.inf])])
def test_bad_settings(value):
    with pytest.raises(InputError, match="settings of a run must be plain values"):
        fields.to_dataset(ROBOT, made_frames(ROBOT, TIMES), {"tension": value})


def test_one_time_and_no_times():
    one = fields.to_dataset(ROBOT, made_frames(ROBOT, TIMES[:1]), {})
    assert one.sizes["time"] == 1 and one.attrs["complete_to_s"] == 0.0
    none = fields.to_dataset(ROBOT, made_frames(ROBOT, TIMES[:0]), {})
    assert none.sizes["time"] == 0 and math.isnan(none.attrs["complete_to_s"])


def test_heavy_imports_are_lazy():
    code = "import sys, bowstring, bowstring.dynamics.run_file;"
    code += "import bowstring.viz.vtk, bowstring.viz.animation;"
    code += "print([m for m in ('xarray', 'netCDF4', 'matplotlib', 'pandas') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_rows_and_modes_have_labels_and_units() -> None:
    robot = bs.load_robot("rao2021")
    rows = bs.sweep(robot, [[0, 0, 0, 0, 0, 0], [2, 0, 0, 1, 0, 0]])
    data = rows.to_dataset()
    np.testing.assert_array_equal(data.tip_position.sel(load=2), rows.tip_position[1])
    np.testing.assert_array_equal(data.disk_position.sel(disk=20), rows.tip_position)
    assert data.tension.dims == ("load", "tendon") and data.tension.units == "N"
    assert data.tension.sel(load=2, tendon=4).item() == 1.0
    assert data.status.values.tolist() == rows.status and data.converged.all()
    assert data.attrs["robot_hash"] == robot.hash and "station" not in data.dims
    bare = bs.sweep(robot, [[0.0] * 6], disks=False).to_dataset()
    assert "disk_position" not in bare and bare.sizes["load"] == 1
    found = bs.modes(robot, count=3)
    modes = found.to_dataset()
    assert modes.displacement.dims == ("mode", "disk", "axis")
    np.testing.assert_array_equal(modes.frequency, found.frequency_hz)
    assert modes.frequency.units == "Hz" and modes.kind.values.tolist() == found.kind


def test_round_trip_through_netcdf(tmp_path):
    settings = {
        "theory": "cosserat",
        "twist": True,
        "damping": None,
        "tip_force_N": [0, 0, 1.5],
        "µ": "ü",
    }
    data = fields.to_dataset(
        STEPPED,
        made_frames(STEPPED, TIMES),
        settings,
        status="failed",
        reason="the step became ½ ns",
    )
    data.to_netcdf(tmp_path / "run.nc")
    back = xr.load_dataset(tmp_path / "run.nc")
    xr.testing.assert_identical(back, data)
    assert json.loads(back.attrs["settings"]) == settings
    assert Robot.model_validate_json(back.attrs["robot_definition"]).hash == STEPPED.hash
