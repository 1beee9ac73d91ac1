"""The C library against the Python package, and the C++ example as a user compiles and runs it."""

from __future__ import annotations

import csv
import ctypes
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaign.compiled import Inverse, Solution

import bowstring as bs

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "examples" / "cpp" / "follow_path.cpp"
STIFFNESS = np.diag([1.1, 1.3, 0.8, 2.6e5, 2.5e5, 6.9e5])
STIFFNESS[0, 2] = STIFFNESS[2, 0] = 0.2  # bending with twist
COUPLED = {
    **{f"segments.0.backbone.{name}": None for name in ("E", "nu", "density", "diameter")},
    "segments.0.backbone.stiffness": STIFFNESS.tolist(),
    "segments.0.backbone.mass_per_length": 0.035,
}
ROBOTS = {
    "built-in": ("amouri2019", {}),
    "two segments": ("rao2021", {"gravity": "0 0 -9.81 m/s^2"}),
    "three segments": ("crl-ftdcr-v4", {}),
    "tubes, a list of tendons": (str(ROOT / "tests" / "two_tubes.yaml"), {}),
    "tapered, embedded tendons": (str(ROOT / "examples" / "tentacle.yaml"), {}),
    "helical tendons": ("amouri2019", {"segments.0.tendons.turns": 0.25}),
    "coupled strains": ("amouri2019", COUPLED),
    "tapered": ("amouri2019", {"segments.0.backbone.end_diameter": "4 mm"}),
    "long holes, a payload, elastic tendons": (
        "amouri2019",
        {
            "gravity": "1 0 -9.81 m/s^2",
            "segments.0.disks.hole_length": "5 mm",
            "payloads": [{"disk": 9, "mass": 0.05, "centre": [0.01, 0.0, 0.02]}],
            "segments.0.tendons.axial_stiffness": 20e3,
            "segments.0.tendons.pretension": 2.0,
        },
    ),
}

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def libraries() -> dict[str, Path]:
    """Libraries by suffix, built as a user builds them."""
    cargo = shutil.which("cargo")
    if cargo is None:
        pytest.skip("needs cargo on the search path, to build the C library")
    options = ["--release", "--locked", "--message-format=json"]
    command = [cargo, "build", "-pbowstring-c", *options]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    messages = [json.loads(line) for line in run.stdout.splitlines() if line.startswith("{")]
    files = [
        Path(file)
        for message in messages
        if message.get("reason") == "compiler-artifact" and message["target"]["name"] == "bowstring"
        for file in message["filenames"]
    ]
    return {file.suffix: file for file in files}


class Options(ctypes.Structure):
    _fields_ = [
        ("theory", ctypes.c_int32),
        ("elements", ctypes.c_int32),
        ("distance_margin", ctypes.c_double),
    ]


class Load(ctypes.Structure):
    _fields_ = [
        ("gravity_m_per_s2", ctypes.c_double * 3),
        ("tip_force_N", ctypes.c_double * 3),
        ("tip_moment_Nm", ctypes.c_double * 3),
    ]


@pytest.fixture(scope="module")
def library(libraries: dict[str, Path]) -> Any:
    shared = libraries.get(".so") or libraries.get(".dylib") or libraries.get(".dll")
    assert shared is not None, libraries
    found = ctypes.CDLL(str(shared))
    found.bowstring_last_error.restype = ctypes.c_char_p
    found.bowstring_version.restype = ctypes.c_char_p
    for name in ("robot_from_text", "solver_new"):
        getattr(found, f"bowstring_{name}").restype = ctypes.c_void_p
    return found


def numbers(values: Any) -> Any:
    return np.ascontiguousarray(values, dtype=float).ctypes.data_as(ctypes.c_void_p)


@pytest.mark.parametrize("case", ROBOTS)
def test_the_library_solves_as_the_package(library: Any, case: str) -> None:
    name, changes = ROBOTS[case]
    robot = bs.load_robot(name, changes)
    text = json.dumps(bs.compile_robot(robot)).encode()
    assert library.bowstring_version().decode() == bs.__version__
    made = library.bowstring_robot_from_text(text, ctypes.c_size_t(len(text)))
    assert made, library.bowstring_last_error()
    handle = ctypes.c_void_p(made)
    options = ctypes.byref(Options(0, 2, 1e-3))
    solver = ctypes.c_void_p(library.bowstring_solver_new(handle, options))
    model = bs.RodModel(elements=2)
    library.bowstring_robot_free(handle)
    count = robot.core.tendon_count
    size = ctypes.c_size_t(count)
    rng = np.random.default_rng(7)
    from bowstring.inverse.limits import default_max_tension

    most = 0.15 * default_max_tension(robot)
    force, moment = [0.01, -0.02, 0.03], [1e-3, 2e-3, 0.0]
    weight = list(robot.gravity)
    wrench = Load((ctypes.c_double * 3)(*weight))
    wrench.tip_force_N[:], wrench.tip_moment_Nm[:] = force, moment
    for row, tensions in enumerate(rng.random((6, count)) * most):
        load = bs.Load(tip_force=force, tip_moment=moment) if row % 2 else bs.Load()
        expected = bs.solve(robot, tensions, load=load, model=model).raise_for_status()
        found = Solution()
        given = ctypes.byref(wrench) if row % 2 else None
        status = library.bowstring_solve(
            solver, numbers(tensions), size, given, ctypes.byref(found)
        )
        assert status == 0, library.bowstring_last_error()
        np.testing.assert_allclose(found.position_m[:], expected.tip.position, atol=1e-9)
        np.testing.assert_allclose(
            np.reshape(found.rotation[:], (3, 3)), expected.tip.rotation, atol=1e-8
        )
        out = np.empty(count)
        assert library.bowstring_tendon_lengths(solver, numbers(out), size) == 0
        np.testing.assert_allclose(out, expected.tendon_lengths, atol=1e-9)
        assert library.bowstring_displacements(solver, numbers(out), size) == 0
        np.testing.assert_allclose(out, expected.displacements(), atol=1e-9)
        derivatives = np.empty((6, count))
        status = library.bowstring_tip_derivatives(solver, numbers(derivatives), size)
        if robot.is_embedded:
            assert status == 5 and np.isnan(derivatives).all()
            continue
        by = bs.jacobians(expected)
        np.testing.assert_allclose(
            derivatives[:3], by.tip_position_by_tension, rtol=1e-4, atol=1e-9
        )
        np.testing.assert_allclose(
            derivatives[3:], by.tip_rotation_by_tension, rtol=1e-4, atol=1e-8
        )
    target = bs.solve(robot, 0.5 * most, model=model).tip.position
    tensions, result = np.empty(count), Inverse()
    status = library.bowstring_inverse(
        solver, numbers(target), None, None, numbers(tensions), size, ctypes.byref(result)
    )
    if robot.is_embedded:
        assert status == -1 and b"embedded tendons" in library.bowstring_last_error()
    else:
        assert status == 0, library.bowstring_last_error()
        found = bs.inverse_kinematics(robot, target, model=model).raise_for_status()
        np.testing.assert_allclose(tensions, found.tensions, atol=1e-4 * most.max())
        tip = bs.solve(robot, tensions, model=model).tip.position
        np.testing.assert_allclose(tip, target, atol=1e-6 * robot.length)
        assert result.distance_m < 1e-6 * robot.length
    library.bowstring_solver_free(solver)


@pytest.fixture(scope="module")
def program(libraries: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example, compiled by the lines of its page."""
    compiler = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
    if compiler is None or ".a" not in libraries:
        pytest.skip("needs a C++ compiler (c++, g++ or clang++) on the search path")
    out = tmp_path_factory.mktemp("cpp") / "follow_path"
    flags = ["-std=c++17", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    subprocess.run(
        [
            *(compiler, *flags, "-I", str(ROOT / "crates" / "bowstring-c" / "include")),
            *(str(EXAMPLE), str(libraries[".a"]), "-lpthread", "-ldl", "-lm", "-o", str(out)),
        ],
        check=True,
    )
    return out


def test_the_example_follows_a_path(program: Path, tmp_path: Path) -> None:
    lines = (ROOT / "examples" / "tip_path.csv").read_text().splitlines()
    tips = tmp_path / "tips.csv"
    tips.write_text("\n".join(lines[:302]) + "\n")
    robot = bs.load_robot("rao2021")
    compiled = tmp_path / "robot.json"
    compiled.write_text(json.dumps(bs.compile_robot(robot)))
    out = tmp_path / "commands.csv"
    run = subprocess.run(
        [program, compiled, tips, "--rate", "1000", "--max-tension", "12", "--out", out],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert "300 tips at 1000 Hz, 6 tendons" in run.stdout
    assert "tip: 300 of 300 reached" in run.stdout and "0 from another start" in run.stdout
    median, p99, largest = map(float, re.findall(r"([\d.]+) ms", run.stdout))
    assert 0.0 < median <= p99 <= largest
    assert median < 1.0  # a third of a millisecond on a slow machine that is busy
    positions = np.loadtxt(lines[2:302], delimiter=",") * 1e-3
    limits = bs.ActuationLimits(max_tension=12.0)
    found = bs.inverse_kinematics(robot, positions, limits=limits).raise_for_status()
    with out.open() as stream:
        table = [{key: float(x) for key, x in row.items()} for row in csv.DictReader(stream)]
    tensions, displacements = (
        np.array([[row[form.format(i)] for i in range(1, 7)] for row in table])
        for form in ("tension_{}_N", "displacement_{}_mm")
    )
    np.testing.assert_allclose(tensions, found.tensions, atol=1e-3)
    np.testing.assert_allclose(1e-3 * displacements, found.displacements(), atol=1e-6)
    # and where they lead by a solve of their own
    landed = bs.sweep(robot, tensions).tip_position
    np.testing.assert_allclose(landed, positions, atol=1e-6)


def test_the_example_refuses_wrong_files(program: Path, tmp_path: Path) -> None:
    yaml = tmp_path / "robot.yaml"
    yaml.write_text("name: mine\n")
    for arguments, words in (
        ((), "give a robot"),
        ((tmp_path / "none.json", ROOT / "examples" / "tip_path.csv"), "cannot be read"),
        ((yaml, ROOT / "examples" / "tip_path.csv"), "bowstring export"),
        ((yaml, yaml), "the columns must be"),
    ):
        run = subprocess.run([program, *arguments], capture_output=True, text=True, check=False)
        assert run.returncode == 2 and run.stderr.startswith("Error: ")
        assert words in run.stderr, run.stderr


def test_the_lines_of_the_guide(libraries: dict[str, Path], tmp_path: Path) -> None:
    """The C of the page compiles, runs and gives the tensions of the package."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None or ".a" not in libraries:
        pytest.skip("needs a C compiler (cc, gcc or clang) on the search path")
    page = (ROOT / "docs" / "guide" / "cpp.md").read_text("utf-8")
    (lines,) = re.findall(r"^```c\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    ends = 'for (size_t i = 0; i < n; ++i) printf("%.9g\\n", tensions[i]);\nreturn status;\n'
    source = tmp_path / "lines.c"
    source.write_text(
        '#include "bowstring.h"\n#include <stdio.h>\nint main(void) {\n' + lines + ends + "}\n"
    )
    include = ROOT / "crates" / "bowstring-c" / "include"
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-I", str(include)]
    program = tmp_path / "lines"
    subprocess.run(
        [
            *(compiler, *flags, str(source), str(libraries[".a"])),
            *("-lpthread", "-ldl", "-lm", "-o", str(program)),
        ],
        check=True,
    )
    robot = bs.load_robot("rao2021")
    (tmp_path / "robot.json").write_text(json.dumps(bs.compile_robot(robot)))
    run = subprocess.run([program], cwd=tmp_path, capture_output=True, text=True, check=True)
    found = bs.inverse_kinematics(robot, [0.10, 0.02, 0.37]).raise_for_status()
    np.testing.assert_allclose([*map(float, run.stdout.split())], found.tensions, atol=1e-4)


def test_the_header_is_one_of_c(tmp_path: Path) -> None:
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("needs a C compiler (cc, gcc or clang) on the search path")
    source = tmp_path / "use.c"
    source.write_text('#include "bowstring.h"\nint use(BowstringOptions o) { return o.theory; }\n')
    include = ROOT / "crates" / "bowstring-c" / "include"
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-I", str(include), "-c"]
    subprocess.run([compiler, *flags, str(source), "-o", str(tmp_path / "use.o")], check=True)
