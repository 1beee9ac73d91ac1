"""Exports of instruments and programs, re-made with numbers of their own, read by drafted mappings.

Each export is a function of the same motion of a robot. What it holds is read by the draft without
edits, or the draft says what it could not decide.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.data.measurements import read_measurements
from bowstring.errors import InputError
from objects import drafted, refused

ROWS = 24
STEP = 0.02  # s, unless an export says otherwise


@dataclass(frozen=True)
class Motion:
    """Arcs of a robot with three tendons: what all exports hold, in SI."""

    time: Floats
    tip: Floats
    displacements: Floats
    tensions: Floats
    quaternions: Floats
    """Of the tip, scalar last."""


@pytest.fixture(scope="module")
def motion(robot: bs.Robot) -> Motion:
    time = STEP * np.arange(ROWS)
    bend, turn = 0.9 + 0.6 * np.sin(7 * time), 0.4 + 9 * time
    side = robot.length * (1 - np.cos(bend)) / bend
    tip = np.stack([side * np.cos(turn), side * np.sin(turn), robot.length * np.sin(bend) / bend])
    tendons = robot.tendons
    displacements = (
        tendons.pitch_radius_m * bend[:, None] * np.cos(turn[:, None] - tendons.angle_rad)
    )
    axis = np.stack([-np.sin(turn), np.cos(turn), 0 * turn])
    quaternions = np.vstack([np.sin(bend / 2) * axis, np.cos(bend / 2)])
    return Motion(time, tip.T, displacements, 60 + 900 * displacements, quaternions.T)


@dataclass
class Export:
    """Files of an export, and what a draft reads of it: tip, tensions or displacements, times.

    `undecided` has the beginnings of what the draft says that it cannot decide.
    """

    text: str
    tip: bool = True  # without it, nothing is read
    time: float | None = STEP
    quantity: str = ""
    undecided: Sequence[str] = ()
    others: dict[str, str] = field(default_factory=dict)
    left: int = 0
    """Rows without a tip."""


def _row(*values: object, mark: str = ",") -> str:
    return mark.join(f"{v:.6f}" if isinstance(v, float) else str(v) for v in values)


def _table(header: str, rows: Sequence[Sequence[object]], mark: str = ",") -> str:
    return "\n".join([*([header] if header else []), *(_row(*r, mark=mark) for r in rows), ""])


NO_COMMANDS = ["the commands of the tendons"]


def ros_pose(m: Motion) -> Export:
    pose = [f"field.pose.position.{a}" for a in "xyz"] + [
        f"field.pose.orientation.{a}" for a in "xyzw"
    ]
    start = 1_709_211_615_123_456_789
    rows = [
        (start + round(1e9 * t) + 2_000_000, i, start + round(1e9 * t), "mocap", *p, *q)
        for i, (t, p, q) in enumerate(zip(m.time, m.tip, m.quaternions, strict=True))
    ]
    header = "%time,field.header.seq,field.header.stamp,field.header.frame_id," + ",".join(pose)
    return Export(_table(header, rows), undecided=NO_COMMANDS)


def bag_to_csv(m: Motion) -> Export:
    header = "header.stamp.secs,header.stamp.nsecs,pose.position.x,pose.position.y,pose.position.z,"
    header += "pose.orientation.x,pose.orientation.y,pose.orientation.z,pose.orientation.w,"
    header += "cable_0,cable_1,cable_2"
    rows = [
        (1_700_000_000 + int(t + 0.81), round(1e9 * ((t + 0.81) % 1)), *p, *q, *d)
        for t, p, q, d in zip(m.time, m.tip, m.quaternions, m.displacements, strict=True)
    ]
    return Export(_table(header, rows), quantity="displacement")


def ros2_echo(m: Motion) -> Export:
    rows = [
        (12, round(1e9 * t), "map", *p, *q)
        for t, p, q in zip(m.time, m.tip, m.quaternions, strict=True)
    ]
    return Export(
        _table("", rows), tip=False, undecided=["the tip: no three columns", *NO_COMMANDS]
    )


def plotjuggler(m: Motion) -> Export:
    header = "__time," + ",".join(f"/tracker/pose/position/{a}" for a in "xyz")
    header += "," + ",".join(f"/cmd/tendon_{i}/data" for i in (1, 2, 3))
    rows = [(1.7e9 + t, *p, *d) for t, p, d in zip(m.time, m.tip, m.displacements, strict=True)]
    return Export(_table(header, rows), quantity="displacement")


def tum_trajectory(m: Motion) -> Export:
    rows = [(1.6e9 + t, *p, *q) for t, p, q in zip(m.time, m.tip, m.quaternions, strict=True)]
    text = "# ground truth\n" + _table("# timestamp tx ty tz qx qy qz qw", rows, " ")
    return Export(text, undecided=NO_COMMANDS)


def _vicon(m: Motion) -> str:
    rows = [(f + 7, 0, 0.0, 0.0, 0.0, *(500.0 * p), *(1e3 * p)) for f, p in enumerate(m.tip)]
    head = (
        "Trajectories\n50\n,,rig:foot,,,rig:middle,,,rig:tip,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z,X,Y,Z\n"
    )
    return _table(head + ",,mm,mm,mm,mm,mm,mm,mm,mm,mm", rows)


def vicon_trajectories(m: Motion) -> Export:
    return Export(_vicon(m), undecided=NO_COMMANDS)


def vicon_blocks(m: Motion) -> Export:
    rows = [(f + 7, s, *(force - 0.0)) for f, force in enumerate(m.tensions) for s in range(4)]
    head = "Devices\n200\n,,Load Cell - Force,,\nFrame,Sub Frame,Fz1,Fz2,Fz3\n,,N,N,N"
    return Export(_table(head, rows) + "\n" + _vicon(m), quantity="tension")


def _motive(
    m: Motion, labels: Sequence[str], names: Sequence[str], columns: Sequence[Floats]
) -> str:
    kinds = ["Marker" if "Unlabeled" in name else "Rigid Body" for name in names]
    ids = [str(i) for i in range(len(names))]
    upper = {"Type": kinds, "Name": names, "ID": ids, "Parent": [""] * len(names)}
    head = "Format Version,1.23,Take Name,Take 3,Length Units,Millimeters\n\n"
    for label, cells in zip(labels, upper.values(), strict=False):
        head += f",{label}," + ",".join(cell for cell in cells for _ in "XYZ") + "\n"
    head += ",," + ",".join("Position" for _ in names for _ in "XYZ") + "\n"
    head += "Frame,Time (Seconds)," + ",".join("X,Y,Z" for _ in names)
    rows = [
        (i, t, *(float(1e3 * v) for points in columns for v in points[i, [1, 2, 0]]))
        for i, t in enumerate(m.time)
    ]
    return _table(head, rows).replace("nan", "")


def _forces(m: Motion) -> dict[str, str]:
    rows = [(t, *f) for t, f in zip(m.time, m.tensions, strict=True)]
    return {"forces.csv": _table("time,tension_1,tension_2,tension_3", rows)}


def motive(m: Motion) -> Export:
    text = _motive(m, ["Type", "Name", "ID"], ["base", "tip"], [0 * m.tip, m.tip])
    return Export(text, quantity="tension", others=_forces(m))


def motive_without_labels(m: Motion) -> Export:
    text = _motive(m, ["", "", ""], ["wand", "tip"], [0 * m.tip, m.tip])
    return Export(text, quantity="tension", others=_forces(m))


def motive_with_parents(m: Motion) -> Export:
    text = _motive(m, ["Type", "Name", "ID", "Parent"], ["tip"], [m.tip])
    return Export(text, quantity="tension", others=_forces(m))


def motive_renamed_marker(m: Motion) -> Export:
    first, second = m.tip.copy(), m.tip.copy()
    first[9:], second[:11] = np.nan, np.nan
    names = ["Unlabeled 1002", "Unlabeled 1017"]
    text = _motive(m, ["Type", "Name", "ID"], names, [first, second])
    return Export(text, quantity="tension", others=_forces(m), left=2)


def motive_two_markers(m: Motion) -> Export:
    names = ["Unlabeled 1002", "Unlabeled 1017"]
    text = _motive(m, ["Type", "Name", "ID"], names, [m.tip, m.tip + 0.01])
    return Export(text, tip=False, undecided=["which point is the tip"])


def ndi_aurora(m: Motion) -> Export:
    header = "Tools,Port 1,Frame,Face,State,Q0,Qx,Qy,Qz,Tx,Ty,Tz,Error,Markers,m1,m2,m3"
    rows = []
    for i, (p, q, d) in enumerate(zip(m.tip, m.quaternions, m.displacements, strict=True)):
        lost = i in (5, 6)
        pose = ["-3.697314E+028"] * 8 if lost else [*q[[3, 0, 1, 2]], *(1e3 * p), 0.1 + i / 100]
        rows.append((1, "0A", 700 + i, 0, "MISSING" if lost else "OK", *pose, 0, *(1e3 * d)))
    said = ['the rate of "Frame"']
    return Export(_table(header, rows), time=None, quantity="displacement", left=2, undecided=said)


def ndi_optotrak(m: Motion) -> Export:
    head = "Number of frames: 24\nNumber of markers: 1\nFrequency: 50\n\n"
    head += "Frame,Tip x [mm],Tip y [mm],Tip z [mm],Force 1 [N],Force 2 [N],Force 3 [N]"
    rows = [(i, *(1e3 * p), *f) for i, (p, f) in enumerate(zip(m.tip, m.tensions, strict=True), 1)]
    return Export(_table(head, rows), quantity="tension")


def qualisys(m: Motion) -> Export:
    head = "NO_OF_FRAMES\t24\nNO_OF_MARKERS\t2\nFREQUENCY\t50\nMARKER_NAMES\tfoot\ttip"
    rows = [(*(0 * p), *(1e3 * p)) for p in m.tip]
    return Export(_table(head, rows, "\t"), time=None, undecided=NO_COMMANDS)


def trc(m: Motion) -> Export:
    head = "PathFileType\t4\t(X/Y/Z)\tarm.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n"
    head += "50.00\t50.00\t24\t2\tmm\nFrame#\tTime\tmid\t\t\ttip\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n"
    rows = [
        (i + 1, t, *(400 * p), *(1e3 * p))
        for i, (t, p) in enumerate(zip(m.time, m.tip, strict=True))
    ]
    return Export(_table(head, rows, "\t"), undecided=NO_COMMANDS)


def _matlab(m: Motion, clock: Callable[[float], str], step: float = 0.25) -> Export:
    header = "Time,Var1_1,Var1_2,Var1_3,tip_1,tip_2,tip_3"
    rows = [
        (clock(step * i), *(1e3 * d), *(1e3 * p))
        for i, (d, p) in enumerate(zip(m.displacements, m.tip, strict=True))
    ]
    return Export(_table(header, rows), quantity="displacement", time=step)


def matlab_durations(m: Motion) -> Export:
    return _matlab(m, lambda t: f"{t:g} sec")


def matlab_clock(m: Motion) -> Export:
    return _matlab(m, lambda t: f"00:00:{t:05.2f}")


def matlab_datetime(m: Motion) -> Export:
    return _matlab(m, lambda t: f"29-Feb-2024 23:59:{t + 50:06.3f}", 0.3)


def matlab_serial_dates(m: Motion) -> Export:
    return _matlab(m, lambda t: f"{739_311.5 + t / 86_400:.12f}")


def us_spreadsheet(m: Motion) -> Export:
    return _matlab(m, lambda t: f"2/29/2024 12:59:{int(t):02d} PM", 1)


def ambiguous_dates(m: Motion) -> Export:
    found = _matlab(m, lambda t: f"03/04/2024 12:59:{int(t):02d}", 1)
    return replace(found, time=None, undecided=["whether the day or the month is first in"])


def german_spreadsheet(m: Motion) -> Export:
    header = "Zeit;Kraft 1 [N];Kraft 2 [N];Kraft 3 [N];Spitze X [mm];Spitze Y [mm];Spitze Z [mm]"
    rows = [
        (f"29.02.2024 13:00:{t:09.6f}", *f, *(1e3 * p))
        for t, f, p in zip(m.time, m.tensions, m.tip, strict=True)
    ]
    text = _table("", rows, ";").replace(".", ",").replace("29,02,2024", "29.02.2024")
    return Export(header + "\n" + text, quantity="tension")


def labview(m: Motion) -> Export:
    head = "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nDate\t2024/02/29\n"
    head += (
        "***End_of_Header***\t\n\t\nChannels\t6\t\nX_Dimension\tTime\tTime\n***End_of_Header***\t\n"
    )
    names = [f"Force {i} (N)" for i in (1, 2, 3)] + [f"Tip {axis} (mm)" for axis in "XYZ"]
    head += "\t".join(["X_Value", *names, "Comment"])
    rows = [(t, *f, *(1e3 * p)) for t, f, p in zip(m.time, m.tensions, m.tip, strict=True)]
    return Export(_table(head, rows, "\t"), quantity="tension")


def serial_monitor(m: Motion) -> Export:
    rows = [
        (round(1e3 * t), *(f / 9.80665), *(1e3 * p))
        for t, f, p in zip(m.time, m.tensions, m.tip, strict=True)
    ]
    return Export(
        _table("millis,load_1_kg,load_2_kg,load_3_kg,x_mm,y_mm,z_mm", rows), quantity="tension"
    )


def pandas_index(m: Motion) -> Export:
    rows = [
        (i, f"0 days 00:00:{t:09.6f}", *f, *(1e3 * p))
        for i, (t, f, p) in enumerate(zip(m.time, m.tensions, m.tip, strict=True))
    ]
    header = ",elapsed,tension_1 (N),tension_2 (N),tension_3 (N),tipX,tipY,tipZ"
    return Export(_table(header, rows), quantity="tension")


def robot_arm(m: Motion) -> Export:
    header = "timestamp " + " ".join(f"actual_TCP_pose_{i}" for i in range(6))
    rows = [(t, *p, *q[:3]) for t, p, q in zip(m.time, m.tip, m.quaternions, strict=True)]
    said = ["the tip: no three columns", *NO_COMMANDS]
    return Export(_table(header, rows, " "), tip=False, undecided=said)


def pose_estimation(m: Motion) -> Export:
    head = "scorer,net,net,net,net,net,net\nbodyparts,base,base,base,tip,tip,tip\n"
    head += "coords,x,y,likelihood,x,y,likelihood"
    rows = [(i, 100.0, 99.0, 0.99, *(400 + 300 * p[:2]), 0.98) for i, p in enumerate(m.tip)]
    said = ["the tip: no three columns", *NO_COMMANDS]
    return Export(_table(head, rows), tip=False, undecided=said)


def force_torque_sensor(m: Motion) -> Export:
    rows = [(t, *f, *(0.1 * f)) for t, f in zip(m.time, m.tensions, strict=True)]
    text = _table("Time [s],Fx,Fy,Fz,Tx [Nm],Ty [Nm],Tz [Nm]", rows)
    return Export(text, tip=False, undecided=["the tip: no three columns", *NO_COMMANDS])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("0.000000,0.900447", "1e300,1e300"),  # its square is no number
        ("field.pose.position.x,field", "field\tpose\tposition\tx,field"),
        ("%time", "x" * 300),
        ("\n", "\n\n"),
        ("mocap", '"'),
    ],
)
def test_damaged_exports_give_a_draft_or_a_sentence(
    old: str, new: str, motion: Motion, robot: bs.Robot, tmp_path: Path
) -> None:
    text = ros_pose(motion).text
    assert old in text
    (tmp_path / "a.csv").write_text(text.replace(old, new))
    with pytest.raises(InputError):
        read_measurements(tmp_path / "a.csv", robot)


def _saved(path: Path, variables: dict[str, object]) -> Path:
    savemat(path, variables, do_compression=True)
    return path


def _saved_7_3(path: Path, variables: dict[str, object]) -> Path:
    """Write arrays and structs as MATLAB does in version 7.3: HDF5 behind a header of 512 bytes."""
    h5py = pytest.importorskip("h5py", reason="needs the extra matlab")

    def fill(group: Any, values: dict[str, object]) -> None:
        for name, value in values.items():
            if isinstance(value, dict):
                made = group.create_group(name)
                made.attrs["MATLAB_class"] = np.bytes_("struct")
                fill(made, value)
            elif isinstance(value, str):
                made = group.create_dataset(name, data=np.array([[ord(c)] for c in value], "u2"))
                made.attrs["MATLAB_class"] = np.bytes_("char")
            else:
                array = np.atleast_2d(np.asarray(value))
                made = group.create_dataset(name, data=array.T if array.shape[0] > 1 else array)
                made.attrs["MATLAB_class"] = np.bytes_("double")

    with h5py.File(path, "w", userblock_size=512) as file:
        fill(file, variables)
        table = file.create_dataset("table", data=np.array([[0xDD000000, 2, 1, 1, 1, 1]], "u4"))
        table.attrs["MATLAB_class"] = np.bytes_("table")
        table.attrs["MATLAB_object_decode"] = np.int32(3)
        file.create_group("#refs#")
        file["elsewhere"] = h5py.ExternalLink("/etc/hostname", "/")
        parts = h5py.VirtualLayout((5, 1), "f8")
        parts[:] = h5py.VirtualSource("/etc/hostname", "x", (5, 1))
        file.create_virtual_dataset("virtual", parts).attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return path


@pytest.mark.parametrize("save", [_saved, _saved_7_3])
def test_a_matlab_file_is_read_by_its_draft(
    save: Callable[[Path, dict[str, object]], Path],
    motion: Motion,
    robot: bs.Robot,
    tmp_path: Path,
) -> None:
    log = {"time": motion.time[:, None], "cable": 1e3 * motion.displacements}
    path = save(
        tmp_path / "run.mat", {"log": log, "tip": 1e3 * motion.tip, "rig": "B", "gain": 2.0}
    )
    (tmp_path / "map.yaml").write_text(drafted(path, robot))
    found = read_measurements(path, robot, tmp_path / "map.yaml")
    np.testing.assert_allclose(found.tip, motion.tip, atol=1e-12)
    np.testing.assert_allclose(found.displacements, motion.displacements, atol=1e-12)
    assert found.time is not None and found.line.tolist() == list(range(1, ROWS + 1))
    says = "this MATLAB file cannot be read"
    path.write_bytes(path.read_bytes()[: 600 if save is _saved_7_3 else 300])
    refused(says, lambda: read_measurements(path))
    save(path, {"rig": "B", "gain": 2.0})
    says = "tables and timetables of MATLAB are saved by writetable"
    refused(says if save is _saved_7_3 else "no variable has rows", lambda: read_measurements(path))


def test_version_7_3_needs_an_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(600))
    monkeypatch.setitem(sys.modules, "h5py", None)
    refused(r"need h5py.*'bowstring\[matlab\]'; or save the file", lambda: read_measurements(path))


def test_variables_of_different_lengths_are_two_tables(motion: Motion, tmp_path: Path) -> None:
    variables = {
        "t": motion.time,
        "tip": motion.tip,
        "clock": np.linspace(0, 1, 90),
        "force": np.linspace(0, 9, 90),
    }
    path = _saved(tmp_path / "run.mat", variables)
    mapping = tmp_path / "map.yaml"
    fields = """\
source: measured
time: {column: t, unit: s}
tip: {columns: [tip_1, tip_2, tip_3], unit: m}
tendons: {quantity: tension, unit: N, columns: [force]}
join: {file: run.mat, table: {block: force}, time: {column: clock, unit: s}}
"""
    mapping.write_text(fields)
    with pytest.raises(
        InputError, match=r'rows \("t" 24, "tip" 24, "clock" 90, "force" 90\); name'
    ):
        read_measurements(path, mapping=mapping)
    mapping.write_text(fields + "table: {block: tip}\n")
    found = read_measurements(path, mapping=mapping)
    np.testing.assert_allclose(found.tensions[:, 0], 9 * motion.time, atol=1e-12)
    assert 'another number of rows are not read: "clock", "force"' in found.issues[0][1]
    mapping.write_text(fields + "table: {block: tips}\n")
    with pytest.raises(InputError, match='no variable "tips"; the file has "t", "tip"'):
        read_measurements(path, mapping=mapping)
    mapping.write_text(fields + "table: {skip: 2}\n")
    refused("a MATLAB file has block alone", lambda: read_measurements(path, mapping=mapping))


def test_large_matlab_files_are_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bowstring.data.matlab._MOST_BYTES", 20_000)
    with pytest.raises(InputError, match="would unpack to more than"):
        read_measurements(_saved(tmp_path / "a.mat", {"F": np.arange(5_000.0)}))


EXPORTS = [
    *(ros_pose, bag_to_csv, ros2_echo, plotjuggler, tum_trajectory, vicon_trajectories),
    *(vicon_blocks, motive, motive_without_labels, motive_with_parents, motive_renamed_marker),
    *(motive_two_markers, ndi_aurora, ndi_optotrak, qualisys, trc, matlab_durations, matlab_clock),
    *(matlab_datetime, matlab_serial_dates, us_spreadsheet, ambiguous_dates, german_spreadsheet),
    *(labview, serial_monitor, pandas_index, robot_arm, pose_estimation, force_torque_sensor),
]


@pytest.mark.parametrize("export", EXPORTS, ids=lambda export: export.__name__)
def test_an_export_is_read_by_its_draft(
    export: Callable[[Motion], Export], motion: Motion, robot: bs.Robot, tmp_path: Path
) -> None:
    file = export(motion)
    path = tmp_path / "export.csv"
    for name, text in {"export.csv": file.text, **file.others}.items():
        (tmp_path / name).write_text(text, "utf-8")
    text = drafted(path, robot)
    said = [line[len("# not decided: ") :] for line in text.splitlines() if "# not decided" in line]
    for beginning in file.undecided:
        assert any(line.startswith(beginning) for line in said), text
    (tmp_path / "map.yaml").write_text(text)
    if not file.tip:
        with pytest.raises(InputError, match="nothing is measured"):
            read_measurements(path, mapping=tmp_path / "map.yaml")
        return
    assert bool(file.quantity) == ("\ntendons:" in text) and len(said) == len(file.undecided), text
    found = read_measurements(path, robot if file.quantity else None, tmp_path / "map.yaml")
    assert len(found) == ROWS and found.left_out == 0 and found.without_tip == file.left, text
    np.testing.assert_allclose(found.tip[found.seen], motion.tip[found.seen], atol=2e-6)
    if file.quantity == "tension":
        np.testing.assert_allclose(found.tensions, motion.tensions, atol=1e-5)
    elif file.quantity:
        np.testing.assert_allclose(found.displacements, motion.displacements, atol=1e-6)
    if file.time is not None:
        assert found.time is not None, text
        np.testing.assert_allclose(np.diff(found.time), file.time, atol=2e-5)


@pytest.mark.parametrize(
    ("order", "says"),
    [
        ((1, 2, 0), r'"Force 9 \[N\]", "Force 10 \[N\]", "Force 11 \[N\]"'),
        (
            (0, 2, 1),
            r'(?s)"Force 9 \[N\]", "Force 11 \[N\]".*not decided: the order of the tendons',
        ),
    ],
)
def test_tendons_are_drafted_in_the_order_of_their_numbers(
    motion: Motion, tmp_path: Path, order: tuple[int, ...], says: str
) -> None:
    """Programs write columns in the order of the alphabet, 10 before 2; other orders are kept."""
    header = ",".join([f"Force {9 + k} [N]" for k in order] + [f"Tip {c} [mm]" for c in "xyz"])
    rows = [(*f[list(order)], *(1e3 * p)) for p, f in zip(motion.tip, motion.tensions, strict=True)]
    file = tmp_path / "log.csv"
    file.write_text(_table(header, rows))
    assert re.search(says, drafted(file))


def test_a_line_of_rates_without_its_values_is_no_error_of_the_draft(tmp_path: Path) -> None:
    file = tmp_path / "log.trc"
    rows = "".join(f"{i}\t{2 * i}\t{3 * i}\n" for i in range(9))
    file.write_text(f"PathFileType\t4\tDataRate\nlog\na\tb\tc\n{rows}")
    drafted(file)
