"""The renderer against ray casting; labels of pictures and drawings lie within them."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bowstring as bs
from bowstring.cad.drawing import draw_disks, write_drawing
from bowstring.cad.raster import Camera, Mesh, render
from bowstring.errors import InputError


def box(low, high, part):
    """Triangles of a box, counter-clockwise from outside, with flat normals."""
    points, normals, triangles = [], [], []
    for axis in range(3):
        for side in (0, 1):
            b, c = (axis + 1) % 3, (axis + 2) % 3
            corner = np.zeros((4, 3))
            corner[:, axis] = (low, high)[side][axis]
            corner[:, b] = [low[b], high[b], high[b], low[b]]
            corner[:, c] = [low[c], low[c], high[c], high[c]]
            first = len(points) * 4
            points.append(corner if side else corner[::-1])
            normals.append(np.tile(np.eye(3)[axis] * (2 * side - 1), (4, 1)))
            triangles += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
    return Mesh(
        np.concatenate(points),
        np.concatenate(normals),
        np.array(triangles),
        np.full(len(triangles), part),
    )


def together(*meshes):
    count = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.points for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.triangles + n for mesh, n in zip(meshes, count[:-1], strict=True)]),
        np.concatenate([mesh.part for mesh in meshes]),
    )


def first_hit(mesh, eye, ray):
    """The first part on a ray, -1 for none (Moeller and Trumbore), and its distance to an edge."""
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    p = np.cross(ray, c - a)
    det = (p * (b - a)).sum(axis=1)
    det = np.where(np.abs(det) < 1e-12, np.nan, det)
    u = ((eye - a) * p).sum(axis=1) / det
    q = np.cross(eye - a, b - a)
    v = (q @ ray) / det
    t = ((c - a) * q).sum(axis=1) / det
    hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    return mesh.part[np.flatnonzero(hit)[t[hit].argmin()]] if hit.any() else -1


@pytest.mark.cad
@pytest.mark.parametrize(("azimuth", "elevation"), [(0.3, 0.2), (-2.0, 1.1), (2.5, -0.6)])
def test_pixels_match_ray_casting(azimuth, elevation):
    mesh = together(
        box((-1, -1, -1), (1, 1, 1), 0),
        box((1.2, -0.2, -3), (1.4, 0.2, 3), 1),  # a long thin one in front or behind
        box((-2, -2, -1.4), (2, 2, -1.2), 2),
    )
    camera = Camera(mesh.points, azimuth, elevation, 240)
    image, seen = render(mesh, camera, np.eye(3), np.ones(3, dtype=bool))
    assert image.shape[:2] == seen.shape == (camera.height, camera.width)
    assert set(np.unique(seen)) == {-1, 0, 1, 2}
    rng = np.random.default_rng(0)
    rows, columns = rng.integers(camera.height, size=600), rng.integers(camera.width, size=600)
    # position of a pixel of the finer picture in the plane at distance 1 from the eye
    zero = camera.see((camera.eye - camera.axes[2])[None])[0]
    right = camera.see((camera.eye - camera.axes[2] + camera.axes[0])[None])[0] - zero
    wrong = 0
    for i, j in zip(rows.tolist(), columns.tolist(), strict=True):
        x, y = (j + 0.25 - zero[0]) / right[0], -(i + 0.25 - zero[1]) / right[0]
        ray = -camera.axes[2] + x * camera.axes[0] + y * camera.axes[1]
        wrong += first_hit(mesh, camera.eye, ray) != seen[i, j]
    assert wrong == 0


@pytest.mark.cad
def test_light_falls_from_above_and_bodies_shade_each_other():
    plate = box((-2, -2, -0.1), (2, 2, 0.0), 0)
    white = np.ones((2, 3))
    no_edges = np.zeros(2, dtype=bool)
    camera = Camera(plate.points, 0.0, 0.6, 200)
    top = camera.see(np.array([[0.0, 0.0, 0.0]]))[0].astype(int)
    front = camera.see(np.array([[2.0, 0.0, -0.05]]))[0].astype(int)
    alone, _ = render(plate, camera, white, no_edges)
    assert alone[top[1], top[0], 0] > alone[front[1], front[0], 0] + 0.1
    roof = box((-2, -2, 0.9), (2, 2, 1.0), 1)
    both = together(plate, roof)
    camera = Camera(both.points, 0.0, 0.2, 200)
    place = camera.see(np.array([[0.8, 0.0, 0.0]]))[0].astype(int)
    lit, _ = render(plate, camera, white, no_edges)
    shaded, seen = render(both, camera, white, no_edges)
    assert seen[place[1], place[0]] == 0
    assert shaded[place[1], place[0], 0] < lit[place[1], place[0], 0] - 0.1


def readable(figure):
    """The texts of a figure, which must lie within it and not overlap."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.text import Text

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    drawer = canvas.get_renderer()
    texts = [t for axes in figure.axes for t in axes.texts if t.get_text()] + list(figure.texts)
    boxes = [Text.get_window_extent(text, drawer) for text in texts]
    width, height = canvas.get_width_height()
    for text, found in zip(texts, boxes, strict=True):
        assert found.x0 >= 0 and found.x1 <= width, text.get_text()
        assert found.y0 >= 0 and found.y1 <= height, text.get_text()
    for i, one in enumerate(boxes):
        for j in range(i):
            assert not one.overlaps(boxes[j]), (texts[i].get_text(), texts[j].get_text())
    return [text.get_text() for text in texts]


@pytest.mark.cad
@pytest.mark.parametrize("name", bs.robot_names())
def test_a_picture_names_its_parts(name, tmp_path):
    pytest.importorskip("build123d", exc_type=ImportError)
    from bowstring.cad.picture import draw_solid, write_picture
    from bowstring.cad.solid import make_solid

    robot = bs.load_robot(name)
    count = len(robot.tendons.angle_rad)
    solid = make_solid(robot, bs.solve(robot, tensions=[1.0] + [0.0] * (count - 1)))
    figure = draw_solid(solid, pixels=500)
    texts = readable(figure)
    title = f"{name}, simulated: tendon 1 at 1 N"
    assert title in [text.replace("\n", " ") for text in texts]
    first = "tendons 1, 4" if name == "rao2021" else "tendon 1"  # tendons that share a hole
    assert {"end disk", "spacer disk", "base", "backbone", first} <= set(texts)
    if name == "amouri2019":
        for suffix, head in ((".png", b"\x89PNG"), (".pdf", b"%PDF"), (".SVG", b"<?xml")):
            file = write_picture(solid, tmp_path / f"robot{suffix}")
            assert file.read_bytes().startswith(head)
        with pytest.raises(InputError, match=r"its name must end in .png, .pdf or .svg"):
            write_picture(solid, tmp_path / "robot.jpg")


@pytest.mark.cad
def test_labels_point_at_visible_parts_and_a_long_title_wraps():
    pytest.importorskip("build123d", exc_type=ImportError)
    from bowstring.cad.picture import draw_solid
    from bowstring.cad.solid import make_solid

    title = "A robot whose name is as long as names may be and so does not go on one line, by far"
    solid = make_solid(bs.load_robot("amouri2019", {"name": title}))
    figure = draw_solid(solid, pixels=400)
    texts = readable(figure)
    assert any(t.replace("\n", " ") == f"{title}, straight, as built" for t in texts)
    (axes,) = figure.axes
    dots = [line.get_xydata()[0] for line in axes.lines]
    ends = [text.xy for text in axes.texts]
    np.testing.assert_array_equal(dots, ends)  # one dot on each part
    image = axes.images[0].get_array()
    assert all(image[int(y), int(x), 3] > 0 for x, y in dots)  # and on the robot


@pytest.mark.cad
def test_normals_are_smooth_around_a_rod_and_sharp_at_its_ends():
    bd = pytest.importorskip("build123d", exc_type=ImportError)
    from bowstring.cad.picture import mesh_of
    from bowstring.cad.solid import Part

    rod = bd.Solid.make_cylinder(2.0, 100.0)
    mesh = mesh_of((Part("rod", "backbone", "#000000", rod, None),))
    on_side = np.abs(mesh.normals[:, 2]) < 0.5
    away = mesh.points[on_side, :2] / np.linalg.norm(mesh.points[on_side, :2], axis=1)[:, None]
    assert (away * mesh.normals[on_side, :2]).sum(axis=1).min() > 0.99
    np.testing.assert_allclose(np.abs(mesh.normals[~on_side, 2]), 1.0, atol=1e-9)
    # closed, with outward normals, as the renderer requires
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    volume = np.einsum("fi,fi->f", a, np.cross(b, c)).sum() / 6
    assert volume == pytest.approx(math.pi * 4 * 100, rel=0.03)


def test_a_drawing_has_all_sizes():
    figure = draw_disks(bs.load_robot("amouri2019"))
    texts = readable(figure)
    for text in ("disks 1 to 9", "Ø64", "Ø5", "3 x Ø2*\non Ø58", "120°", "3"):
        assert text in texts
    assert "* assumed: the robot file does not say it" in texts
    given = bs.load_robot("amouri2019", {"segments.0.disks.hole_diameter": "2.5 mm"})
    texts = [text.get_text() for axes in draw_disks(given).axes for text in axes.texts]
    assert "3 x Ø2.5\non Ø58" in texts


def test_a_drawing_dimensions_each_hole_if_they_differ():
    robot = bs.load_robot(
        "amouri2019",
        {
            "segments.0.disks.radius": "32.1255 mm",
            "segments.0.tendons": [
                {"angle": "50 deg", "pitch_radius": "20 mm"},
                {"angle": "-62.239 deg", "pitch_radius": "12 mm"},
                {"angle": "0 deg", "pitch_radius": "29 mm"},
            ],
        },
    )
    figure = draw_disks(robot)
    texts = readable(figure)
    assert "1: 0° on Ø58\n2: 50° on Ø40\n3: 297.76° on Ø24" in texts
    assert {"1", "2", "3", "Ø64.251"} <= set(texts) and "50°" not in texts
    # the angles of all nine holes, on one circle
    figure = draw_disks(bs.load_robot("crl-ftdcr-v4"))
    first = next(text for text in readable(figure) if text.startswith("1: 2.51°"))
    assert first.count("\n") == 8 and "Ø" not in first
    figure = draw_disks(bs.load_robot("amouri2019", {"name": "of many letters" * 6}))
    assert any("spacer disks, in mm" in text.replace("\n", " ") for text in readable(figure))
    many = {"segments.0.tendons": [{"angle": i * i / 50, "pitch_radius": 0.029} for i in range(16)]}
    figure = draw_disks(bs.load_robot("amouri2019", many))
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert any(text.endswith("and 2 more") for text in texts)


def test_equal_disks_are_drawn_once():
    def titles(name, changes=None):
        figure = draw_disks(bs.load_robot(name, changes))
        return [t.get_text() for axes in figure.axes for t in axes.texts if "disk" in t.get_text()]

    assert titles("rao2021") == ["disks 1 to 20"]
    assert titles("crl-ftdcr-v4") == ["disks 1 to 10", "disks 11 to 20", "disks 21 to 30"]
    thicker = {"segments.1.backbone.diameter": "2 mm"}
    assert titles("rao2021", thicker) == ["disks 1 to 9", "disks 10 to 20"]


def test_drawings_are_files_and_need_no_extra(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "build123d", None)
    robot = bs.load_robot("crl-ftdcr-v4")
    for suffix, head in ((".png", b"\x89PNG"), (".pdf", b"%PDF"), (".svg", b"<?xml")):
        assert write_drawing(robot, tmp_path / f"d{suffix}").read_bytes().startswith(head)
    with pytest.raises(InputError, match=r"its name must end in .svg, .pdf or .png"):
        write_drawing(robot, tmp_path / "d.dxf")
    many = robot.model_dump(mode="json", exclude_none=True)
    segment = many["segments"][2]
    many["segments"] = [
        {**segment, "disks": {**segment["disks"], "thickness": 0.001 + 1e-5 * i}} for i in range(13)
    ]
    with pytest.raises(InputError, match="13 kinds of disks; a drawing holds up to 12"):
        write_drawing(type(robot).model_validate(many), tmp_path / "many.svg")
