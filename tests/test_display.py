"""Representations of objects and functions: reprs, notebooks, signatures, dir."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import itertools
import pkgutil
import re
import textwrap
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np
import pytest

import bowstring as bs
from bowstring.data import datasets, registration, synthetic
from bowstring.dynamics.load_history import ramp, step
from bowstring.study.study import Study

ROOT = Path(__file__).parents[1]
SVG: Final = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def objects(rao: bs.Robot, paper: Study) -> dict[str, Any]:
    """Results of the public functions."""
    solution = bs.solve(rao, [1, 0, 0, 0, 0, 0])
    loads = np.outer(np.linspace(0, 1, 200), [1, 0, 0, 0, 0, 0])
    return {
        "robot": rao,
        "solution": solution,
        "sweep": bs.sweep(rao, loads),
        "run": bs.simulate(rao, ramp([0.1, 0, 0, 0, 0, 0], rise=0.01), duration=0.01),
        "modes": bs.modes(rao),
        "study": paper,
        "data": bs.read_measurements(ROOT / "examples" / "bench.csv"),
        "jacobians": bs.jacobians(solution),
        "arcs": bs.constant_curvature.RobotArcs.from_lengths(rao, solution.tendon_lengths),
        "tendons": rao.tendons,
        "disks": rao.disks,
        **{f"study.{name}": value for name, value in vars(paper).items()},
        **{f"study.{c.name}": c for c in paper.comparisons},
    }


def test_reprs_are_short(objects: dict[str, Any]) -> None:
    for name, value in objects.items():
        if not isinstance(value, tuple):
            assert len(repr(value)) <= 800 and "\n" not in repr(value), name


def test_reprs_name_the_object(objects: dict[str, Any]) -> None:
    assert repr(objects["robot"]) == "<Robot rao2021: 400 mm, 2 segments, 20 disks, 6 tendons>"
    assert repr(objects["study"]) == "<Study of amouri2019 to 80 N: 11 comparisons>"
    assert repr(objects["data"]).startswith("Measurements(source='synthetic', name='bench', ten")
    assert "tensions=array (33, 3)" in repr(objects["data"])


class _Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: set[str] = set()

    def handle_starttag(self, tag: str, attributes: object) -> None:
        self.open.append(tag)
        self.seen.add(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.mark.parametrize("name", ["robot", "solution", "sweep", "run", "modes", "study"])
def test_notebooks_get_a_small_table(name: str, objects: dict[str, Any]) -> None:
    text = objects[name]._repr_html_()
    tags = _Tags()
    tags.feed(text)
    table = {"table", "caption", "thead", "tbody", "tr", "th", "td"}
    assert not tags.open and tags.seen <= table | {"svg", "title", "g", "path"}
    assert len(text) < 15_000 and len(text[text.find("<table>") :]) < 3000


def test_tables_have_the_numbers(objects: dict[str, Any]) -> None:
    x, y, z = 1e3 * objects["solution"].tip.position
    assert f"{x:.3f}, {y:.3f}, {z:.3f} mm" in objects["solution"]._repr_html_()
    assert objects["sweep"]._repr_html_().count("<tr>") == 11  # of 200 rows
    assert "cc_from_force" in objects["study"]._repr_html_()
    failed = bs.solve(bs.load_robot("amouri2019"), [1e5, 1e5, 1e5])
    assert "converged" not in failed._repr_html_() and failed.status in failed._repr_html_()


# -- functions -----------------------------------------------------------------------------------


def _public() -> Iterator[Any]:
    """Public functions, each with its name."""
    modules = [bs, *(getattr(bs, name) for name in bs.__all__), datasets, registration, synthetic]
    seen = set()
    for module in modules:
        if not isinstance(module, ModuleType):
            continue
        for name in getattr(module, "__all__", ()):
            found = getattr(module, name)
            if inspect.isfunction(found) and found not in seen:
                seen.add(found)
                yield pytest.param(found, id=f"{found.__module__}.{name}")


def _documented(function: Callable[..., Any]) -> list[str]:
    """Names under "Parameters" of a docstring."""
    text = inspect.getdoc(function) or ""
    match = re.search(r"^Parameters\n-+\n(.*?)(?=^\w[^\n]*\n-+\n|\Z)", text, re.S | re.M)
    if match is None:
        return []
    heads = re.findall(r"^(\w[\w, ]*?)(?: :.*)?$", match[1].replace("\\\n", ""), re.M)
    return [name.strip() for head in heads for name in head.split(",")]


@pytest.mark.parametrize("function", list(_public()))
def test_signatures_and_docstrings_agree(function: Callable[..., Any]) -> None:
    signature = inspect.signature(function)
    kinds = {p.kind for p in signature.parameters.values()}
    assert not kinds & {inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL}
    assert inspect.getdoc(function)
    documented = _documented(function)
    assert set(documented) <= set(signature.parameters), "documents what it does not take"
    if documented:
        assert set(documented) == set(signature.parameters), "leaves a parameter out"


#: Modules whose functions are for fields of files and flags of commands, not for people.
_INNER = re.compile(r"bowstring\.(units|__main__|_core|cli\.(?!schemas)\w+)")


def _modules() -> Iterator[ModuleType]:
    for found in pkgutil.walk_packages(bs.__path__, "bowstring."):
        if not _INNER.fullmatch(found.name):
            yield importlib.import_module(found.name)


def _members(owner: type) -> Iterator[tuple[str, Any]]:
    """Public methods and properties that a class itself defines."""
    for name, member in vars(owner).items():
        function = getattr(member, "fget", getattr(member, "__func__", member))
        if not name.startswith("_") and inspect.isfunction(function):
            yield name, function


def _undocumented_fields(owner: type) -> Iterator[str]:
    """Public fields of a dataclass with neither a text below them nor a line in its docstring."""
    if not dataclasses.is_dataclass(owner):
        return
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
    assert isinstance(tree, ast.ClassDef)
    below = {
        line.target.id
        for line, text in itertools.pairwise(tree.body)
        if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    }
    own = [line.target for line in tree.body if isinstance(line, ast.AnnAssign)]
    for target in own:
        assert isinstance(target, ast.Name)
        named = re.search(rf"(^|[\s,`]){target.id}\b", inspect.getdoc(owner) or "")
        if not target.id.startswith("_") and target.id not in below and not named:
            yield target.id


@pytest.mark.parametrize("module", list(_modules()), ids=lambda module: module.__name__)
def test_public_names_are_documented(module: ModuleType) -> None:
    missing = []
    for name, found in vars(module).items():
        if name.startswith("_") or getattr(found, "__module__", None) != module.__name__:
            continue
        if (inspect.isfunction(found) or inspect.isclass(found)) and not inspect.getdoc(found):
            missing.append(name)
        if inspect.isclass(found):
            members = [n for n, function in _members(found) if not function.__doc__]
            missing += [f"{name}.{n}" for n in (*members, *_undocumented_fields(found))]
    assert not missing


def test_dir_has_what_is_public_and_nothing_else() -> None:
    assert dir(bs) == sorted(bs.__all__)
    for name in dir(bs):
        getattr(bs, name)


# -- pictures in a notebook -----------------------------------------------------------------------


def drawn(text: str) -> ElementTree.Element:
    """The picture of a representation, as XML."""
    return ElementTree.fromstring(text[: text.index("</svg>") + len("</svg>")])


def backbones(picture: ElementTree.Element) -> list[list[tuple[float, float]]]:
    """Points of each backbone, the widest line of its pose."""
    lines = [line for line in picture.iter(f"{SVG}path") if line.get("stroke-width") == "3"]
    numbers = (re.findall(r"-?[0-9.]+", line.attrib["d"]) for line in lines)
    return [list(zip(map(float, n[::2]), map(float, n[1::2]), strict=True)) for n in numbers]


def test_a_solution_is_drawn_as_it_is_bent() -> None:
    robot = bs.load_robot("amouri2019")
    bent = bs.solve(robot, load=bs.Load(displacements=[0.03, -0.05, -0.02]))
    assert bent.slack == (2, 3)
    picture = drawn(bent._repr_html_())
    (line,) = backbones(picture)
    (x0, y0), (x1, y1) = line[0], line[-1]
    tip = bent.raise_for_status().tip
    assert tip is not None
    aside, up = np.hypot(*tip.position[:2]), tip.position[2]
    assert (y0 - y1) / (x1 - x0) == pytest.approx(up / aside, rel=0.01)
    dashed = [line for line in picture.iter(f"{SVG}path") if line.get("stroke-dasharray")]
    assert len(dashed) == 2


def test_at_most_four_poses_are_drawn_and_failed_ones_left_out() -> None:
    robot = bs.load_robot("amouri2019")
    rows = np.outer(np.linspace(0.0, 60.0, 30), [1.0, 0.0, 0.0])
    found = bs.sweep(robot, rows)
    assert len(backbones(drawn(found._repr_html_()))) == 4
    run = bs.simulate(robot, step([20.0, 0.0, 0.0]), 0.05)
    assert len(backbones(drawn(run._repr_html_()))) == 4
    impossible = bs.solve(robot, load=bs.Load(displacements=[0.3, 0.3, 0.3]))
    assert impossible._repr_html_().startswith("<table>")
    unsaid = bs.sweep(robot, rows, disks=False)
    assert unsaid._repr_html_().startswith("<table>")


def test_a_robot_is_drawn_unloaded_and_its_name_escaped() -> None:
    straight = bs.load_robot("amouri2019", {"name": "<script>alert(1)</script>"})
    picture = drawn(straight._repr_html_())
    assert picture.attrib["aria-label"] == straight.name
    (line,) = backbones(picture)
    assert len({x for x, _ in line}) == 1
    bent = straight.with_({"segments.0.backbone.rest_bend": "60 deg"})
    (line,) = backbones(drawn(bent._repr_html_()))
    assert line[-1][0] - line[0][0] > 40
