"""The lock files: every package pinned by hash, consistent versions, and no registry named."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

LOCKS = sorted((Path(__file__).parents[1] / "requirements").glob("*.lock"))
HASHED = [lock for lock in LOCKS if lock.stem != "peers"]


def pins(lock: Path) -> list[str]:
    """The entries, each with its hashes on one line."""
    return lock.read_text("utf-8").replace("\\\n", " ").splitlines()


@pytest.mark.parametrize("lock", HASHED, ids=lambda lock: lock.stem)
def test_each_package_has_its_hashes(lock: Path) -> None:
    assert len(pins(lock)) >= 3
    for entry in pins(lock):
        pin, *hashes = re.split(r"\s+--hash=", entry.strip())
        assert re.fullmatch(r"[\w.-]+==[^ ;]+(?: ;.*)?", pin), entry
        assert hashes and all(re.fullmatch("sha256:[0-9a-f]{64}", each) for each in hashes)


@pytest.mark.parametrize("lock", LOCKS, ids=lambda lock: lock.stem)
def test_no_registry_is_named(lock: Path) -> None:
    text = lock.read_text("utf-8")
    assert "://" not in text and "index-url" not in text and "find-links" not in text


def test_base_and_test_have_the_versions_of_all() -> None:
    versions = {lock.stem: {entry.split(" ")[0] for entry in pins(lock)} for lock in HASHED}
    assert versions["base"] <= versions["test"] <= versions["all"]
