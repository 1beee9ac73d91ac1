"""The animation of a run."""

from __future__ import annotations

import os
import sys
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image, ImageChops

from bowstring import load_robot
from bowstring.errors import InputError
from bowstring.statics import fields
from bowstring.viz.animation import animate, check_picture
from made_frames import made_frames
from objects import refused

ROBOT = load_robot("amouri2019")


@pytest.fixture(scope="module")
def data():
    return fields.to_dataset(ROBOT, made_frames(ROBOT, np.arange(21) * 0.01), {})


@pytest.mark.parametrize(("speed", "pictures"), [(1.0, 6), (0.5, 11)])
def test_a_gif_in_real_time(tmp_path, data, speed, pictures):
    file = animate(ROBOT, data, tmp_path / "run.gif", speed=speed)
    assert os.listdir(tmp_path) == ["run.gif"]
    with Image.open(file) as gif:
        assert gif.format == "GIF" and gif.n_frames == pictures
        durations, shown = [], []
        for k in range(gif.n_frames):
            gif.seek(k)
            durations.append(gif.info["duration"])
            shown.append(gif.convert("RGB"))
    assert durations == [40] * pictures
    for before, after in pairwise(shown):
        box = ImageChops.difference(before, after).getbbox()
        assert box is not None and box[3] - box[1] > 100  # the robot moves, not only the label
    # the backbone's blue is there, and much white
    colours = np.asarray(shown[-1]).reshape(-1, 3).astype(int)
    assert (abs(colours - (0, 0x72, 0xB2)).max(axis=1) < 24).sum() > 300
    assert (colours.min(axis=1) > 240).mean() > 0.7


def test_each_picture_shows_its_time(tmp_path, monkeypatch):
    from bowstring.viz import animation

    seen = []
    show = animation._Scene.show

    def watch(self, i):
        show(self, i)
        seen.append((i, self._label.get_text()))

    monkeypatch.setattr(animation._Scene, "show", watch)
    uneven = np.array([0.0, 0.03, 0.05, 0.13])
    uneven_run = fields.to_dataset(ROBOT, made_frames(ROBOT, uneven), {})
    told = []
    animate(ROBOT, uneven_run, tmp_path / "a.gif", progress=lambda what, x: told.append(x))
    assert seen == [(0, "t = 0.000 s"), (1, "t = 0.030 s"), (2, "t = 0.050 s"), (3, "t = 0.130 s")]
    assert told[-1] == 1.0


def test_mp4_goes_through_ffmpeg(tmp_path, data, monkeypatch):
    """A stand-in receives the images and records its call and the number of bytes."""
    programs = tmp_path / "bin"
    programs.mkdir()
    fake = programs / "ffmpeg"
    fake.write_text(
        f"#!{sys.executable}\nimport sys\nsize = len(sys.stdin.buffer.read())\n"
        "open(sys.argv[-1], 'w').write(f'{size} ' + ' '.join(sys.argv))\n"
    )
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", str(programs))
    file = animate(ROBOT, data, tmp_path / "run.mp4")
    size, *arguments = file.read_text().split()
    text = " ".join(arguments)
    assert int(size) == 6 * 616 * 616 * 4 and "616x616" in arguments
    assert "-framerate 25 " in text and "-pix_fmt yuv420p" in text  # shown by every player
    fake.write_text(f"#!{sys.executable}\nimport sys\nsys.stdin.buffer.read()\nsys.exit(3)\n")
    with pytest.raises(InputError, match=r"ffmpeg failed \(exit code 3\); name a \.gif"):
        animate(ROBOT, data, tmp_path / "other.mp4")
    assert sorted(os.listdir(tmp_path)) == ["bin", "run.mp4"]


def test_without_ffmpeg(tmp_path, data, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match=r"not installed; install it or name a \.gif"):
        animate(ROBOT, data, tmp_path / "run.mp4")
    assert os.listdir(tmp_path) == []


def test_bad_input(tmp_path, data):
    refused(r"must end in \.gif or \.mp4", lambda: check_picture(tmp_path / "run.avi"))
    refused(r"the folder .*/no does not exist", lambda: check_picture(tmp_path / "no" / "run.gif"))
    (tmp_path / "dir.gif").mkdir()
    refused("it is a folder; name a file", lambda: check_picture(tmp_path / "dir.gif"))
    refused("nothing that moves", lambda: animate(ROBOT, data.isel(time=[0]), tmp_path / "run.gif"))
    for speed in (0.0, -1.0, np.nan, np.inf, "2"):
        with pytest.raises(InputError, match="speed is"):
            animate(ROBOT, data, tmp_path / "run.gif", speed=speed)
    with pytest.raises(InputError, match=r"choose a speed of 0\.001 or more"):
        animate(ROBOT, data, tmp_path / "run.gif", speed=1e-6)
    refused("of another robot", lambda: animate(load_robot("rao2021"), data, tmp_path / "run.gif"))
    assert os.listdir(tmp_path) == ["dir.gif"]
