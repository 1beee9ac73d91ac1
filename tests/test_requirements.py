"""The lock file: every package pinned by hash, and no registry named."""

from __future__ import annotations

import re
from pathlib import Path

LOCK = Path(__file__).parents[1] / "requirements" / "dev.lock"


def test_each_package_has_its_hashes() -> None:
    entries = LOCK.read_text("utf-8").replace("\\\n", " ").splitlines()
    assert len(entries) > 50
    for entry in entries:
        pin, *hashes = re.split(r"\s+--hash=", entry.strip())
        assert re.fullmatch(r"[\w.-]+==[^ ;]+(?: ;.*)?", pin), entry
        assert hashes and all(re.fullmatch("sha256:[0-9a-f]{64}", each) for each in hashes)


def test_no_registry_is_named() -> None:
    text = LOCK.read_text("utf-8")
    assert "://" not in text and "index-url" not in text and "find-links" not in text
