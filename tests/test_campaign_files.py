"""A small campaign of damaged files, like ``make campaign-files``."""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path
from random import Random

import pytest
from campaign import compiled, mutations

if sys.platform != "linux":
    pytest.skip("campaigns need limits on memory", allow_module_level=True)

from campaign import files

SEED = 20


@pytest.fixture(scope="module")
def of(tmp_path_factory: pytest.TempPathFactory) -> dict[str, files.Kind]:
    return files.kinds(tmp_path_factory.mktemp("whole"))


@pytest.mark.slow
def test_damaged_files_are_read_or_refused(of: dict[str, files.Kind], tmp_path: Path) -> None:
    outcomes: Counter[str] = Counter()
    slow = 0
    for number in range(220):
        kind = files.kind_of(number, SEED)
        slow += kind == "hdf5"  # each takes a process of its own
        if kind == "hdf5" and slow > 3:
            continue
        name, outcome, why = files.trial(number, of, tmp_path, SEED)
        assert outcome != "failed", f"{name}, trial {number}: {why}"
        outcomes[outcome] += 1
    assert outcomes["read"] > 20 and outcomes["refused"] > 50


def test_a_trial_is_determined_by_its_number(of: dict[str, files.Kind], tmp_path: Path) -> None:
    made = []
    for _ in range(2):
        files.trial(3, of, tmp_path, SEED)
        (file,) = tmp_path.glob("damaged*")
        made.append(file.read_bytes())
        file.unlink()
    assert made[0] == made[1]


def test_an_error_of_another_kind_is_a_failure(of: dict[str, files.Kind], tmp_path: Path) -> None:
    def broken(file: Path) -> None:
        raise KeyError(file.name)

    kinds = {name: files.Kind(kind.suffix, kind.corpus, broken) for name, kind in of.items()}
    _, outcome, why = files.trial(0, kinds, tmp_path, SEED)
    assert outcome == "failed" and "KeyError" in why


@pytest.mark.parametrize("yaml", [False, True])
def test_most_changed_structures_are_still_files_of_their_format(yaml: bool) -> None:
    data = b'{"name": "a", "rows": [[1, 2], [3, 4]], "at": {"x": 1, "y": [2]}}'
    made = [mutations.reshape(data, Random(i), yaml=yaml) for i in range(200)]
    assert len(set(made)) > 120
    assert any(b"0" * 400 in each for each in made) and any(b"[[[[" in each for each in made)


def test_damage_changes_most_files() -> None:
    data = b"name: a\nsegments:\n  - length: 100 mm\n" * 5
    made = {mutations.damage(data, Random(i), [data]) for i in range(100)}
    assert len(made) > 80


def test_rescaled_files_have_the_structure_of_the_original() -> None:
    data = b'{"name": "a", "rows": [[1.0, 0.0], [3.0, 4.0]], "at": []}'
    made = [json.loads(mutations.rescale(data, Random(i))) for i in range(200)]
    assert {(each["name"], len(each["rows"][1])) for each in made} == {("a", 2)}
    numbers = [abs(x) for each in made for row in each["rows"] for x in row]
    assert max(numbers) > 1e6 and 0.0 < min(x for x in numbers if x) < 1e-6


def test_intact_compiled_robots() -> None:
    robots = [json.loads(text) for text in compiled.corpus(files.ROOT)]
    assert {robot["tendon_path"] for robot in robots} == {"straight", "embedded"}
    assert any(len(robot["segments"][0]["sections"]) == 5 for robot in robots)
