"""The study on disk: report.html, figures, CSV tables, study.json.

A folder is written beside its place under a hidden name and moved in whole when it is complete, so
a reader finds the old study or the new one, never a mixture. A folder that this module did not
write is never touched.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from typing_extensions import NotRequired

from bowstring.aliases import Progress
from bowstring.errors import InputError
from bowstring.files.atomic_io import file_stem, write_whole
from bowstring.files.json_files import Content, read_json, structured
from bowstring.files.result_folder import check_folder, write_listing
from bowstring.formatting import number, signed
from bowstring.robot.model import Robot
from bowstring.robot.reader import robot_names
from bowstring.study.comparison import COMPARISONS, MEANINGS
from bowstring.study.correction_code import FILES, Language, correction_code
from bowstring.study.counterparts import counterparts
from bowstring.study.equations import study_equations
from bowstring.study.error_budget import SIDES, Side
from bowstring.study.parameters import assumed, parameters
from bowstring.study.report_scene import scene_text
from bowstring.study.study import Study
from bowstring.study.summary import COLUMNS, summarise
from bowstring.study.tables import simulated, study_tables, write_csv
from bowstring.units import printable
from bowstring.viz.colours import COLOURS
from bowstring.viz.style import figure_style, save_figure, save_figures, svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bowstring.study.angle_validation import AgainstAngles
    from bowstring.study.data_validation import AgainstData

_MOST_BYTES: Final = 1_000_000_000


class _Provenance(Content):
    robot_file: NotRequired[str]


class _Former(Content):
    """Structure of what is read of a former study.json."""

    provenance: _Provenance


def default_folder(robot: Robot) -> Path:
    """Folder of a robot's study if none is asked for: ``bowstring-study/<robot name>``.

    Returns
    -------
    Path
        Relative; characters of the name that a file system may refuse become underscores.
    """
    return Path("bowstring-study") / file_stem(robot.name)


def refuse_other_robot(folder: Path, robot_file: str) -> None:
    """Refuse to replace the study of another robot file, which has the same name of robot.

    Parameters
    ----------
    folder : Path
    robot_file : str
        As for `write`. A former study without one, or of a file that is gone, may be replaced.

    Raises
    ------
    InputError
    """
    try:
        former = structured(read_json(folder / "study.json", _MOST_BYTES), _Former)
    except (OSError, ValueError):  # no study
        return
    held = former["provenance"].get("robot_file", robot_file)
    if held != robot_file and (held in robot_names() or Path(held).exists()):
        raise InputError(
            f"cannot write the study to {folder}: it holds that of another robot with this name, "
            f"{held}; name another folder"
        )


def write(
    study: Study,
    out: str | Path | None = None,
    *,
    formats: Sequence[str] = (),
    correction: Language | None = None,
    robot_file: str | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write the report of a study.

    Parameters
    ----------
    study : Study
    out : str or Path, optional
        Folder; a former study in it is replaced whole, after success. `default_folder` if not
        given.
    formats : sequence of str
        Formats of figures beside those in the page: ``"pdf"``, ``"png"``, ``"svg"``.
    correction : {"python", "c", "matlab"}, optional
        Language in which the corrected constant curvature is written too
        (`bowstring.study.correction_code`).
    robot_file : str, optional
        Path of the robot's file, or name of a built-in robot, for the provenance in study.json.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    Path
        The folder, absolute: report.html, study.json, ``tables/`` (CSV), ``figures/`` on request.

    Raises
    ------
    InputError
        If the folder may not be written (see `check_folder`), or the robot has no correction.
    """
    code = "" if correction is None else correction_code(study, correction)
    notify = progress or (lambda what, share: None)
    folder = check_folder(default_folder(study.robot) if out is None else out)

    def fill(new: Path) -> None:
        if correction is not None:
            (new / FILES[correction]).write_text(code, encoding="utf-8")
        _fill(study, new, formats, robot_file, notify)  # lists the files last

    write_whole(
        folder,
        "study",
        fill,
        lambda: check_folder(folder),
    )
    notify("done", 1.0)
    return folder


def _fill(
    study: Study, folder: Path, formats: Sequence[str], robot_file: str | None, notify: Progress
) -> None:
    from bowstring.study.figures import draw

    tables = folder / "tables"
    tables.mkdir()
    for name, header, rows in study_tables(study):
        write_csv(tables / f"{name}.csv", header, rows)

    figures = folder / "figures"
    if formats:
        figures.mkdir()
    passed_on = folder.with_name("passed")
    passed_on.mkdir()
    with figure_style():

        def save(stem: str, figure: Figure) -> None:
            Path(passed_on, stem).write_text(svg(stem, figure), encoding="utf-8")
            save_figure(figure, figures / stem, [f".{each}" for each in formats])

        made = save_figures(draw(study), save, lambda share: notify("figures", share))
        drawn = {stem: Path(passed_on, stem).read_text(encoding="utf-8") for stem in made}

    notify("report", 0.95)
    content = study.to_dict()
    if robot_file is not None:
        content["provenance"]["robot_file"] = robot_file
    content["figures"] = [f.to_dict() for f in study.figures if f.stem in drawn]
    (folder / "report.html").write_text(_html(study, content, drawn), encoding="utf-8")
    write_listing(folder / "study.json", content)


def written_figures(folder: Path) -> list[dict[str, Any]]:
    """Figures in a study's folder: those that could be drawn."""
    found: list[dict[str, Any]] = json.loads((folder / "study.json").read_text("utf-8"))["figures"]
    return found


def _plain_text(value: Any) -> Any:
    """Value as text of the page, without control characters, which HTML cannot have."""
    from markupsafe import Markup

    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _html(study: Study, content: Mapping[str, Any], drawn: dict[str, str]) -> str:
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=PackageLoader("bowstring.study"),
        autoescape=True,
        finalize=_plain_text,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    script = files("bowstring.study") / "templates" / "scene.js"
    environment.filters["number"] = number
    environment.filters["signed"] = signed

    told = {*study.shapes.text, *study.budget.actuation.text}  # in sections of their own
    page = environment.get_template("report.html.j2").render(
        study=study,
        content=content,
        comparisons=[
            (COMPARISONS[c.name], c.to_dict()) for c in simulated(study) if c.name in COMPARISONS
        ],
        shapes=[
            (f"CC {m.label}" if m.name in COMPARISONS else m.label, m.to_dict())
            for m in study.shapes.models
        ],
        data=None if study.data is None else _data_page(study.data),
        angles=None if study.angles is None else _angle_page(study.angles),
        sweep=_sweep_rows(study),
        budget=[_budget_page(study, side, title) for side, title in SIDES.items()],
        # drawn by this program, ids and text escaped by matplotlib
        figures=[(f, Markup(drawn[f.stem])) for f in study.figures if f.stem in drawn],
        scene=Markup(scene_text(study)),  # JSON without "<"
        scene_script=Markup(script.read_text(encoding="utf-8")),
        counterparts=counterparts(study),
        equations=study_equations(study),
        mathml=Markup,  # of this program, numbers and symbols only
        parameters=parameters(study.robot),
        assumed=assumed(study),
        summary=summarise(study),
        verdict=[s for s in study.verdict.text if s not in told],
        columns=COLUMNS,
        tables=[name for name, _, _ in study_tables(study)],
        colours=COLOURS,
        provenance=content["provenance"],
    )
    return page + "\n"


def _budget_page(study: Study, side: Side, title: str) -> dict[str, Any]:
    """One table of the error budget; contributions to the baseline are in budget.csv alone."""
    budget = study.budget
    of_sweep = side == "in_sweep"
    where, base = ("The sweep", budget.sweep) if of_sweep else ("The full model", budget.full_model)
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
    """Values of the page for the verdict on data."""
    from bowstring.study.data_validation import FRAMES

    return {
        "label": found.title,
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


def _angle_page(found: AgainstAngles) -> dict[str, Any]:
    """Values of the page for the comparison with measured angles."""
    from bowstring.study.angle_validation import FRAMES

    return {
        "label": found.title,
        "errors": [(found.labels[c.name], FRAMES[c.frame], c.to_dict()) for c in found.comparisons],
        **found.to_dict(),
    }


def _sweep_rows(study: Study) -> list[dict[str, Any]]:
    s = study.statics
    columns = {
        "tension": s.tension,
        "status": s.status,
        "tip": s.tip_position * 1e3,
        "displacement": s.displacement * 1e3,
        "linear_displacement": s.linear_displacement * 1e3,
        "from_lengths": study.comparison("cc_from_lengths").error * 1e3,
        "from_force": study.comparison("cc_from_force").error * 1e3,
    }
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
