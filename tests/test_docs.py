"""The examples of the documentation produce the results shown there."""

from __future__ import annotations

import doctest
import importlib
import inspect
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bowstring.cli import main

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [
    ROOT / "README.md",
    *(page for page in sorted(DOCS.rglob("*.md")) if "_build" not in page.parts),
]
TUTORIALS = [page for page in PAGES if "{code-cell}" in page.read_text("utf-8")]
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]?\d+)?")


_SOLID = r"bowstring export [^\n]*(--picture|\.(step|stl|glb))"
#: Words of slow examples, and their marker.
_LONG = (
    (r"bowstring study|make study|run_study|judge_data|bowstring fit", pytest.mark.slow),
    (r"bowstring fe|import fem", pytest.mark.fem),
    (_SOLID + r"|make_solid|bowstring\.cad", pytest.mark.cad),
)


#: Messages on the troubleshooting page that pip and the system's linker print.
_OF_OTHERS = (
    "Failed building wheel",
    "cargo not found",
    "libGL",
    "requires a different Python",
    "No matching distribution found for typer",
    "Illegal instruction",
)


def _name(page: Path) -> str:
    return str(page.relative_to(ROOT)).removeprefix("docs/")


def blocks(language: str) -> list[object]:
    """The fenced blocks of a language, each with its page and line as its name."""
    found = []
    for page in PAGES:
        text = page.read_text("utf-8")
        for match in re.finditer(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
            line = text[: match.start()].count("\n") + 1
            marks = [mark for word, mark in _LONG if re.search(word, match[1])]
            found.append(pytest.param(match[1], id=f"{_name(page)}:{line}", marks=marks))
    return found


@pytest.fixture(autouse=True)
def beginner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty folder with the robot files that the README and the start pages say to copy."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    for name in (
        "my_robot.yaml",
        "small.yaml",
        "bench.csv",
        "foreign.csv",
        "foreign.yaml",
        "tip_path.csv",
    ):
        shutil.copy(ROOT / "examples" / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")


@pytest.mark.parametrize("block", blocks("console"))
def test_commands(
    block: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each `$ bowstring ...` succeeds, and prints the output shown below it, if any."""
    for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
        command, _, shown = part.partition("\n")
        program, *arguments = shlex.split(command)
        if command == "make study":  # the Makefile's line after the build
            arguments = ["study", "amouri2019"]
        elif program != "bowstring":
            continue  # make test, pip, cp
        if re.search(_SOLID, command):
            pytest.importorskip("build123d", exc_type=ImportError)
        if arguments[0] == "fe":
            finite_elements_at(tmp_path, monkeypatch)
        code = main.run(arguments)
        out, err = capsys.readouterr()
        assert code == 0, err
        if shown.strip():
            assert_same_text(out, shown)


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_commands_in_sh_blocks(page: Path) -> None:
    """Slow examples and those with public data are in sh blocks; their flags must exist."""
    import typer

    fences = re.findall(
        r"^```([^`\n]*)\n(.*?)^```$", page.read_text("utf-8"), re.MULTILINE | re.DOTALL
    )
    for language, block in fences:
        for line in block.replace("\\\n", " ").splitlines():
            if language not in ("", "sh") or not line.startswith("bowstring "):
                continue
            assert language == "sh", f"{line!r} is never run: put it into a console block"
            _, *arguments = shlex.split(line, comments=True)
            command = typer.main.get_command(main.app)
            if arguments[0].startswith("-"):  # options of the program itself, which act at once
                assert arguments[0] in {name for option in command.params for name in option.opts}
                continue
            while hasattr(command, "commands"):
                command = command.commands[arguments.pop(0)]
            command.make_context("bowstring", arguments)


def finite_elements_at(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip where CalculiX is missing; keep its results apart from the user's."""
    if shutil.which("ccx") is None:
        pytest.skip("needs CalculiX (the program ccx) on the search path")
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))


def assert_same_text(printed: str, shown: str) -> None:
    """Compare words, up to a line of dots; numbers may differ in the last digit between platforms.

    Folders, numbers of time steps, and numbers that the program calls approximate are ignored.

    """
    vary = r"\S+(?=/bowstring-study)|\d+ (?=steps)|(?<=about )\d\S*"
    printed, shown = (re.sub(vary, "", text) for text in (printed, shown))
    shown, dots, _ = shown.partition("\n...")
    words, expected = printed.split(), shown.split()
    if dots:
        words, printed = words[: len(expected)], " ".join(words[: len(expected)])
    assert [NUMBER.sub("#", w) for w in words] == [NUMBER.sub("#", w) for w in expected]
    numbers = [float(n) for w in words for n in NUMBER.findall(w)]
    assert numbers == pytest.approx([float(n) for n in NUMBER.findall(shown)], rel=2e-3, abs=2e-3)


@pytest.mark.parametrize("block", blocks("python"))
def test_python(block: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A block with prompts is a doctest, any other block is executed."""
    if "make_solid" in block:
        pytest.importorskip("build123d", exc_type=ImportError)
    if "import fem" in block:
        finite_elements_at(tmp_path, monkeypatch)
    for library in ("jax", "torch"):
        if f"bowstring.{library}" in block:
            pytest.importorskip(library, reason=f"needs {library}", exc_type=ImportError)
    if "bs.view(" in block:
        pytest.importorskip("viser", reason="needs viser", exc_type=ImportError)
    if "gymnasium" in block:
        pytest.importorskip("gymnasium", reason="needs gymnasium", exc_type=ImportError)
    if ">>>" in block:
        test = doctest.DocTestParser().get_doctest(block, {}, "page", None, None)
        result = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test)
        assert result.failed == 0
    else:
        exec(compile(block, "page", "exec"), {"__name__": "page"})


@pytest.mark.parametrize("page", TUTORIALS, ids=_name)
def test_tutorials(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The cells of a tutorial are executed in order."""
    from matplotlib import pyplot

    monkeypatch.setattr(pyplot, "show", lambda: pyplot.close("all"))
    cells = re.findall(
        r"^```\{code-cell\}[^\n]*\n(.*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL
    )
    exec(compile("\n".join(cells), str(page), "exec"), {"__name__": "tutorial"})


def test_every_command_is_in_the_reference() -> None:
    from typer.main import get_command

    from bowstring.cli.main import app

    def names(command: Any, before: str = "") -> list[str]:
        found = getattr(command, "commands", None)
        if found is None:
            return [before.strip()]
        return [path for name, one in found.items() for path in names(one, f"{before} {name}")]

    page = (DOCS / "reference" / "cli.md").read_text("utf-8")
    missing = [name for name in names(get_command(app)) if f"\n## {name}\n" not in page]
    assert not missing


def test_every_public_name_is_in_the_reference() -> None:
    import bowstring

    listed = set()
    for page in (DOCS / "reference" / "api").glob("*.md"):
        for module, names in re.findall(
            r"^```\{api\} (\S+)\n(.*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL
        ):
            owner = importlib.import_module(module)
            listed |= {id(getattr(owner, name)) for name in names.split()}
    packages = [bowstring, *(getattr(bowstring, name) for name in dir(bowstring))]
    for package in packages:
        if not inspect.ismodule(package):
            continue
        for name in getattr(package, "__all__", ()):
            value = getattr(package, name)
            if name.startswith("_") or inspect.ismodule(value):
                continue
            assert id(value) in listed, f"{package.__name__}.{name} is in no reference page"


def test_messages_of_the_troubleshooting_page_are_those_of_the_program() -> None:
    sources = [*(ROOT / "python").rglob("*.py"), *(ROOT / "crates").rglob("*.rs")]
    text = " ".join(path.read_text("utf-8") for path in sources)
    text = re.sub(r'"\s*\n?\s*f?"', "", text)  # one sentence over several lines
    page = (DOCS / "help" / "troubleshooting.md").read_text("utf-8")
    for row in re.findall(r"^\| (`.*?) \|", page, re.MULTILINE):
        for message in re.findall(r"`([^`]+)`", row):
            if message in _OF_OTHERS:
                continue
            words = max(re.split(r"[\d.]+\S*|\.\.\.|,", message), key=len).strip()
            assert words in text, f"no message of the program contains {words!r}"


def labelled(page: str) -> int:
    """Number of equations with a label, by which Sphinx numbers them."""
    return len(re.findall(r"^(?::label: \S+|\$\$ \(\S+\))$", page, re.MULTILINE))


def test_equations_cited_in_the_code_exist() -> None:
    theory = DOCS / "theory"
    pages = re.search(
        r"```\{toctree\}(.*?)```", (theory / "index.md").read_text("utf-8"), re.DOTALL
    )
    assert pages is not None
    equations = {
        f"{number}.{equation}"
        for number, page in enumerate(re.findall(r"^[\w-]+$", pages[1], re.MULTILINE), start=1)
        for equation in range(1, 1 + labelled((theory / f"{page}.md").read_text("utf-8")))
    }
    sources = [
        *(ROOT / "crates" / "bowstring-rod" / "src").rglob("*.rs"),
        *(ROOT / "crates" / "bowstring-core" / "src").rglob("*.rs"),
        *(ROOT / "python" / "bowstring").rglob("*.py"),
    ]
    cited = set()
    for source in sources:
        text = source.read_text("utf-8")
        cited.update(*re.findall(r"Eq\. (\d+\.\d+)(?: and (\d+\.\d+))?", text))
        for page in re.findall(r"docs/theory/([\w-]+)\.md", text):
            assert (theory / f"{page}.md").exists(), source
    assert len(cited) > 25 and cited - {""} <= equations


def test_pages_read_on_a_forge() -> None:
    """Pages have no part that only the built site shows, and the robot of the start is the file."""
    only_built = r"\{(?:doc|figure|math|literalinclude|include|grid|glossary|term|download)\}"
    for page in PAGES:
        text = page.read_text("utf-8")
        assert not re.search(only_built, text), _name(page)
    start = (DOCS / "start" / "robot.md").read_text("utf-8")
    assert (ROOT / "examples" / "small.yaml").read_text("utf-8") in start


def test_readme_locates_the_command_before_its_first_use() -> None:
    text = (ROOT / "README.md").read_text("utf-8")
    assert 0 < text.find("$ source .venv/bin/activate") < text.find("$ bowstring")


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
@pytest.mark.parametrize(
    ("given", "robot"), [((), "amouri2019"), (("ROBOT=my robot.yaml",), "my robot.yaml")]
)
def test_make_study_of_a_robot(given: tuple[str, ...], robot: str) -> None:
    found = subprocess.run(
        ["make", "-n", "-C", str(ROOT), "study", *given], capture_output=True, text=True, check=True
    )
    last = [line for line in found.stdout.splitlines() if "bowstring study" in line][-1]
    assert shlex.split(last)[-1] == robot


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_links(page: Path) -> None:
    """Every link and picture of a page leads to an existing file."""
    for target in re.findall(r"\]\(([^)#]+)", page.read_text("utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target


@pytest.mark.parametrize(
    "example", sorted((ROOT / "examples").glob("*.py")), ids=lambda path: path.name
)
def test_examples(example: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with np.printoptions():
        exec(compile(example.read_text("utf-8"), str(example), "exec"), {"__name__": "__main__"})
    assert capsys.readouterr().out
