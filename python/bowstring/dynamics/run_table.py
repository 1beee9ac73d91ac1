"""Table of a run as CSV, with a row for each output time."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from bowstring.files.atomic_io import check_file, write_whole_file

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["check_table", "write_table"]

_MARK: Final = b"# simulated by Bowstring"


def check_table(path: str | Path) -> Path:
    """Check before any work that a table may be written (`atomic_io.check_file`)."""
    return check_file(Path(path), "table of the run", (".csv",), _MARK)


def write_table(data: xr.Dataset, path: str | Path) -> Path:
    """Write time, tip, tensions and tendon displacements of a run as CSV.

    The columns are ``t_s``, ``tip_x_mm``, ``tip_y_mm``, ``tip_z_mm``, and for each tendon
    ``tension_1_N`` and ``displacement_1_mm``. A line above them, which begins with ``#``, has the
    robot and how the run ended.

    Parameters
    ----------
    data : xarray.Dataset
        Of `Run.to_dataset` or `bowstring.dynamics.run_file.read_run`.
    path : str or Path
        Ends in ``.csv``. It is written whole or not at all; a former table of a run is replaced, no
        other file.

    Returns
    -------
    Path
        The file, absolute.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    file = check_table(path)
    time, tip = data["time"].to_numpy(), data["disk_position"].to_numpy()[:, -1]
    tension = data["tension"].to_numpy()
    displacement = data["tendon_displacement"].to_numpy()
    each = range(1, tension.shape[1] + 1)
    header = ["t_s", "tip_x_mm", "tip_y_mm", "tip_z_mm"]
    header += [f"tension_{i}_N" for i in each] + [f"displacement_{i}_mm" for i in each]
    rows = np.column_stack([time, 1e3 * tip, tension, 1e3 * displacement]) + 0.0  # no -0
    about = f"{data.attrs['robot']}, {data.attrs['status']} at {time[-1]:.6g} s"

    def fill(new: Path) -> None:
        with new.open("w", newline="", encoding="utf-8") as stream:
            version = data.attrs["bowstring_version"]
            stream.write(f"{_MARK.decode()} {version}: {' '.join(about.split())}\n")
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(header)
            writer.writerows([f"{value:.9g}" for value in row] for row in rows.tolist())

    write_whole_file(file, "table of the run", fill, lambda: check_table(file))
    return file
