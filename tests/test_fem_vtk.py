"""Finite elements for ParaView."""

from __future__ import annotations

import base64
import re
import struct
from pathlib import Path

import numpy as np
import pytest

from bowstring.fem import BrickRun, deck
from bowstring.fem.fields import State
from bowstring.fem.mesh import Fineness, brick_mesh
from bowstring.fem.vtk import von_mises, write_vtk
from fem_robots import small_robot
from objects import refused

YOUNG = 35e9


def stretched(strain: float) -> BrickRun:
    """A synthetic run with uniform axial strain."""
    robot = small_robot()
    mesh = brick_mesh(robot, Fineness(2, 4, 1))
    free = int((~mesh.stiff).sum())
    tensor = np.zeros((free, 8, 6))
    tensor[..., 2] = strain
    spans = len(deck.spans(mesh).first)
    moved = mesh.nodes * [0.0, 0.0, strain]
    state = State(moved, None, YOUNG * tensor, tensor, np.zeros((spans, 3)))
    settings = {"rise_s": None, "gravity": [0.0] * 3, "tip_force": [0.0] * 3}
    return BrickRun(robot, mesh, settings, np.zeros(1), np.zeros((1, 3)), [state])


def array(text: str, name: str) -> np.ndarray:
    found = re.search(rf'type="(\w+)" Name="{name}"[^>]*>([^<]*)<', text)
    assert found is not None, name
    raw = base64.b64decode(found[2])
    (size,) = struct.unpack("=Q", raw[:8])
    assert size == len(raw) - 8
    return np.frombuffer(raw[8:], {"Float32": "f4", "Int32": "i4", "UInt8": "u1"}[found[1]])


def test_bricks_with_displacement_stress_and_strain(tmp_path: Path) -> None:
    run = stretched(1e-3)
    pvd = write_vtk(run, tmp_path / "series")
    assert 'data_origin="simulated by finite elements"' in pvd.read_text()
    text = (pvd.parent / "backbone_00000.vtu").read_text()
    points = array(text, "points").reshape(-1, 3)
    assert points[:, 2].max() == pytest.approx(0.140 * 1.001)
    assert set(array(text, "types").tolist()) == {25}
    cells = array(text, "connectivity").reshape(-1, 20)
    assert cells.min() == 0 and cells.max() == len(points) - 1
    stress = array(text, "stress_Pa").reshape(-1, 6)
    there = np.isfinite(stress[:, 0])
    np.testing.assert_allclose(stress[there, 2], 35e6, rtol=1e-6)
    np.testing.assert_allclose(array(text, "von_mises_Pa")[there], 35e6, rtol=1e-6)
    np.testing.assert_allclose(array(text, "strain").reshape(-1, 6)[there, 2], 1e-3, rtol=1e-6)
    disks = (pvd.parent / "disks_00000.vtu").read_text()
    reach = np.hypot(*array(disks, "points").reshape(-1, 3)[:, :2].T)
    assert reach.max() > 0.029
    assert (pvd.parent / "tendons_00000.vtu").exists()


def test_fields_of_a_stretched_backbone() -> None:
    """Axial force from stress over sections: E A strain."""
    run = stretched(1e-3)
    fields = run.to_dataset().isel(time=0)
    area = np.pi / 4 * 0.005**2
    np.testing.assert_allclose(fields.force.sel(axis="z"), YOUNG * area * 1e-3, rtol=0.012)
    np.testing.assert_allclose(fields.moment, 0.0, atol=1e-9)
    np.testing.assert_allclose(fields.rotation, np.broadcast_to(np.eye(3), (8, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(fields.position.sel(axis="z"), 1.001 * fields.arc_length, rtol=1e-12)
    np.testing.assert_allclose(run.section_stress().largest, 35e6, rtol=1e-9)
    np.testing.assert_allclose(run.section_stress().peak, 35e6, rtol=1e-9)


def test_tensors_are_in_the_order_of_paraview(tmp_path: Path) -> None:
    run = stretched(0.0)
    state = run.states[0]
    state.stress[..., :] = state.strain[..., :] = [1, 2, 3, 12, 13, 23]  # xx, yy, zz, xy, xz, yz
    text = (write_vtk(run, tmp_path / "series").parent / "backbone_00000.vtu").read_text()
    for name in ("stress_Pa", "strain"):
        rows = array(text, name).reshape(-1, 6)
        there = rows[np.isfinite(rows[:, 0])]
        np.testing.assert_allclose(there, np.tile([1, 2, 3, 12, 23, 13], (len(there), 1)), 1e-5)


def test_von_mises_of_known_stress() -> None:
    stress = np.array([[3.0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 2.0, 0], [5.0, 5.0, 5.0, 0, 0, 0]])
    np.testing.assert_allclose(von_mises(stress), [3.0, 2.0 * np.sqrt(3.0), 0.0])


def test_a_run_without_results_has_no_fields(tmp_path: Path) -> None:
    run = stretched(1e-3)
    run.states.clear()
    refused("no step", lambda: write_vtk(run, tmp_path / "series"))
