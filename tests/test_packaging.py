"""Metadata, citation, recipe and workflows are consistent."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

import bowstring as bs
from bowstring.optional import EXTRAS

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
#: Name in the Python index -> name in conda-forge, where they differ.
CONDA_NAMES = {"matplotlib": "matplotlib-base", "netCDF4": "netcdf4", "SALib": "salib"}


def text(*path: str) -> str:
    return ROOT.joinpath(*path).read_text("utf-8")


def parsed(*path: str) -> Any:
    return yaml.safe_load(text(*path))


@pytest.fixture(scope="module")
def project() -> Any:
    return tomllib.loads(text("pyproject.toml"))["project"]


def as_conda(requirement: str) -> str:
    """Convert ``numpy>=1.26`` to ``numpy >=1.26``, with its name in conda-forge."""
    found = re.fullmatch(r"([\w.-]+)(>=[\w.]+)", requirement)
    assert found, requirement
    return f"{CONDA_NAMES.get(found[1], found[1])} {found[2]}"


def test_the_base_has_at_most_twelve_dependencies(project: Any) -> None:
    assert 5 < len(project["dependencies"]) <= 12


def test_each_extra_installs_its_module(project: Any) -> None:
    brings = {
        extra: re.split(r"\W", needs[0])[0]
        for extra, needs in project["optional-dependencies"].items()
    }
    own = {name: extra for name, extra in EXTRAS.items() if extra.requirement != extra.module}
    assert brings == {name: extra.module for name, extra in own.items()}
    assert [extra.requirement for extra in own.values()] == [f"bowstring[{name}]" for name in own]


def test_the_page_of_the_installation_has_each_optional_package() -> None:
    page = text("docs", "start", "install.md")
    for name, extra in EXTRAS.items():
        assert f"| `{name}` | `{extra.command}`" in page


def test_the_conda_recipe_matches_the_project(project: Any) -> None:
    recipe = parsed("packaging", "conda", "recipe.yaml")
    oldest = project["requires-python"].removeprefix(">=")
    assert recipe["context"]["version"] == bs.__version__
    assert recipe["about"]["summary"] == project["description"]
    assert recipe["about"]["license"] == project["license"]
    command = "bowstring = " + project["scripts"]["bowstring"]
    assert recipe["build"]["python"]["entry_points"] == [command]
    needs = recipe["requirements"]
    python, *others = needs["run"]
    assert python == "python >=${{ python_min }}"
    assert parsed("packaging", "conda", "variants.yaml")["python_min"] == [oldest]
    assert others == [as_conda(each) for each in project["dependencies"]]
    extras = [each for extra in project["optional-dependencies"].values() for each in extra]
    assert sorted(needs["run_constraints"]) == sorted(map(as_conda, extras))
    (backend,) = tomllib.loads(text("pyproject.toml"))["build-system"]["requires"]
    assert backend.replace("maturin", "maturin ") in needs["host"]


def test_the_citation_matches_the_page(project: Any) -> None:
    cite = parsed("CITATION.cff")
    (study,) = cite["references"]
    assert cite["version"] == bs.__version__ and cite["license"] == project["license"]
    page = text("docs", "help", "cite.md")
    (author,) = (each["name"] for each in cite["authors"])
    assert f"author = {{{{{author}}}}}" in page and f"title = {{{cite['title']}}}" in page
    assert f"version = {{{cite['version']}}}" in page
    for source in (page, text("docs", "references.bib"), text("paper", "paper.bib")):
        entry = re.search(r"@misc\{amouri2019,.*?\n\}", source, re.DOTALL)
        assert entry, "no journal is known, so it is @misc"
        said = entry[0].replace("{DoFs}", "DoFs")
        assert f"title = {{{study['title']}}}" in said
        assert f"year = {{{study['year']}}}" in said
    assert f"title: '{cite['title']}'" in text("paper", "paper.md")


def test_an_old_python_gets_a_message() -> None:
    code = "import sys; sys.version_info = (3, 9, 18, 'final', 0); import bowstring"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    said = done.stderr.splitlines()[-1]
    assert said.startswith("ImportError: Bowstring needs Python 3.10 or newer, and this is 3.")
    assert said.endswith("; make an environment of a newer one: python3.12 -m venv .venv")


# -- continuous integration --------------------------------------------------------------------


def jobs() -> dict[str, Any]:
    """All jobs of all workflows, by file and name."""
    return {
        f"{file.stem}.{name}": job
        for file in WORKFLOWS
        for name, job in parsed(".github", "workflows", file.name)["jobs"].items()
    }


def test_each_step_is_a_command_that_is_there() -> None:
    targets = set(re.findall(r"^([\w-]+):", text("Makefile"), re.MULTILINE))
    commands = [
        step["run"] for job in jobs().values() for step in job.get("steps", ()) if "run" in step
    ]
    assert len(commands) >= 8
    for command in commands:
        program, *words = command.split()
        if program == "make":
            assert words[0] in targets, command
        elif program == "python":
            assert (ROOT / words[0]).is_file(), command
        elif program not in ("sudo", "gh"):  # a package of the system; the release's page
            assert (ROOT / program).is_file(), command


def test_oldest_and_newest_are_tested(project: Any) -> None:
    matrix = jobs()["ci.versions"]["strategy"]["matrix"]["include"]
    by_resolution = {each["resolution"]: each["python"] for each in matrix}
    assert by_resolution["lowest-direct"] == project["requires-python"].removeprefix(">=")
    newest = tuple(map(int, by_resolution["highest"].split(".")))
    assert newest >= sys.version_info[:2]


def test_a_release_needs_the_tests_and_all_wheels() -> None:
    assert jobs()["release.publish"]["needs"] == ["test", "wheels"]
    built = [each["platform"] for each in jobs()["wheels.wheel"]["strategy"]["matrix"]["include"]]
    assert built == [
        "linux-x86_64",
        "linux-aarch64",
        "macos-x86_64",
        "macos-aarch64",
        "windows-x86_64",
    ]
