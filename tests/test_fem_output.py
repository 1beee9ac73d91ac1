"""Output of CalculiX, including partial output."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bowstring.fem.output import read_dat, read_increments, reason

DAT = """
 displacements (vx,vy,vz) for set BODY and time  0.1000000E+01

         1  1.000000E+00 -2.000000E+00  3.000000E-01
         2  0.000000E+00  0.000000E+00  0.000000E+00

 stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz) for set FREE1 and time  0.1000000E+01

         5   1 -1.000000E+00  2.000000E+00  3.000000E+00  4.000000E+00  5.000000E+00  6.000000E+00

 displacements (vx,vy,vz) for set BODY and time  0.2000000E+01

         1  1.500000E+00 -2.500000E+00  3.500000E-01
"""

STA = """SUMMARY OF JOB INFORMATION
  STEP      INC     ATT  ITRS     TOT TIME     STEP TIME      INC TIME
     1          1     1     5  0.500000E+00  0.500000E+00  0.500000E+00
     1          2     1U    8  0.100000E+01  0.100000E+01  0.500000E+00
     1          2     2     4  0.625000E+00  0.625000E+00  0.125000E+00
     2          1     1     3  0.11000"""


def test_tables_are_read_whole(tmp_path: Path) -> None:
    file = tmp_path / "robot.dat"
    file.write_text(DAT)
    first, stress, last = read_dat(file)
    assert (first.kind, first.set, first.time) == ("displacements", "BODY", 1.0)
    np.testing.assert_array_equal(first.rows, [[1, 1, -2, 0.3], [2, 0, 0, 0]])
    assert stress.rows.shape == (1, 8) and stress.rows[0, 7] == 6.0
    assert last.time == 2.0 and len(last.rows) == 1
    (again,) = read_dat(file, stress.end)
    np.testing.assert_array_equal(again.rows, last.rows)


def test_a_line_that_is_half_written_is_left_out(tmp_path: Path) -> None:
    file = tmp_path / "robot.dat"
    for cut in range(len(DAT)):
        file.write_text(DAT[:cut])
        for table in read_dat(file):
            assert np.isfinite(table.rows).all()
            assert table.rows.shape[1] in (0, 4, 8)
    assert read_dat(tmp_path / "none.dat") == []


def test_increments_are_those_that_converged(tmp_path: Path) -> None:
    file = tmp_path / "robot.sta"
    file.write_text(STA)
    found = read_increments(file)
    assert [(i.step, i.iterations, i.step_time) for i in found] == [(1, 5, 0.5), (1, 4, 0.625)]
    assert read_increments(tmp_path / "none.sta") == []


def test_errors_are_named() -> None:
    text = (
        " iteration 3\n *ERROR in e_c3d: nonpositive jacobian\n        determinant in element 5\n"
    )
    assert reason(text) == "in e_c3d: nonpositive jacobian determinant in element 5"
    assert reason("all is well") == ""
