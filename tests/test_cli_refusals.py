"""Bad input of the command line: one table of flags, one of files.

Nothing is written then, and stderr has one line with exit code 2. A motion does not begin, but
where the motion itself checks its displacements.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from bowstring.dynamics import simulation
from shell import Shell, refuses

TABLE = Path(__file__).parents[1] / "examples" / "bench.csv"
SOLVE = ("solve", "amouri2019")
LOADED = (*SOLVE, "--tension", "1,2,3")
SIMULATE = ("simulate", "amouri2019")
BENCH = ("bench", "simulate", "amouri2019", "--out", "bench.csv")
BENCHED = (*BENCH, "--tensions", "0:5:10")
FITTED = ("fit", "amouri2019", "--parameter", "base")
RELAXES = ("--actual", "segments.0.backbone.relaxation=0.2")
UPRIGHT = ("--set", "gravity=0 0 -9.80665 m/s^2")
FIT = ("fit", "amouri2019", "--measurements", str(TABLE), *UPRIGHT)
COMPARE = (*FIT, "--parameter", "base", "--compare")
E = "segments.0.backbone.E"


def of(*parts: str) -> tuple[str, ...]:
    return ("fit", "amouri2019", *parts)


#: By command: its further arguments, and words of the message.
FLAGS: dict[tuple[str, ...], list[tuple[Sequence[str], str | tuple[str, ...]]]] = {
    (): [
        (["solve", "", "--tension", "80,0,0"], "ROBOT: got nothing; name a built-in robot"),
        # numbers
        (["fk", "amouri2019", "--lengths", "nan,1,1"], 'got "nan", which is not a number'),
        (["fk", "amouri2019", "--lengths", "inf,1,1"], 'got "inf", which is not a number'),
        (["fk", "amouri2019", "--lengths", "1e999,1,1"], "too large"),
        (["fk", "amouri2019", "--lengths", "0.6,,0.6"], "got nothing"),
        (["fk", "amouri2019", "--lengths", ""], "got nothing"),
        (["fk", "amouri2019", "--lengths", "0.6 0.6 0.6"], "more than one number"),
        (["fk", "amouri2019", "--lengths", "a,b,c"], 'got "a"'),
        (["fk", "amouri2019", "--lengths", "0.6,0.6,0.6 kg"], '"kg" is not a unit of length'),
        (["fk", "amouri2019", "--lengths", "0.6,0.6,0.6 furlongs_"], "is not a known unit"),
        (["fk", "amouri2019", "--lengths", "0.6,0.6,0.6 " + "m" * 500], "is not a unit"),
        (["fk", "amouri2019", "--lengths", "0,0.6,0.6"], "must be positive"),
        (["fk", "amouri2019", "--lengths", "-0.6,0.6,0.6"], "must be positive"),
        (["fk", "amouri2019", "--lengths", "0x1,1,1"], "0x1"),
        (["fk", "amouri2019", "--lengths", "1_0,1,1"], "1_0"),
        (["fk", "amouri2019", "--lengths", "٣,1,1"], "not a number"),
        # counts
        (["fk", "amouri2019", "--lengths", "0.6,0.6"], "2 numbers; amouri2019 has 3 tendons"),
        (["fk", "rao2021", "--lengths", "0.2,0.2,0.2"], "rao2021 has 6 tendons"),
        (["solve", "amouri2019", "--tension", "1"], "got 1 number;"),
        ([*LOADED, "--gravity", "9.81"], "--gravity: got 1 number"),
        ([*LOADED, "--tip-force", "1,2,3,4"], "--tip-force: got 4 numbers"),
        # values
        (["solve", "amouri2019", "--tension", "nan,0,0"], "not a number"),
        (["solve", "amouri2019", "--tension", "-1,0,0"], "a tendon cannot push"),
        ([*LOADED, "--gravity", "0,0,-inf"], 'got "-inf"'),
        ([*LOADED, "--theory", "timoshenko"], "is not one of 'cosserat', 'kirchhoff'"),
        ([*LOADED, "--elements", "3"], ("--elements: got 3", "must be 1, 2, 4 or 8")),
        # geometry
        (
            ["fk", "amouri2019", "--lengths", "0.1,0.9,0.9"],
            ("--lengths: segment 1: ", "more than a full turn"),
        ),
        (["ik", "amouri2019", "--tip", "0,0,5"], "out of reach"),
        (["ik", "amouri2019", "--tip", "0,0,1e155"], "out of reach"),
        (
            ["ik", "amouri2019", "--tip", "0,0,-0.1", "--model", "cc", "--free-length"],
            "cannot be reached",
        ),
        (
            ["ik", "rao2021", "--tip", "0,0,0.3", "--model", "cc", "--free-length"],
            "for robots of one segment",
        ),
        # robots
        (["solve", "amouri", "--tension", "1,2,3"], "did you mean amouri2019?"),
        (["solve", "no/such.yaml", "--tension", "1,2,3"], "neither a file nor a built-in robot"),
        (["solve", ".", "--tension", "1,2,3"], "folder"),
        (["solve", "mine/notes.txt", "--tension", "1,2,3"], 'got "keep me"; must be fields'),
        # overrides
        ([*LOADED, "--set", "segments.0.length"], "write for example --set"),
        ([*LOADED, "--set", "=3 mm"], "write for example --set"),
        ([*LOADED, "--set", "segments.0.length=-1 mm"], "segments[0].length"),
        ([*LOADED, "--set", "segments.0.length=1 kg"], "not a unit of length"),
        ([*LOADED, "--set", "segments.0.lenght=1 m"], "did you mean length?"),
        ([*LOADED, "--set", "segments.7.length=1 m"], "there is no"),
        ([*LOADED, "--set", "segments.0.tendons.pitch_radius=40 mm"], "outside its disk"),
        # usage
        (["fly"], "No such command 'fly'"),
        (["stdy"], "Did you mean 'study'? See bowstring --help."),
        ([*LOADED, "0", "0"], "unexpected 0 0: separate numbers by commas without blanks"),
        ([*LOADED, "0,", "0"], "unexpected 0, 0: separate numbers by commas without blanks"),
        (
            [*LOADED, "N,0,0"],
            "unexpected N,0,0: separate numbers by commas without blanks, or quote",
        ),
        ([*LOADED, "-1", "0"], "unexpected -1: separate numbers by commas without blanks"),
        ([*LOADED, "--diameter", "--json"], "write --set segments.0.backbone.diameter=VALUE"),
        ([*LOADED, "--friction", "0.2"], "write --set segments.0.tendons.friction=0.2;"),
        ([*LOADED, "--E=60 GPa"], 'write --set segments.0.backbone.E="60 GPa";'),
        ([*LOADED, "--clamped-length"], "write --set segments.0.disks.clamped_length=VALUE;"),
        (["solve", "rao2021", "--tension", "1 kg"], 'for example --tension "80 N",0,0,0,0,0.'),
        (["fk", "amouri2019"], "the tendons' lengths or displacements: give one of the two"),
        (["fk", "--lengths", "1,1,1"], "Missing argument 'ROBOT'"),
        (["fk", "amouri2019", "--wings"], "--wings"),
        (["fk", "amouri2019", "--lengths"], "requires an argument"),
        ([*LOADED, "--elements", "many"], "--elements"),
        ([*LOADED, "again"], "again"),
        (of(), "Missing option '--parameter'"),
        (of("--parameter", "gain"), "--measurements FILE or --data NAME"),
        (of("--parameter", "gain", "--data", "tamm-spring", "--measurements", "x"), "give either"),
        (of("--parameter", "gain", "--data", "tam-spring"), "did you mean tamm-spring?"),
        (
            of("--parameter", "gain", "--data", "x", "--mapping", "y"),
            "--mapping is for tables",
        ),
        (
            (*FIT, "--parameter", "gain", "--part", "val"),
            "--part selects a table",
        ),
        ((*FIT, "--parameter", "gian"), "did you mean gain?"),
        ((*FIT, "--parameter", "bend_gain"), "give --model arc"),
        ((*FIT, "--parameter", E, "--holdout", "1.5"), "--holdout: got 1.5; must be a share"),
        ((*FIT, "--parameter", E, "--holdout", "some"), '--holdout: got "some"; must be'),
        ((*FIT, "--parameter", E, "--folds", "1"), "--folds: got 1; must be 2 or more"),
        ((*FIT, "--parameter", E, "--folds", "9"), "only 2 groups or loads to leave out"),
        ((*FIT, "--parameter", E, "--folds", "2", "--holdout", "0.2"), "are ways to validate"),
        ((*FIT, "--parameter", E, "--folds", "2", "--validate", "x"), "are ways to validate"),
        ((*FIT, "--parameter", E, "--filter"), "--filter needs a table to predict"),
        ((*FIT, "--parameter", E, "--residual"), "rows that are not fitted; give --validate FILE"),
        ((*COMPARE, "--model", "arc"), "leave --model out"),
        ((*COMPARE, "--holdout", "0.2"), "give --folds in place of --holdout"),
        ((*COMPARE, "--start", "calibration.json"), "leave --start out"),
        ((*COMPARE, "--folds", "16"), "too few to compare models"),
        ((*FIT, "--parameter", E, "--validate", str(TABLE)), "is the table that is fitted"),
        ((*FIT, "--parameter", E, "--start", "no.json"), "--start: cannot read no.json"),
        ((*FIT, "--parameter", E, "--gravity-on-masses", "-1"), "--gravity-on-masses: got -1"),
        ((*FIT, "--parameter", E, "--out", "mine"), "existing files are not overwritten"),
        (("fit", "rao2021", "--measurements", str(TABLE), "--parameter", E), "rao2021 has 6"),
        (of("--measurements", "no.csv", "--parameter", E), "no.csv: the table cannot be"),
        (
            ["solve", "amouri2019", "--tension", "10 mm,0,0"],
            '--tension: got "10 mm", but "mm" is not a unit of force; write',
        ),
        (["study", "--tolerance", "0"], "--tolerance: got 0; must be a share"),
        (
            ["study", "--tolerance", "0.5 N"],
            (
                '--tolerance: got "0.5 N"; must be a share of the length above 0 and below 1, '
                'such as 0.01 or "1 %", or a length such as "0.5 mm".',
            ),
        ),
        (
            ["study", "--modal-damping", "5 N"],
            '--modal-damping: got "5 N"; must be a share of critical damping',
        ),
        (
            ["simulate", "amouri2019", "--tension", "1,0,0", "--tolerance", "0 %"],
            '--tolerance: got "0 %"; must be a length above 0, such as "1 um"',
        ),
        (["study", "--max-tension", "-5"], "--max-tension: got -5 N"),
        (["study", "--points", "1"], ("--points: got 1", "from 2 to 1000")),
        (
            ["study", "--tendon", "4"],
            "--tendon: got 4; must be a tendon of amouri",
        ),
        (["study", "--tendon", "1,"], "--tendon: got nothing; must be a tendon"),
        (["study", "--tendon", "1:0"], "--tendon: the share of tendon 1 is 0.0; must be above"),
        (["study", "--tendon", "1,1"], "--tendon: tendon 1 is there twice"),
        (
            ["study", "--tendon", "1:50 %"],
            "--tendon: the largest share of the actuated tendons is 0.5;",
        ),
        (["study", "--tendon", "1,2,3"], ("--tendon: ", "balance each other")),
        (["study", "--max-tension", "1e7"], "--max-tension: by the linear law"),
        (["study", "--measurements", "no.csv"], "--measurements: no.csv: the table cannot"),
        (
            [*SOLVE, "--angle", "70 rad,0,0", "--set", "segments.0.tendons.spool_radius=1 cm"],
            "--angle: displacement of tendon 1 is 0.7",
        ),
        (["solve", "no", "--set", "foo=1", "--tension", "1,0,0"], "no is neither a file"),
        ([*SOLVE, "--set", "foo=1", "--tension", "1,0,0"], "--set: amouri2019: foo: unknown"),
        (
            [*SIMULATE, "--displacement", "0.9,0,0"],
            "--displacement: the displacement of tendon 1 is 0.9 m at 1",
        ),
        (
            [*SIMULATE, "--displacement", "0,0,0", "--from-displacement", "0.9,0,0"],
            (
                "--displacement or --from-displacement: ",
                "the displacement of tendon 1 is 0.9 m at 0 s",
            ),
        ),
        (
            [*BENCH, "--displacements", "0:0.5:1"],
            "--displacements: got 1 m for tendon 1; must be less than",
        ),
        ([*BENCHED, "--drift", "1e9,0,0"], "--drift: got 1e+09 m; must be up to 1e+06 m"),
        ([*BENCHED, "--friction", "100"], "--friction: amouri2019: segments[0].tendons.f"),
        ([*BENCHED, "--actual", "foo=1"], "--actual: amouri2019: foo: unknown field"),
        ([*FITTED, "--data", "no"], '--data: there is no data set "no"'),
        (
            [*FITTED, "--data", "ucl-planar-shape", "--part", "no"],
            "--part: ucl-planar-shape has no",
        ),
        (
            [*FITTED, "--measurements", "no.csv", "--mapping", "no.yaml"],
            "--mapping: Mapping no.yaml is neither",
        ),
        (["fe", "amouri2019", "--tension", "1,0,0", "--stiffness", "0"], "--stiffness: got 0;"),
        (
            ["fe", "amouri2019", "--tension", "1,0,0", "--loads", "x"],
            ('--loads: got "x"', "for example --loads 10:10:80"),
        ),
    ],
    ("study",): [
        (["--tolerance", "150 %"], "tolerance"),
        (["--tolerance", "nan"], "must be a share of the length above 0 and below 1"),
        (["--max-tension", "1,2"], "write one"),
        (["--points", "1e9"], "--points"),
        (["--rise", "0"], "--rise: got 0 s; must be positive"),
        (["--rise", "5 mm"], '--rise: got "5 mm", but "mm" is not a unit of time'),
        (["--rise", "0.1"], "--rise: got 0.1 s; must be from 0.11 to 87.7 s"),
        (["--modal-damping", "120 %"], "--modal-damping"),
        (["--out", ""], "no study of Bowstring"),
        (["--out", "mine"], ("--out: cannot write the study", "no study of Bowstring")),
        (["--out", "mine/notes.txt"], "is a file"),
        (["--grip", "sliding"], "--grip is for finite elements"),
        (["--compare"], "--compare needs measurements"),
        (["--mapping", "m.yaml"], "name it by --measurements"),
        (["rao2021", "--measurements", str(TABLE)], "has 3 tendons"),
    ],
    ("suite",): [(["--out", "mine"], "no suite of Bowstring")],
    SOLVE: [
        (["--displacement", "1,2"], "--displacement: got 2 numbers;"),
        (["--displacement", "0.01,-,0"], 'got "-", which is not a number'),
        (
            ["--displacement", "1,0,0"],
            "--displacement: got 1 m for tendon 1; must be less than the tendon's length, 0.641 m",
        ),
        (["--angle", "1,0,0"], "--angle: tendon 1 of amouri2019 has no spool_radius"),
        (["--angle", "1 mm,0,0"], "is not a unit of"),
        (
            ["--tension", "1,-,-", "--displacement", "0.01,0,0"],
            "tendon 1 has --tension and --displacement",
        ),
        (["--tension", "1,-,-", "--displacement", "-,0,-"], "tendon 3 has no command"),
        (["--tension", "1,-", "--displacement", "-,0,-"], "--tension: got 2 entries;"),
        (["--tension", "-1,-,-", "--displacement", "-,0,0"], "a tendon cannot push"),
        (
            ["--tension", "1,-,-", "--displacement", "-,x,0"],
            '--displacement: got "x", which is not a number',
        ),
        (
            ["--displacement", "0,0,0", "--history", "none.json"],
            "--history: none.json cannot be read",
        ),
        (["--displacement", "0,0,0", "--history", "mine"], "--history: mine cannot be read"),
        (["--displacement", "0,0,0", "--history", "mine/notes.txt"], "is no JSON"),
        (
            ["--displacement", "0,0,0", "--save-history", "no/a.json"],
            "cannot write the history to no/a",
        ),
        (["--displacement", "0,0,0", "--save-history", "mine"], "it is a folder"),
    ],
    ("bench", "check", str(TABLE)): [
        (["--robot", "amouri"], "neither a file nor a built-in robot"),
        (["--robot", "rao2021"], "has 3 tendons, rao2021 has 6"),
        (["--mapping", "tamm-sprin"], "did you mean tamm-spring?"),
        (["--gravity-on-masses", "0"], "on-masses: got 0 m/s^2; must be positive"),
        (["--set", "segments.0.length=1"], "name it by --robot"),
    ],
    BENCH: [
        ([], "loads are missing: give for example --masses 0:0.5:8"),
        (
            ["--masses", "1", "--displacements", "0"],
            "--masses and --displacements are the loads; give either",
        ),
        (["--masses", "0:8"], '--masses: got "0:8"; write first:step:last'),
        (["--masses", "0:0:8"], "--masses: steps of 0 kg do not lead from 0 to 8"),
        (["--masses", "0:-1:8"], "steps of -1 kg do not lead from 0 to 8"),
        (["--masses", "0:8:0.5"], "leads beyond 0.5; the order is first:step:last"),
        (["--masses", "0:0.3:8"], "do not meet 8; end for example at 7.8"),
        (["--masses", "0:1e-9:8"], "got 8e+09 steps; up to 100000 are possible"),
        (["--masses", "0:1 N:8"], '--masses: got "1 N", but "N" is not a unit of mass'),
        (["--masses", "1,-1"], "--masses: got -1 kg; must be 0 or more, a tendon cannot push"),
        (["--masses", "1", "--tendon", "4"], "--tendon: got 4; amouri2019 has 3 tendons"),
        (["--masses", "1", "--tilt", "0.3 mm"], '--tilt: got "0.3 mm", but "mm" is not a unit of'),
        (["--masses", "1", "--tilt", "1,2,3"], "--tilt: got 3 numbers; write an angle"),
        (["--masses", "1", "--tilt", "-1 deg"], "--tilt: got -0.0174533 rad; must be zero or more"),
        (["--masses", "1", "--noise", "-1 mm"], "--noise: got -0.001 m; must be 0 or more"),
        (["--masses", "1", "--repeats", "0"], "--repeats: got 0; must be a whole number from 1"),
        (["--masses", "1", "--seed", "-1"], "--seed: got -1; must be 0 or more"),
        (["--masses", "1", "--friction", "-0.1"], "--friction: got -0.1; must be 0 or more"),
        (["--masses", "1", "--friction", "x"], '--friction: got "x", which is not a number'),
        (["--masses", "1", "--shift", "1,2"], "--shift: got 2 numbers; write x, y and z"),
        (["--masses", "1", "--actual", "E"], '--actual: got "E"; write for example --actual'),
        (["--masses", "1", "--actual", "segments.0.backbone.Q=1"], "unknown field"),
        (["--masses", "1", "--gravity-frame", "world"], "--gravity-frame"),
        (["--masses", "1", *RELAXES], "--period: amouri2019 has relaxation or creep"),
        (["--masses", "1", *RELAXES, "--period", "soon"], "write for example --period"),
        (["--masses", "1", "--gravity-on-masses", "0"], "got 0 m/s^2; must be positive"),
    ],
    SIMULATE: [
        (
            [],
            "give --tension T1,T2,..., --displacement P1,P2,..., --angle A1,A2,... or --table FILE",
        ),
        (["--tension", "80,0,0", "--from", "1"], "--from: got 1 entry"),
        (["--tension", "80,0,0", "--rise", "-1"], "--rise: got -1 s; must be 0 or more"),
        (["--tension", "80,0,0", "--rise", "nan"], '--rise: got "nan"'),
        (["--tension", "80,0,0", "--rise", "1e-13"], "--rise: got 1e-13 s; must be 0, which is"),
        (["--tension", "80,0,0", "--rise", "0", "--hold", "0"], "no time to simulate"),
        (["--tension", "80,0,0", "--hold", "1e9"], "--hold: the run takes 1e+09 s; up to"),
        (["--tension", "80,0,0", "--rise", "1e300"], "--rise: the run takes"),
        (["--tension", "80,0,0", "--rise", "1 mm"], '--rise: got "1 mm", but "mm" is not a unit'),
        (["--tension", "80,0,0", "--dt", "0"], "--dt: got 0 s; must be positive"),
        (["--tension", "80,0,0", "--dt", "10 ns"], "--dt: got 1e-08 s; must be 1e-06 s or more"),
        (["--tension", "80,0,0", "--dt", "1", "--tolerance", "1"], "give either"),
        (["--tension", "80,0,0", "--tolerance", "0"], "--tolerance: got 0; must be a length"),
        (["--tension", "80,0,0", "--tolerance", "0.5 N"], "or a share of that of the robot"),
        (["--tension", "80,0,0", "--every", "0"], "--every: got 0 s"),
        (["--tension", "80,0,0", "--every", "1 us"], "--every: 1 us gives 2e+06 outputs"),
        (["--tension", "80,0,0", "--every", "0.1 ns"], "--every: got 1e-10 s; must be 1e-06 s or"),
        (["--tension", "80,0,0", "--rise", "0", "--hold", "1 ns"], "the run takes 1e-09 s; 1e-06"),
        (
            ["--tension", "8,0,0", "--modal-damping", "0.1", "--tip-moment", "0,1,0"],
            "--modal-damping needs the modes, and under --tip-moment there are none",
        ),
        (["--tension", "80,0,0", "--mass-damping=-1"], "--mass-damping: got -1 1/s"),
        (["--tension", "80,0,0", "--material-damping", "1/s"], "--material-damping: got"),
        (["--tension", "80,0,0", "--modal-damping", "2"], "--modal-damping: got 2; must be"),
        (
            ["--tension", "80,0,0", "--modal-damping", "0.1", "--mass-damping", "1"],
            "--modal-damping is instead of",
        ),
        (["--tension", "80,0,0", "--spectral-radius", "1.1"], "--spectral-radius: got 1.1"),
        (["--tension", "80,0,0", "--spectral-radius", "nan"], "--spectral-radius: got nan"),
        # tables
        (["--table", "none.csv"], "--table: none.csv: the table cannot be read: No such file"),
        (["--table", "/dev/zero"], "/dev/zero: the table is too large; 100 MB are read"),
        (["--table", "."], "--table: .: the table cannot be read: it is a folder"),
        (["--table", "none.csv", "--tension", "80,0,0"], "leave --tension out"),
        (["--table", "none.csv", "--rise", "1"], "leave --rise out"),
        (["--table", "none.csv", "--hold", "1"], "leave --hold out"),
        # files
        (["--tension", "80,0,0", "--out", "no/run.nc"], "--out: cannot write the run"),
        (["--tension", "80,0,0", "--out", "."], "--out: got .; end it in .nc"),
        (["--tension", "80,0,0", "--out", "a.gif", "--out", "b.mp4"], "are of the same kind"),
        (
            ["--tension", "80,0,0", "--out", "mine/notes.txt"],
            "end it in .nc (all fields), .csv (tip and tendons)",
        ),
        (["--tension", "80,0,0", "--vtk", "mine"], "--vtk: cannot write the VTK series"),
        (["--tension", "80,0,0", "--out", "run.png"], "--out: got run.png; end it in .nc"),
        (["--tension", "80,0,0", "--out", "run.gif", "--hold", "1000"], "5000 are possible"),
        (["--tension", "80,0,0", "--out", "e/a.nc", "--vtk", "e"], "lies in the folder of --vtk"),
        (["--tension", "80,0,0", "--out", "f.nc", "--vtk", "f.nc"], "--vtk needs a folder there"),
        (["--tension", "80,0,0", "--out", "f.gif", "--vtk", "f.gif/g"], "a folder there"),
    ],
    (*SIMULATE, "--out", "run.nc"): [
        (
            ["--displacement", "0.01,0,0", "--rise", "0"],
            "jumps from 0 m to 0.01 m at 0 s, but the tendon is inextensible",
        ),
        (
            ["--tension", "1,0,0", "--from-displacement", "0,0,0"],
            "--from-displacement: got 0 for tendon 1, which",
        ),
        (
            ["--displacement", "0,0,0", "--from", "0,0,0"],
            "--from: got 0 for tendon 1, which no tension",
        ),
        (
            ["--displacement", "0,0,0", "--from-displacement", "0,0"],
            "--from-displacement: got 2 entries",
        ),
        (
            ["--displacement", "0,0,0", "--from-displacement", "x,0,0"],
            '--from-displacement: got "x"',
        ),
        (["--displacement", "0,0,0", "--table", "a.csv"], "leave --displacement out"),
        (
            ["--displacement", "0,0,0", "--history", "none.json"],
            "--history: none.json cannot be read",
        ),
    ],
    ("modes", "amouri2019"): [
        (["--count", "0"], "--count: got 0; must be from 1 to 1000"),
        (["--count", "1e9"], "--count"),
        (["--out", "mine"], ("--out: cannot write the modes", "no modes of Bowstring")),
        (["--out", "mine/notes.txt"], "is a file"),
        (["--out", "modes.png"], "--out: cannot write the modes to modes.png: it is a folder"),
    ],
    ("ik", "rao2021"): [
        ([], "give either --tip or --path"),
        (["--tip", "0,0,0.3", "--path", "x.csv"], "give either --tip or --path"),
        (["--path", "none.csv"], "cannot be read"),
        (["--tip", "0,0,0.3", "--out", "c.csv"], "--out: it is for --path"),
        (["--tip", "0,0,0.3", "--theory", "kirchhoff", "--model", "cc"], "leave --model cc out"),
        (["--tip", "0,0,0.3", "--chord"], "--chord: it is for --tip with --model cc"),
        (["--tip", "0,0,0.3", "--direction", "0,0,0"], "must not be zero"),
        (["--tip", "0,0,0.3", "--direction", "0,1"], "write x, y and z"),
        (["--tip", "0.05 mm,0 mm,0.3 mm"], "the point is no farther than 0.3041 mm from the base"),
        (["--tip", "0,0,0.3", "--max-tension", "-1"], "must be 0 or more"),
        (["--tip", "0,0,0.3", "--max-tension", "1,2"], "has 6 tendons"),
        (["--tip", "0,0,0.3", "--max-tension", "1", "--min-tension", "2 N"], "--min-tension: "),
        (["--tip", "0,0,500 m"], "out of reach"),
        (["--tip", "0,0,300"], '"300 mm"'),
        (
            ["--tip", "0.1,0,0.3", "--displacement-limits", "20 mm,-20 mm"],
            "write the least and the largest displacement",
        ),
        (
            ["--tip", "0.1,0,0.3", "--displacement-limits", "0,1 mm", "--model", "cc"],
            "leave --model cc out",
        ),
    ],
    ("map", "amouri2019"): [
        (["--over", "tension=0:80 N", "--over", "tension=0:40 N"], "two axes are tension"),
        (
            ["--over", "E=1:2 GPa", "--over", "nu=0:0.4:31", "--over", "length=1:2 m:31"],
            "--store",
        ),
        (["--metric", "mean_error"], "give other axes"),
        (["--models", "cc_from_nothing"], "models"),
        (["--out", "map.txt"], "png"),
        (["--tolerance", "200 %"], "--tolerance"),
        (
            ["--over", "E=10:11 GPa:1001", "--over", "nu=0:0.4:1001", "--points", "1000"],
            "equilibria",
        ),
        (["--over", "clamped_length=0:90 mm"], "clamp"),
        (["--over", "E=30:40 GPa", "--dask", "tcp://nowhere:1"], "--store"),
    ],
    ("reach", "amouri2019"): [
        (["--errors", "--out", "map.nc"], ".png"),
        (["--errors", "--payload-direction", "0,0,1"], "no payloads"),
        (["--errors", "--max-tension", "40", "--poses", "0"], "--poses: got 0; must be a whole"),
        (["--models", "cc_from_force"], "add --errors"),
    ],
    ("export", "amouri2019"): [
        ((), "nothing to write: give --out FILE, --picture FILE or --drawing FILE."),
        (("--out", "robot.obj"), "--out: got robot.obj; end it in .step"),
        (("--out", "r.step", "--joints", "2"), "--joints: a solid (.step) cannot use it"),
        (("--drawing", "d.svg", "--gravity", "0,0,-9.81"), "--gravity: a solid (.step) cannot"),
        (("--out", "r.xml", "--displacement", "0,0,0"), "--displacement: rigid links (.xml)"),
        (("--out", "r.json", "--tension", "1,0,0"), "--tension: plain numbers (.json) cannot"),
        (("--out", "r.json", "--picture", "p.png"), "--picture: plain numbers (.json) cannot"),
        (("--out", "none/robot.step"), "none does not exist"),
        (("--out", "mine"), "--out: got mine; end it in"),
        (("--picture", "robot.jpg"), "--picture: cannot write the picture to robot.jpg: its name"),
        (("--drawing", "none/disk.svg"), "--drawing: cannot write the drawing to none/disk.svg"),
        (("--picture", "a.png", "--drawing", "a.png"), "--out, --picture and --drawing name"),
        (
            ("--out", "r.step", "--set", "segments.0.disks.thickness=0 mm"),
            "segments[0].disks.thickness is 0 mm, which makes no solid",
        ),
        (
            ("--out", "r.step", "--set", "segments.0.disks.hole_diameter=7 mm"),
            "segments[0].disks.hole_diameter: got 7 mm; the disk does not hold such holes",
        ),
        (
            ("--out", "r.step", "--set", "segments.0.tendons.diameter=10 mm"),
            "do not hold holes for a tendon of 10 mm",
        ),
    ],
}


@pytest.mark.parametrize(
    ("command", "arguments", "says"),
    [(command, more, says) for command, rows in FLAGS.items() for more, says in rows],
)
def test_flags(
    shell: Shell,
    here: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: tuple[str, ...],
    arguments: Sequence[str],
    says: str | tuple[str, ...],
) -> None:
    def worked(*_: object, **__: object) -> None:
        pytest.fail("the work has begun")

    if command == SIMULATE:
        monkeypatch.setattr(simulation, "simulate", worked)
    (here / "e").mkdir()
    refuses(shell, here, says, *command, *arguments)


HEADER = "t_s,tension_1_N,tension_2_N,tension_3_N\n"
TURN = "t_s,rotation_x_deg,rotation_y_deg,rotation_z_deg\n"
REST = (*SIMULATE, "--from", "40,0,0", "--tension", "40,0,0", "--rise", "0", "--hold", "0.2")


def zeros(header: str) -> str:
    """Two rows of zeros at 0 and 1 s."""
    row = ",0" * header.count(",")
    return f"{header}\n0{row}\n1{row}\n"


#: By command, which ends with the flag of the file: its text, and words of the message.
FILES: dict[tuple[str, ...], list[tuple[str, str]]] = {
    (*SIMULATE, "--table"): [
        ("", "the file is empty; write the header t_s,tension_1_N,tension_2_N,tension_3_N"),
        (HEADER, "no row of numbers"),
        (HEADER.replace("t_s,", "") + "0,0,0\n", "line 1: there is no column t_s"),
        (HEADER.replace(",tension_3_N", "") + "0,0,0\n", "no column tension_3_N"),
        (HEADER.replace("3_N", "4_N") + "0,0,0,0\n", "got tension_4_N; the robot has 3 tendons"),
        (HEADER.replace("3_N", "2_mN") + "0,0,0,0\n", "tension_2_mN is there twice"),
        (HEADER.replace("3_N", "3_kg") + "0,0,0,0\n", 'line 1: got tension_3_kg, but "kg"'),
        (HEADER.replace("t_s", "time") + "0,0,0,0\n", '"time" is no column of a table'),
        (
            HEADER.replace("tension_1_N", f"tension_1_{'a' * 5000}N") + "0,0,0,0\n",
            "is no column of a table",
        ),
        (HEADER.replace(",", ";") + "0;0;0;0\n", "line 1: columns are separated by commas"),
        (HEADER + "0,0,0,0\n1,2,3\n", "line 3: it has 3 cells, the header has 4"),
        (HEADER + "0,0,0,0\n1,2,x,0\n", 'line 3: got "x" for tension_2_N'),
        (HEADER + "0,0,0,0\n1,2,,0\n", "line 3: got nothing for tension_2_N"),
        (HEADER + "0,0,0,0\n1,nan,0,0\n", 'line 3: got "nan" for tension_1_N'),
        (HEADER + "0,0,0,0\n1,0,-3,0\n", "line 3: the tension of tendon 2 is -3 N"),
        (HEADER + "0,0,0,0\n2,0,0,0\n\n1,0,0,0\n", "line 5: the time is 1 s after 2 s"),
        (HEADER + "0,0,0,0\n" + "1,0,0,0\n" * 3, "line 5: the time 1 s is there three times"),
        (
            HEADER + "0,0,0,0\n1,0,0,0\n1.0000000000000002,1,0,0\n",
            "line 4: the time 1 s is 2.2e-16 s after",
        ),
        (HEADER + "-1,0,0,0\n1,0,0,0\n", "line 2: the first time is -1 s"),
        (HEADER + "0,0,0,0\n", "the last time is 0 s"),
        (HEADER + "0,0,0,0\n99999,0,0,0\n", "it takes 99999 s"),
        (HEADER + "0,0,0,0\n1e-9,0,0,0\n", "it takes 1e-09 s; 1e-06 s is the shortest"),
        (HEADER + '0,0,0,"0\n', "unexpected end of data"),
        ("\x00\x01", "bad.csv"),
    ],
    (*REST, "--base-motion"): [
        ("", "the file is empty; write the header t_s,position_x_mm"),
        (TURN, "a motion needs poses at two times or more"),
        (TURN + "0,0,0,0\n", "a motion needs poses at two times or more"),
        ("t_s\n0\n1\n", "line 1: there is no position and no rotation"),
        (TURN.replace("t_s", "time"), '"time" is no column of poses'),
        (TURN.replace("t_s,", ""), "there is no column t_s"),
        (TURN.replace(",rotation_z_deg", ""), "no column rotation_z_deg; give x, y and z, or none"),
        (TURN.replace("z_deg", "x_rad"), "rotation_x_rad is there twice, as rotation_x_deg"),
        (TURN.replace("z_deg", "z_mm"), 'got rotation_z_mm, but "mm" is not a unit of angle'),
        (TURN.replace(",", ";"), "columns are separated by commas"),
        (TURN + "0,0,0\n", "line 2: it has 3 cells, the header has 4"),
        (TURN + "0,0,0,x\n", 'line 2: got "x" for rotation_z_deg'),
        (TURN + "0,0,0,nan\n", 'line 2: got "nan" for rotation_z_deg'),
        (TURN + "1,0,0,0\n", "line 2: the first time is 1 s; a run begins at 0"),
        (TURN + "0,0,0,0\n\n0,0,0,0\n", "line 4: the time is 0 s after 0 s; times must increase"),
        (TURN + "0,0,0,0\n1,175,0,0\n", "the base turns by 3.05 rad from 0 to 1 s"),
        (TURN + "0,0,0,0\n0.1,0,0,0\n", "ends at 0.1 s and the run lasts 0.2 s"),
    ],
    ("ik", "rao2021", "--out", "c.csv", "--path"): [
        ("tip_x_mm,tip_y_mm,tip_z_mm\n1,2,nan\n", "line 2: tip_z_mm is"),
        ("tip_x_mm,tip_y_mm,tip_z_mm\n1,2,300\n\n1,,300\n", "line 4: tip_y_mm is nothing"),
        ("tip_x_mm,tip_y_mm,tip_z_mm\n1,2\n", "line 2: tip_z_mm is nothing"),
        ("tip_x_mm,tip_y_mm,tip_z_mm\n", "no rows"),
        ("x,y,z\n1,2,3\n", "must include tip_x_mm"),
        ("", "empty"),
        ("tip_x_mm,tip_y_mm,tip_z_mm\n\n1,2," + 131073 * "3" + "\n", "line 3: the table cannot"),
        (131073 * "x" + "\n", "line 1: the table cannot be read"),
        ("tip_x_m,tip_y_m,tip_z_m\n10,20,350\n", "out of any reach"),
        ("tip_x_m,tip_y_m,tip_z_m\n0,0,1e155\n0,0,0.3\n", "row 1 of position is 1e+155 m from"),
        (
            "tip_x_mm,tip_y_mm,tip_z_mm\n0.05,0,0.38\n0.06,0,0.37\n",
            "no point is farther than 0.3833 mm from the base, and rao2021 is 400 mm long; if the "
            "numbers are in m, name the columns tip_x_m, tip_y_m and tip_z_m.",
        ),
        ("tip_x_m,tip_y_m,tip_z_m,direction_x\n0,0,0.3,1\n", "none direction_y"),
    ],
}
#: Headers of a table of a motion, and words of the message.
COLUMNS = [
    (
        "t_s,tension_1_N,displacement_1_m,tension_2_N,tension_3_N",
        "tendon 1 has tension_1_N and displacement_1",
    ),
    (
        "t_s,displacement_1_m,displacement_1_mm,tension_2_N,tension_3_N",
        "displacement_1_mm is there twice, as displacement_1_m",
    ),
    (
        "t_s,displacement_1_N,tension_2_N,tension_3_N,tension_4_N",
        'got displacement_1_N, but "N" is not a unit',
    ),
    (
        "t_s,displacement_1_m,tension_2_N,tension_3_N,tension_4_N",
        "got tension_4_N; the robot has 3",
    ),
    (
        "t_s,displacement_1_m,tension_2_N",
        "there is no column tension_3_N; write the header t_s",
    ),
]


@pytest.mark.parametrize(
    ("command", "text", "says"),
    [(command, *row) for command, rows in FILES.items() for row in rows]
    + [((*SIMULATE, "--table"), zeros(header), says) for header, says in COLUMNS],
)
def test_files(shell: Shell, here: Path, command: tuple[str, ...], text: str, says: str) -> None:
    Path("bad.csv").write_text(text)
    said = shell.error(*command, "bad.csv")
    assert said.startswith(f"{command[-1]}: ") and says in said
    assert list(here.iterdir()) == [here / "bad.csv"]
