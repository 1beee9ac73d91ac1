"""Public data sets by name: pinned, verified by hash, from the user's folder or downloaded."""

from __future__ import annotations

import contextlib
import gzip
import hashlib
import http.server
import os
import re
import shutil
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bowstring.data import datasets
from bowstring.errors import InputError
from objects import refused
from shell import Shell

Folder = Callable[[str], Path]


def test_each_set_is_described() -> None:
    assert datasets.available() == [
        "crl-ftdcr-mocap",
        "soromox-tentacle",
        "sorosim-rods",
        "tamm-spring",
        "ucl-planar-shape",
    ]
    for name in datasets.available():
        found = datasets.describe(name)
        assert found.kind == ("computed" if name == "sorosim-rods" else "measured")
        assert re.fullmatch("[0-9a-f]{40}", found.commit) and found.licence == "MIT"
        for file in found.files:
            assert re.fullmatch("[0-9a-f]{64}", file.sha256)
            url = found.url(file)
            if file.name in ("bending.csv", "single_tendon.csv"):
                assert url is None and found.transcribed
            else:
                start = f"https://raw.githubusercontent.com/{found.repository}/{found.commit}/"
                assert url is not None and url.startswith(start)
        assert "LICENSE" in [file.name for file in found.files]


@pytest.mark.parametrize("name", datasets.available())
def test_the_files_are_the_pinned_ones(name: str, public_data: Folder) -> None:
    folder = public_data(name)
    assert datasets.path(name) == folder
    for file in datasets.describe(name).files:
        assert hashlib.sha256((folder / file.name).read_bytes()).hexdigest() == file.sha256


def test_a_table_by_its_part(public_data: Folder) -> None:
    folder = public_data("crl-ftdcr-mocap")
    assert datasets.table("crl-ftdcr-mocap", "val") == folder / "ftdcr_v4_val.csv"
    with pytest.raises(InputError, match="has the parts train, val, keypoints and tendon_pull"):
        datasets.table("crl-ftdcr-mocap")
    with pytest.raises(InputError, match='no part "trian"; did you mean train'):
        datasets.table("crl-ftdcr-mocap", "trian")
    refused("sorosim-rods is computed and holds no table", lambda: datasets.table("sorosim-rods"))


@pytest.fixture
def given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of the user, with a synthetic file of tamm-spring."""
    folder = tmp_path / "data" / "tamm-spring"
    folder.mkdir(parents=True)
    (folder / "bending.csv").write_text("l1_mm\n1\n")
    monkeypatch.setenv("BOWSTRING_DATA", str(folder.parent))
    return folder


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("tamm", 'there is no data set "tamm"; did you mean tamm-spring?'),
        (
            "zzz",
            "there are crl-ftdcr-mocap, soromox-tentacle, sorosim-rods, tamm-spring and ucl-planar",
        ),
        ("sorosim-rods", "there is no folder sorosim-rods in it"),
        ("tamm-spring", "is not the file published at commit 81db7953fe9a"),
    ],
)
def test_errors_are_reported(name: str, says: str, given: Path, shell: Shell) -> None:
    assert says in shell.error("data", "get", name)
    assert says in shell.error("data", "get", name, "--json")


def test_a_missing_file_is_named(given: Path) -> None:
    (given / "bending.csv").unlink()
    refused(r"bending\.csv is missing; BOWSTRING_DATA names", lambda: datasets.path("tamm-spring"))


def test_a_transcription_cannot_be_downloaded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("BOWSTRING_DATA", raising=False)
    with pytest.raises(InputError, match=r"cannot be downloaded: bending\.csv was transcribed"):
        datasets.path("tamm-spring")


# -- downloads, from a local server ---------------------------------------------------------------


@pytest.fixture
def server(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """The address of the server, and the folder that it serves."""
    root = tmp_path / "served"
    root.mkdir()

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def __init__(self, *arguments: object) -> None:
            super().__init__(*arguments, directory=str(root))  # type: ignore[arg-type]

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Quiet) as host:
        thread = threading.Thread(target=host.serve_forever, args=(0.01,))
        thread.start()
        yield f"http://127.0.0.1:{host.server_port}", root
        host.shutdown()
        thread.join()


@pytest.fixture
def online(
    server: tuple[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[datasets.DataSet, Path]:
    """A synthetic set on the server, an empty cache, and no folder of the user."""
    address, root = server
    made = replace(
        datasets.describe("sorosim-rods"),
        name="made-up",
        repository="some/one",
        commit="0123456789abcdef" * 2 + "01234567",
        files=(
            datasets.DataFile("a.csv", hashlib.sha256(b"x\n1\n").hexdigest(), "deep/a.csv", "a"),
        ),
    )
    there = root / "some" / "one" / made.commit / "deep" / "a.csv"
    there.parent.mkdir(parents=True)
    there.write_bytes(b"x\n1\n")
    monkeypatch.delenv("BOWSTRING_DATA", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(datasets, "_RAW", address)
    monkeypatch.setitem(datasets._SETS, "made-up", made)
    return made, there


def test_a_download_is_checked_and_kept(
    online: tuple[datasets.DataSet, Path], tmp_path: Path, shell: Shell
) -> None:
    made, there = online
    got = shell.json("data", "get", "made-up")
    folder = Path(got["folder"])
    assert tmp_path / "cache" in folder.parents
    assert (folder / "a.csv").read_bytes() == b"x\n1\n"
    there.unlink()  # from now on it comes from the cache
    assert datasets.table("made-up") == folder / "a.csv"
    code, out, err = shell("data", "get", "made-up")
    assert code == 0 and not err and made.commit[:12] in out


def test_a_file_with_another_hash_is_refused(
    online: tuple[datasets.DataSet, Path], tmp_path: Path, shell: Shell
) -> None:
    online[1].write_bytes(b"x\n2\n")
    assert "is not the file that it was" in shell.error("data", "get", "made-up")
    assert not list((tmp_path / "cache").rglob("a.csv"))


def test_a_damaged_cache_is_repaired(online: tuple[datasets.DataSet, Path]) -> None:
    kept = datasets.path("made-up") / "a.csv"
    kept.write_bytes(b"damaged")
    assert datasets.table("made-up").read_bytes() == b"x\n1\n"


def test_a_download_without_the_extra(
    online: tuple[datasets.DataSet, Path], monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    datasets.path("made-up")
    monkeypatch.setitem(sys.modules, "requests", None)
    shell.json("data", "get", "made-up")  # it is in the cache
    monkeypatch.setenv("XDG_CACHE_HOME", str(online[1].parent))
    assert shell.error("data", "get", "made-up") == (
        "downloads need requests, which cannot be loaded; install it: "
        "pip install 'bowstring[download]'"
    )


def test_no_network(
    online: tuple[datasets.DataSet, Path], monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    monkeypatch.setattr(datasets, "_RAW", "http://127.0.0.1:9")  # discard port: no server
    said = shell.error("data", "get", "made-up")
    assert "a.csv of made-up cannot be downloaded" in said
    assert "cannot be reached; BOWSTRING_DATA can name a folder that has it" in said


def test_a_file_missing_on_the_server(online: tuple[datasets.DataSet, Path], shell: Shell) -> None:
    online[1].unlink()
    assert "the server answers 404" in shell.error("data", "get", "made-up")


def test_a_cache_that_cannot_be_written(
    online: tuple[datasets.DataSet, Path], tmp_path: Path, shell: Shell
) -> None:
    (tmp_path / "cache").write_text("a file where the folder would be")
    said = shell.error("data", "get", "made-up")
    assert "a.csv of made-up cannot be kept in" in said and "make the folder writable" in said


# -- copies, and the command -----------------------------------------------------------------------


def test_a_copy_is_complete_and_keeps_other_files(
    online: tuple[datasets.DataSet, Path], tmp_path: Path, shell: Shell
) -> None:
    out = tmp_path / "out"
    got = shell.json("data", "get", "made-up", "--out", str(out))
    assert got["files"] == [str(out / "made-up" / "a.csv")]
    assert (out / "made-up" / "a.csv").read_bytes() == b"x\n1\n"
    datasets.copy("made-up", out)  # again, replacing the former
    (out / "made-up" / "notes.txt").write_text("mine")
    said = shell.error("data", "get", "made-up", "--out", str(out))
    assert 'holds "notes.txt", which is none of made-up' in said
    assert (out / "made-up" / "notes.txt").read_text() == "mine"
    shutil.rmtree(out)
    out.write_text("a file")
    assert "cannot write" in shell.error("data", "get", "made-up", "--out", str(out))


def test_list(shell: Shell) -> None:
    rows = shell.json("data", "list")["data_sets"]
    assert [row["name"] for row in rows] == datasets.available()
    crl = rows[0]
    assert crl["parts"] == ["train", "val", "keypoints", "tendon_pull"]
    assert crl["kind"] == "measured" and crl["files"][0]["url"].startswith("https://")
    for row in rows:
        transcribed = row["name"] in ("soromox-tentacle", "tamm-spring")
        assert bool(row["transcribed_from"]) == (row["files"][0]["url"] is None) == transcribed
    code, out, err = shell("data", "list")
    assert code == 0 and not err and "ucl-planar-shape" in out


# -- endless servers and files ---------------------------------------------------------------------


@pytest.fixture
def hostile(
    online: tuple[datasets.DataSet, Path], monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[Callable[[http.server.BaseHTTPRequestHandler], None]], None]]:
    """Serve the output of a function in place of the file."""
    answer: list[Callable[[http.server.BaseHTTPRequestHandler], None]] = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            with contextlib.suppress(OSError):  # the client hangs up
                answer[0](self)

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as host:
        host.daemon_threads = True
        thread = threading.Thread(target=host.serve_forever, args=(0.01,))
        thread.start()
        monkeypatch.setattr(datasets, "_RAW", f"http://127.0.0.1:{host.server_port}")
        yield answer.append
        host.shutdown()
        thread.join()


def head(handler: http.server.BaseHTTPRequestHandler, **fields: str) -> None:
    handler.send_response(302 if "Location" in fields else 200)
    for name, value in fields.items():
        handler.send_header(name.replace("_", "-"), value)
    handler.end_headers()


def test_a_body_without_an_end_is_cut_off(hostile: Any, shell: Shell) -> None:
    sent = []

    def answer(handler: http.server.BaseHTTPRequestHandler) -> None:
        head(handler)
        while True:
            handler.wfile.write(bytes(1 << 20))
            sent.append(1)

    hostile(answer)
    assert "cannot be downloaded" in (said := shell.error("data", "get", "made-up"))
    assert "it is longer than 20 MB" in said
    assert len(sent) < 60


def test_a_compressed_body_is_not_unpacked(hostile: Any, shell: Shell) -> None:
    def answer(handler: http.server.BaseHTTPRequestHandler) -> None:
        head(handler, Content_Encoding="gzip")
        handler.wfile.write(gzip.compress(bytes(30_000_000)))

    hostile(answer)
    assert "the server sends it compressed (gzip), unasked" in shell.error("data", "get", "made-up")


@pytest.mark.parametrize("within", ["head", "body"])
def test_a_server_that_sends_byte_by_byte(
    hostile: Any, shell: Shell, monkeypatch: pytest.MonkeyPatch, within: str
) -> None:
    monkeypatch.setattr(datasets, "_LONGEST", 0.3)
    over = threading.Event()

    def answer(handler: http.server.BaseHTTPRequestHandler) -> None:
        if within == "body":
            head(handler, Content_Length="1000")
        else:
            handler.wfile.write(b"HTTP/1.1 200 OK\r\nX: ")
        while not over.wait(0.02):
            handler.wfile.write(b"x")
            handler.wfile.flush()

    hostile(answer)
    try:
        assert "it is not there after 0.3 s" in shell.error("data", "get", "made-up")
    finally:
        over.set()


def test_redirects_in_a_circle(hostile: Any, shell: Shell) -> None:
    hostile(lambda handler: head(handler, Location="/again"))
    assert "redirects more than 5 times" in shell.error("data", "get", "made-up")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name")
def test_a_pipe_in_place_of_a_file(given: Path, shell: Shell) -> None:
    (given / "bending.csv").unlink()
    os.mkfifo(given / "bending.csv")
    assert "cannot be read: it is not a regular file" in shell.error("data", "get", "tamm-spring")


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no /dev/zero")
def test_a_device_and_a_huge_file_in_place_of_a_file(given: Path, shell: Shell) -> None:
    (given / "bending.csv").unlink()
    (given / "bending.csv").symlink_to("/dev/zero")
    assert "it is not a regular file" in shell.error("data", "get", "tamm-spring")
    (given / "bending.csv").unlink()
    with (given / "bending.csv").open("wb") as file:
        file.truncate(10**12)
    assert "it has 1e+06 MB, a file of a data set has at most 20 MB" in shell.error(
        "data", "get", "tamm-spring"
    )


def test_a_copy_that_was_changed_is_kept(
    online: tuple[datasets.DataSet, Path], tmp_path: Path, shell: Shell
) -> None:
    kept = datasets.copy("made-up", tmp_path) / "a.csv"
    kept.write_text("x\n1\nmine\n")
    said = shell.error("data", "get", "made-up", "--out", str(tmp_path))
    assert "existing files are not overwritten" in said
    assert kept.read_text() == "x\n1\nmine\n"
