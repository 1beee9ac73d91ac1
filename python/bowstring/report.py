"""The study on disk: report.html, figures, CSV tables, study.json; modes; fits.

A folder is written beside its place under a hidden name and moved in whole when it is complete, so
a reader finds the old study or the new one, never a mixture. A folder that this module did not
write is never touched.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bowstring.budget import Side
from bowstring.comparison import COMPARISONS, MEANINGS
from bowstring.errors import InputError
from bowstring.files import check_place, check_replaceable, resolved, write_whole
from bowstring.processes import for_each
from bowstring.robot import Robot
from bowstring.study import Study
from bowstring.study_tables import simulated, study_tables, write_csv
from bowstring.style import figure_style, svg
from bowstring.units import printable
from bowstring.words import number, signed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bowstring.against_data import AgainstData
    from bowstring.calibration import Calibration
    from bowstring.oscillations import Modes

__all__ = ["check_folder", "default_folder", "write", "write_fit", "write_modes"]

Progress = Callable[[str, float], None]

_DPI: Final = 160
_BUDGET_TABLES: Final[dict[Side, tuple[str, str]]] = {
    "in_sweep": ("Each effect alone in this sweep", "The sweep"),
    "removed": ("Each effect alone in the full model", "The full model"),
}
"""Tables of the error budget on the page; study.json and budget.csv also have the baseline."""
_CALLED: Final = {"fe": "finite elements"}  # what is not called as its file


# -- where it goes -----------------------------------------------------------------------------


def default_folder(robot: Robot) -> Path:
    """Folder of a robot's study if none is asked for: ``bowstring-study/<robot name>``.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    Path
        Relative; characters of the name that a file system may refuse become underscores.
    """
    name = re.sub(r"[^\w.-]+", "_", robot.name).strip("._") or "robot"
    return Path("bowstring-study") / name


def check_folder(out: str | Path, what: str = "study") -> Path:
    """Say before any work whether a study may be written to a folder.

    Parameters
    ----------
    out : str or Path
        The folder; it need not exist.
    what : str
        ``"study"``, ``"modes"``, ``"fit"`` or ``"fe"``; its JSON file lists the files that may be
        replaced.

    Returns
    -------
    Path
        The same folder, absolute, links resolved.

    Raises
    ------
    InputError
        If there is something in its place that is not a study of this program, or holds files that
        the study did not write, or if it cannot be written.
    """
    called = _CALLED.get(what, what)
    folder = resolved(out, f"cannot write the {called} to {out}")
    why = f"cannot write the {called} to {folder}"
    check_place(folder, why)
    try:
        if not folder.exists():
            return folder
        if not folder.is_dir():
            raise InputError(f"{why}: it is a file; name a folder")
        present = _files_in(folder)
        if next(present, None) is None:
            check_replaceable(folder, why)
            return folder
        listed = _listed(folder / f"{what}.json")
        if listed is None:  # before all files are looked at, which may be those of a whole drive
            raise InputError(
                f"{why}: it holds files but no {called} of Bowstring, and nothing of yours is "
                "replaced; name a new or an empty folder"
            )
        cannot = f"cannot replace the {called} in {folder}"
        for file in sorted(_files_in(folder)):
            if file not in listed:
                raise InputError(
                    f"{cannot}: it also holds {file}, which Bowstring did not write; move that "
                    "away or name another folder"
                )
            digest = listed[file]
            if digest is not None and _sha256(folder / file) != digest:
                raise InputError(
                    f"{cannot}: {file} was changed since Bowstring wrote it; move that away or "
                    "name another folder"
                )
    except OSError as error:
        raise InputError(f"{why}: {error.strerror}") from None
    check_replaceable(folder, why)
    return folder


def _files_in(folder: Path) -> Iterator[str]:
    """Paths of all that is no folder, relative; a folder that is not readable is an `OSError`."""

    def give_up(error: OSError) -> None:
        raise error

    for place, folders, files in os.walk(folder, onerror=give_up):
        links = [name for name in folders if os.path.islink(os.path.join(place, name))]
        for name in (*files, *links):
            yield Path(place, name).relative_to(folder).as_posix()


def _listed(file: Path) -> dict[str, str | None] | None:
    """The files that a folder's JSON file lists, with their SHA-256 where it has that."""
    try:
        former = json.loads(file.read_text(encoding="utf-8"))
        hashes = former.get("sha256", {})
        return {str(name): hashes.get(name) for name in former["files"]}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def _sha256(file: Path) -> str:
    if file.is_symlink() or not file.is_file():
        return "not a file"
    digest = hashlib.sha256()
    with file.open("rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def write_listing(file: Path, content: dict[str, Any]) -> None:
    """Write the JSON file of a folder: its content, and a list of all files for `check_folder`."""
    written = sorted(_files_in(file.parent))
    hashes = {name: _sha256(file.parent / name) for name in written}
    files = sorted([*written, file.name])
    write_json(file, {**content, "files": files, "sha256": hashes})


def write(study: Study, out: str | Path | None = None, *, progress: Progress | None = None) -> Path:
    """Write the report of a study.

    Parameters
    ----------
    study : Study
    out : str or Path, optional
        Folder; a former study in it is replaced whole, after success. `default_folder` if not
        given.
    progress : callable, optional
        Is told what is being done and the share that is done, from 0 to 1.

    Returns
    -------
    Path
        The folder, absolute: report.html, study.json, ``figures/`` (PNG, PDF), ``tables/`` (CSV).

    Raises
    ------
    InputError
        If the folder may not be written (see `check_folder`).
    """
    tell = progress or (lambda what, share: None)
    folder = check_folder(default_folder(study.robot) if out is None else out)
    write_whole(folder, "study", lambda new: _fill(study, new, tell), lambda: check_folder(folder))
    tell("done", 1.0)
    return folder


def write_modes(
    modes: Modes, content: dict[str, Any], out: str | Path, *, progress: Progress | None = None
) -> Path:
    """Write pictures of mode shapes.

    Parameters
    ----------
    modes : Modes
    content : dict
        Plain values for ``modes.json``, as ``bowstring modes --json`` prints.
    out : str or Path
        Folder; former modes in it are replaced whole, after success.
    progress : callable, optional
        Is told what is being done and the share that is done, from 0 to 1.

    Returns
    -------
    Path
        The folder, absolute: modes.json and each mode as PNG, PDF and SVG.

    Raises
    ------
    InputError
        If the folder may not be written (see `check_folder`).
    """
    from bowstring import plots

    tell = progress or (lambda what, share: None)
    folder = check_folder(out, "modes")

    def fill(new: Path) -> None:
        def save(drawing: tuple[str, Figure]) -> None:
            stem, figure = drawing
            save_figure(figure, new / stem)
            figure.savefig(new / f"{stem}.svg", metadata={"Date": None, "Creator": "Bowstring"})

        with figure_style():
            made = list(plots.draw_modes(modes))
            for_each(made, save, tell=lambda share: tell("pictures", share))
        write_listing(new / "modes.json", content)

    write_whole(folder, "modes", fill, lambda: check_folder(folder, "modes"))
    tell("done", 1.0)
    return folder


def write_fit(
    calibration: Calibration,
    content: dict[str, Any],
    out: str | Path,
    *,
    progress: Progress | None = None,
) -> Path:
    """Write a calibration: the robot with its calibrated numbers, all numbers, two figures.

    Parameters
    ----------
    calibration : Calibration
    content : dict
        Plain values for ``fit.json``, as ``bowstring fit --json`` prints.
    out : str or Path
        Folder; a former fit in it is replaced whole, after success.
    progress : callable, optional
        Is told what is being done and the share that is done, from 0 to 1.

    Returns
    -------
    Path
        The folder, absolute: robot.yaml, calibration.json with what a robot file has no place for,
        fit.json, and residuals and parity as PNG and PDF.

    Raises
    ------
    InputError
        If the folder may not be written (see `check_folder`).
    """
    from bowstring import plots
    from bowstring.calibration import BESIDE
    from bowstring.robotfile import to_yaml

    tell = progress or (lambda what, share: None)
    folder = check_folder(out, "fit")
    found, data = calibration.fit, calibration.data
    hashed = "" if data.sha256 is None else f", SHA-256 {data.sha256}"
    lines = [
        f"Calibrated by Bowstring ({found.model}) on {data.source} data: {data.name}{hashed}",
        found.message,
        *[f"Not part of a robot file: {each}" for each in calibration.elsewhere],
        *([f"{BESIDE} has these for bowstring fit --start"] if calibration.elsewhere else []),
    ]

    def fill(new: Path) -> None:
        robot = to_yaml(found.robot, "\n".join(" ".join(line.split()) for line in lines))
        (new / "robot.yaml").write_text(robot, encoding="utf-8")
        write_json(new / BESIDE, calibration.beside_to_dict())
        with figure_style():
            save_figures(plots.draw_fit(calibration), new, lambda share: tell("figures", share))
        write_listing(new / "fit.json", content)

    write_whole(folder, "fit", fill, lambda: check_folder(folder, "fit"))
    tell("done", 1.0)
    return folder


def _fill(study: Study, folder: Path, tell: Progress) -> None:
    from bowstring import plots

    tables = folder / "tables"
    tables.mkdir()
    for name, header, rows in study_tables(study):
        write_csv(tables / f"{name}.csv", header, rows)

    figures = folder / "figures"
    figures.mkdir()
    passed_on = folder.with_name("passed")
    passed_on.mkdir()
    with figure_style():

        def save(drawing: tuple[str, Figure]) -> None:
            stem, figure = drawing
            save_figure(figure, figures / stem)
            Path(passed_on, stem).write_text(svg(stem, figure), encoding="utf-8")

        made = list(plots.draw(study))
        for_each(made, save, tell=lambda share: tell("figures", share))
        drawn = {stem: Path(passed_on, stem).read_text(encoding="utf-8") for stem, _ in made}

    tell("report", 0.95)
    content = study.to_dict()
    (folder / "report.html").write_text(_html(study, content, drawn), encoding="utf-8")
    write_listing(folder / "study.json", content)


def save_figures(
    drawings: Iterable[tuple[str, Figure]], folder: Path, tell: Callable[[float], None]
) -> None:
    """Each as PNG and PDF under its stem."""
    for_each(list(drawings), lambda each: save_figure(each[1], folder / each[0]), tell=tell)


def save_figure(figure: Figure, path: Path) -> None:
    """As PNG and PDF; `path` has no ending."""
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")  # laid out once, not in each file format again
    figure.savefig(f"{path}.png", dpi=_DPI)
    with _glyphs_alone():
        figure.savefig(f"{path}.pdf", metadata={"CreationDate": None, "Creator": "Bowstring"})


@contextlib.contextmanager
def _glyphs_alone() -> Iterator[None]:
    """Fonts in a PDF without the tables that lay out text: a PDF numbers and places glyphs itself.

    To cut them down takes matplotlib three quarters of the time of a font, 0.1 s.
    """
    from fontTools.subset import Options

    name = "_drop_tables_default"  # one without it keeps the tables
    former = getattr(Options, name, [])
    setattr(Options, name, [*former, "GDEF", "GPOS", "GSUB", "MATH", "kern"])
    try:
        yield
    finally:
        setattr(Options, name, former)


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Plain values, as people can read them; NaN is an error."""
    text = json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)
    # JSON escapes control characters but those from DEL on, and no lone surrogates
    text = re.sub("[\x7f-\x9f\ud800-\udfff]", lambda found: f"\\u{ord(found[0]):04x}", text)
    path.write_text(text + "\n", encoding="utf-8")


def _plain_text(value: Any) -> Any:
    """What the page shows of a value: HTML has no control characters."""
    from markupsafe import Markup

    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _html(study: Study, content: dict[str, Any], drawn: dict[str, str]) -> str:
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=PackageLoader("bowstring"),
        autoescape=True,
        finalize=_plain_text,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = number
    environment.filters["signed"] = signed
    from bowstring.colours import COLOURS

    page = environment.get_template("report.html.j2").render(
        study=study,
        content=content,
        comparisons=[(COMPARISONS[c.name], c.to_dict()) for c in simulated(study)],
        data=None if study.data is None else _data_page(study.data),
        sweep=_sweep_rows(study),
        budget=[_budget_page(study, side, *words) for side, words in _BUDGET_TABLES.items()],
        # drawn by this program, ids and text escaped by matplotlib
        figures=[(f, Markup(drawn[f.stem])) for f in study.figures],
        tables=[name for name, _, _ in study_tables(study)],
        colours=COLOURS,
        provenance=content["provenance"],
    )
    return page + "\n"


def _budget_page(study: Study, side: Side, title: str, where: str) -> dict[str, Any]:
    """One table of the error budget: each effect beside the same physics."""
    budget = study.budget
    base = budget.sweep if side == "in_sweep" else budget.fullest
    rows = []
    for row in budget.rows:
        present, absent = budget.cases(row, side)
        rows.append(
            {
                "label": row.label,
                "contributions": [budget.contribution(row, side, m) for m in MEANINGS],
                "problems": budget.problems(row, side),
                "moved": present.moved_from(absent)["tip_moved_mean_mm"],
            }
        )
    means = [(base.comparisons[m].mean * 1e3, base.comparisons[m].n) for m in MEANINGS]
    return {"title": title, "where": where, "base": means, "rows": rows}


def _data_page(found: AgainstData) -> dict[str, Any]:
    """What the page shows of the verdict on data."""
    from bowstring.against_data import FRAMES

    label = found.label[0].upper() + found.label[1:]
    return {
        "label": label,
        "models": [
            (
                found.labels[name],
                [
                    (FRAMES[c.frame], c.to_dict())
                    for kind in FRAMES
                    for c in found.comparisons
                    if (c.name, c.frame) == (name, kind)
                ],
            )
            for name in found.models
        ],
        **found.to_dict(),
    }


def _sweep_rows(study: Study) -> list[dict[str, Any]]:
    s = study.statics
    lengths, force = study.comparison("cc_from_lengths"), study.comparison("cc_from_force")
    return [
        {
            "tension": float(s.tension[i]),
            "status": s.status[i],
            "tip": (s.tip_position[i] * 1e3).tolist(),
            "pull": float(s.pull[i]) * 1e3,
            "linear_pull": float(s.linear_pull[i]) * 1e3,
            "from_lengths": float(lengths.error[i]) * 1e3,
            "from_force": float(force.error[i]) * 1e3,
        }
        for i in range(len(s.tension))
    ]
