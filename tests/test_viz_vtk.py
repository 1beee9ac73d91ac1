"""The VTK series, read by VTK itself."""

from __future__ import annotations

import errno
import os
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkFiltersCore import vtkCellCenters, vtkPolyDataNormals
from vtkmodules.vtkFiltersGeometry import vtkGeometryFilter
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

from bowstring import load_robot
from bowstring.errors import InputError
from bowstring.statics import fields
from bowstring.viz.vtk import check_folder, write_vtk
from made_frames import made_frames
from objects import refused

ROBOT = load_robot("amouri2019")
TIMES = np.array([0.0, 0.1, 0.25])
ANGLES = 16


@pytest.fixture(scope="module")
def data():
    return fields.to_dataset(ROBOT, made_frames(ROBOT, TIMES, force=(5.0, -3.0, -80.0)), {})


@pytest.fixture(scope="module")
def series(data, tmp_path_factory):
    return write_vtk(ROBOT, data, tmp_path_factory.mktemp("run") / "vtk", angles=ANGLES)


def read(file):
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(file))
    reader.Update()
    assert reader.GetErrorCode() == 0
    grid = reader.GetOutput()
    values = grid.GetPointData()
    arrays = {
        values.GetArrayName(i): vtk_to_numpy(values.GetArray(i))
        for i in range(values.GetNumberOfArrays())
    }
    return grid, vtk_to_numpy(grid.GetPoints().GetData()), arrays


def test_the_list_names_every_file_and_time(series):
    rows = ElementTree.parse(series).getroot().findall("Collection/DataSet")
    assert {(float(r.get("timestep")), r.get("name")) for r in rows} == {
        (t, part) for t in TIMES for part in ("backbone", "disks", "tendons")
    }
    files = {r.get("file") for r in rows}
    assert files | {"run.pvd"} == set(os.listdir(series.parent)) and len(files) == 9
    assert 'data_origin="simulated"' in series.read_text()


@pytest.mark.parametrize("i", [0, 1, 2])
def test_backbone(series, data, i):
    grid, points, arrays = read(series.parent / f"backbone_{i:05d}.vtu")
    now = data.isel(time=i)
    stations = data.sizes["station"]
    assert len(points) == stations * ANGLES
    assert grid.GetNumberOfCells() == 9 * 4 * ANGLES  # none across a disk
    rod = ROBOT.segments[0].backbone
    rings = points.reshape(stations, ANGLES, 3)
    np.testing.assert_allclose(rings.mean(axis=1), now.position, atol=1e-7)
    radius = np.linalg.norm(rings - now.position.values[:, None], axis=2)
    np.testing.assert_allclose(radius, 0.5 * rod.diameter, atol=1e-7)
    # stress at a point, from the internal wrench
    psi = 2.0 * np.pi / ANGLES * np.arange(ANGLES)
    x, y = 0.5 * rod.diameter * np.cos(psi), 0.5 * rod.diameter * np.sin(psi)
    f, m = now.force.values, now.moment.values
    sigma = f[:, 2:] / rod.area + (m[:, :1] * y - m[:, 1:2] * x) / rod.second_moment
    tau = 4 / 3 / rod.area * (f[:, 1:2] * np.cos(psi) - f[:, :1] * np.sin(psi))
    scale = abs(sigma).max()
    np.testing.assert_allclose(
        arrays["axial_stress_Pa"].reshape(stations, -1), sigma, atol=1e-6 * scale
    )
    von_mises = arrays["von_mises_Pa"].reshape(stations, -1)
    np.testing.assert_allclose(von_mises, np.sqrt(sigma**2 + 3 * tau**2), rtol=1e-5)
    assert (von_mises.max(axis=1) <= now.von_mises.values * (1 + 1e-6)).all()
    np.testing.assert_allclose(von_mises.max(axis=1), now.von_mises, rtol=0.03)
    straight = np.stack([*np.broadcast_arrays(x, y, now.arc_length.values[:, None])], axis=-1)
    np.testing.assert_allclose(
        arrays["displacement_m"].reshape(stations, -1, 3), rings - straight, atol=2e-7
    )
    np.testing.assert_allclose(
        arrays["curvature_per_m"].reshape(stations, -1, 3)[:, 0], now.curvature, rtol=1e-6
    )


def test_faces_look_outward(series, data):
    """A viewer needs this for lighting."""
    grid, _, _ = read(series.parent / "backbone_00002.vtu")
    surface = vtkGeometryFilter()
    surface.SetInputData(grid)
    normals = vtkPolyDataNormals()
    normals.SetInputConnection(surface.GetOutputPort())
    normals.ComputeCellNormalsOn()
    normals.ComputePointNormalsOff()
    normals.ConsistencyOff()
    normals.SplittingOff()
    centres = vtkCellCenters()
    centres.SetInputConnection(normals.GetOutputPort())
    centres.Update()
    middle = vtk_to_numpy(centres.GetOutput().GetPoints().GetData())
    normal = vtk_to_numpy(centres.GetOutput().GetPointData().GetArray("Normals"))
    line = data.position.values[2]
    nearest = np.linalg.norm(middle[:, None] - line, axis=2).argmin(axis=1)
    axis = data.rotation.values[2][nearest, :, 2]
    out = middle - line[nearest]
    out -= (out * axis).sum(axis=1, keepdims=True) * axis
    assert ((out * normal).sum(axis=1) > 0).all()


def test_disks(series, data):
    grid, points, arrays = read(series.parent / "disks_00002.vtu")
    assert grid.GetNumberOfCells() == 9 * (48 + 2)
    disks = ROBOT.disks
    rings = points.reshape(9, 2, -1, 3)
    centre = data.disk_position.values[2]
    normal = data.disk_rotation.values[2][..., 2]
    np.testing.assert_allclose(rings.mean(axis=(1, 2)), centre, atol=1e-7)
    height = np.einsum("dsaj,dj->dsa", rings - centre[:, None, None], normal)
    half = 0.5 * disks.thickness_m[0]
    np.testing.assert_allclose(height[:, 0], -half, atol=2e-7)
    np.testing.assert_allclose(height[:, 1], half, atol=2e-7)
    radius = np.linalg.norm(rings.mean(axis=1) - centre[:, None], axis=2)
    np.testing.assert_allclose(radius, disks.radius_m[0], atol=2e-7)
    velocity = arrays["velocity_m_per_s"].reshape(9, -1, 3).mean(axis=1)
    np.testing.assert_allclose(velocity, data.disk_velocity.values[2], rtol=1e-5, atol=1e-7)


def test_tendons_run_through_the_holes(tmp_path):
    robot = load_robot("rao2021")
    frames = made_frames(robot, TIMES)
    write_vtk(robot, fields.to_dataset(robot, frames, {}), tmp_path / "vtk")
    grid, points, arrays = read(tmp_path / "vtk" / "tendons_00001.vtu")
    assert grid.GetNumberOfCells() == 6
    for k, end in enumerate(robot.tendons.end_disk):
        ids = grid.GetCell(k).GetPointIds()
        rows = [ids.GetId(j) for j in range(ids.GetNumberOfIds())]
        hole = np.append(robot.tendons.hole_m[k], 0.0)
        rotation, position = frames.disk_rotation[1], frames.disk_position[1]
        expected = [hole, *(position + rotation @ hole)[: end + 1]]
        np.testing.assert_allclose(points[rows], expected, atol=1e-7)
        assert (arrays["tension_N"][rows] == k + 1.0).all()


def test_a_user_folder_is_not_overwritten(tmp_path, data):
    folder = tmp_path / "vtk"
    write_vtk(ROBOT, data, folder)
    write_vtk(ROBOT, data.isel(time=[0]), folder)  # a former series is replaced as a whole
    assert len(os.listdir(folder)) == 4
    (folder / "notes.txt").write_text("mine")
    refused(r"notes\.txt, which is not of a VTK series", lambda: write_vtk(ROBOT, data, folder))
    refused("it is a file; name a folder", lambda: check_folder(folder / "notes.txt"))
    refused(r"notes\.txt is a file", lambda: check_folder(folder / "notes.txt" / "vtk"))
    assert check_folder(tmp_path / "a" / "b").is_absolute()
    assert os.listdir(tmp_path) == ["vtk"]


def test_a_full_drive_leaves_nothing(tmp_path, data, monkeypatch):
    write_text = Path.write_text

    def full(self, content, **options):
        if re.match("disks_00001", self.name):
            raise OSError(errno.ENOSPC, "No space left on device")
        return write_text(self, content, **options)

    monkeypatch.setattr(Path, "write_text", full)
    refused("No space left", lambda: write_vtk(ROBOT, data, tmp_path / "vtk"))
    assert os.listdir(tmp_path) == []


def test_too_little_disk_space_is_reported_first(tmp_path, data, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda path: type("Usage", (), {"free": 10}))
    refused("the drive has 1e-08 GB free", lambda: write_vtk(ROBOT, data, tmp_path / "vtk"))
    assert os.listdir(tmp_path) == []


def test_bad_input(tmp_path, data):
    for angles in (2, 2.5, "a"):
        with pytest.raises(InputError, match=f"angles is {angles!r}"):
            write_vtk(ROBOT, data, tmp_path / "vtk", angles=angles)
    with pytest.raises(InputError, match=r"data is 'run\.nc', it must be a Dataset"):
        write_vtk(ROBOT, "run.nc", tmp_path / "vtk")
    with pytest.raises(InputError, match=r"of another robot \(amouri2019\) than rao2021"):
        write_vtk(load_robot("rao2021"), data, tmp_path / "vtk")
    refused("no output time", lambda: write_vtk(ROBOT, data.isel(time=[]), tmp_path / "vtk"))
    single = fields.to_dataset(ROBOT, made_frames(ROBOT, TIMES, points=1), {})
    refused("2 stations or more", lambda: write_vtk(ROBOT, single, tmp_path / "vtk"))


def test_progress(tmp_path, data):
    reported = []
    write_vtk(ROBOT, data, tmp_path / "vtk", progress=lambda what, share: reported.append(share))
    assert reported == sorted(reported) and reported[-1] == 1.0
