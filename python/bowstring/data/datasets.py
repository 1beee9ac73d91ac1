"""Public data sets by name: downloaded at a pinned commit and checked by hash, not packaged.

If `BOWSTRING_DATA` names a folder, files are read from there and nothing is downloaded.
"""

from __future__ import annotations

import difflib
import errno
import hashlib
import os
import queue
import shutil
import stat
import threading
import urllib.parse
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from bowstring.aliases import Progress
from bowstring.errors import InputError
from bowstring.files.atomic_io import (
    check_replaceable,
    folder_beside,
    readable,
    resolved,
    user_cache,
    write_whole,
)
from bowstring.formatting import listed
from bowstring.optional import load_extra
from bowstring.units import quote

__all__ = ["DataFile", "DataSet", "available", "copy", "describe", "path", "table"]

VARIABLE: Final = "BOWSTRING_DATA"
_RAW: Final = "https://raw.githubusercontent.com"
_LICENCE: Final = "LICENSE"
_MOST: Final = 20_000_000  # bytes of a file; the largest has 0.7 MB
_LONGEST: Final = 120.0  # s for the download of a file
_SILENCE: Final = 30.0  # s without data from the server
_REDIRECTS: Final = 5


@dataclass(frozen=True)
class DataFile:
    """File of a data set.

    Attributes
    ----------
    name : str
        Local name.
    sha256 : str
    origin : str
        Path in the repository.
    part : str or None
        Name of its table, if it is one that `bowstring.data.measurements.load` reads.
    """

    name: str
    sha256: str
    origin: str
    part: str | None = None


@dataclass(frozen=True)
class DataSet:
    """Published data set of measurements or computations, with its source.

    Attributes
    ----------
    name, description : str
    kind : str
        "measured" or "computed".
    repository, commit : str
        Repository on GitHub (owner/name), and pinned commit.
    licence : str
    files : tuple of DataFile
    transcribed : str or None
        Source of the files if they were transcribed and are not in the repository.
    """

    name: str
    description: str
    kind: Literal["measured", "computed"]
    repository: str
    commit: str
    licence: str
    files: tuple[DataFile, ...]
    transcribed: str | None = None

    def url(self, file: DataFile) -> str | None:
        """URL of a file; None for a transcribed one."""
        if self.transcribed is not None and file.name != _LICENCE:
            return None
        return f"{_RAW}/{self.repository}/{self.commit}/{file.origin}"

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the tables that `bowstring.data.measurements.load` reads."""
        return tuple(file.part for file in self.files if file.part is not None)


# The hashes are those of sha256sum over unchanged, renamed copies of the files, each with the same
# number of bytes as in the repository. Only bending.csv and single_tendon.csv are no copies.
_OPENCR: Final = (
    "ContinuumRoboticsLab/opencr-mujoco",
    "17fff8b125dbb702c8688e1d8ffd723050c284c1",
    "MIT",
)
_OPENCR_LICENCE: Final = "66bb402ecef5c4982dffee51187722cae4fac50d75a71ad4457b1684ccf2a203"
_MOCAP: Final = "data/sysid/ftdcr_v4/tdcr_sysid_20260511-183002_analysis/tdcr_sysid_20260511-183002"
_MOCAP_TABLES: Final = {
    "train": "1eddfda64b3cf51a7f6cdf3e88f088cbb70baa944be4e5ebb30ef397f76590af",
    "val": "a69fd0e11c7e8ddbeb6828d7ca604f01e6c6bc45ea92311ae632e88302a751fe",
    "keypoints": "80a4b16c32ea20c13bc2952039188b642db59633df10fe3e54a85ac7b270a38c",
    "tendon_pull": "5931b7e466acf0569debd89011879dee6aee7a816cb75a9721aa0f236e79a3c8",
}
_SOROSIM: Final = "data/reference/sorosim"


def _licence(sha256: str) -> DataFile:
    return DataFile(_LICENCE, sha256, _LICENCE)


_SETS: Final = {
    item.name: item
    for item in (
        DataSet(
            "crl-ftdcr-mocap",
            "Robot of three segments and nine tendons: tip by motion capture against tendon "
            "displacement",
            "measured",
            *_OPENCR,
            (
                *(
                    DataFile(f"ftdcr_v4_{part}.csv", sha256, f"{_MOCAP}_{part}.csv", part)
                    for part, sha256 in _MOCAP_TABLES.items()
                ),
                DataFile(
                    "ftdcr_v4_geometry.json",
                    "6660beccc31900f2458d975a2a8a71ea897cc19e456bf7d48e12d0526dcf0638",
                    "configs/generation/ftdcr_v4_sysid.json",
                ),
                _licence(_OPENCR_LICENCE),
            ),
        ),
        DataSet(
            "soromox-tentacle",
            "Tapered silicone tentacle that hangs: four markers by motion capture against the "
            "tension of one of two tendons",
            "measured",
            "tud-phi/soromox",
            "4f03054aa9c04eaaa7415d3ea622aea31fc4011b",
            "MIT",
            (
                DataFile(
                    "single_tendon.csv",
                    "9bf6cd99c88a815b9ee8a345a08bf595cf3137c6c57a2208160ad533cef95773",
                    "paper_results/secVa_system_identification",
                    "markers",
                ),
                _licence("b0f8fd3f61c3f40a89d4daa36814f54c8704dc6bf7d1bc111baef5bc86c1aa33"),
            ),
            transcribed="the means of the records data/m1_*.csv and data/m2_*.csv",
        ),
        DataSet(
            "sorosim-rods",
            "Steel rod by another group's Cosserat solver: 500 static shapes and 2 releases",
            "computed",
            *_OPENCR,
            (
                DataFile(
                    "SpringSteel_statics.csv",
                    "2a711f7ffd63969c626adfc0ec8da2119e0f67cb85f6f4e5281eba905167239b",
                    f"{_SOROSIM}/sorosim_statics/SpringSteelRodMuJoCo_dataStatics.csv",
                ),
                DataFile(
                    "SpringSteel_dynamics_1.txt",
                    "f64c9ce6c8581d591b23db30e715f4ccda9dc251ec42f5efd74f2fc40714bdd8",
                    f"{_SOROSIM}/sorosim_dynamics/SpringSteelRodMuJoCo_1.txt",
                ),
                DataFile(
                    "SpringSteel_dynamics_2.txt",
                    "c95cf547b2d87ca280e28999dee36a2b0b5115a2ab75b673b42271eaff4412a8",
                    f"{_SOROSIM}/sorosim_dynamics/SpringSteelRodMuJoCo_2.txt",
                ),
                _licence(_OPENCR_LICENCE),
            ),
        ),
        DataSet(
            "tamm-spring",
            "Spring-backbone actuator: angle and direction of 27 bends against tendon displacement",
            "measured",
            "tarvitamm/modeling-bending-behavior-in-cable-driven-concentric-spring-actuator",
            "81db7953fe9abb89db1594c29a3c14be60c55607",
            "MIT",
            (
                DataFile(
                    "bending.csv",
                    "83bca4d03bb97afe42f8d31c8e0aa2ed49edb34d6b6cffa885a777a6d9ca7c05",
                    "figures/visual_model_comparison.py",
                    "bending",
                ),
                _licence("9a7c606e1627ecaef5bffc73b1550545579720c61e6dea9d9ae6e000b327b888"),
            ),
            transcribed="the tuples in figures/visual_model_comparison.py",
        ),
        DataSet(
            "ucl-planar-shape",
            "Planar robot of two segments: 433 backbone shapes by camera, in pixels",
            "measured",
            "hmmnice/learning-based-continuum-robot-IK",
            "59133ad6fb9fc4284787f7e98b8f14c09584b430",
            "MIT",
            (
                DataFile(
                    "sample_data.csv",
                    "a4d80395ba9a8e58ad53bc078eea1a145d67be3526f1857b2966947a9619dbe7",
                    "data_collection/sample_data.csv",
                    "shapes",
                ),
                _licence("679a867e6947e8ab542024b14a5065a05a8ff9062879ec34cef340fea79334cb"),
            ),
        ),
    )
}


def available() -> list[str]:
    """List the names of the public data sets."""
    return sorted(_SETS)


def describe(name: str) -> DataSet:
    """Return the description and source of a data set.

    Raises
    ------
    InputError
        If there is no such set.
    """
    if name in _SETS:
        return _SETS[name]
    near = difflib.get_close_matches(str(name).lower(), available(), n=1, cutoff=0.4)
    hint = f"did you mean {near[0]}? There" if near else "there"
    raise InputError(f"there is no data set {quote(name)}; {hint} are {listed(available())}.")


def path(name: str, *, progress: Progress | None = None) -> Path:
    """Return the folder with all files of a data set, downloaded if needed, and checked.

    Parameters
    ----------
    name : str
        One of `available`.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    Path
        Path of the folder.

    Raises
    ------
    InputError
        If there is no such set, or a file is not available or is not the pinned one.
    """
    return _files(describe(name), progress)[0].parent


def _files(found: DataSet, progress: Progress | None) -> list[Path]:
    files = []
    for k, file in enumerate(found.files):
        if progress is not None:
            progress(file.name, k / len(found.files))
        files.append(_file(found, file))
    return files


def table(name: str, part: str | None = None) -> Path:
    """Return the file of one table of a data set, downloaded if needed, and checked.

    Parameters
    ----------
    name : str
        One of `available`.
    part : str, optional
        One of `DataSet.parts`; may be left out if there is only one.

    Raises
    ------
    InputError
        As for `path`, or if there is no such table.
    """
    found = describe(name)
    if not found.parts:
        raise InputError(
            f"{name} is {found.kind} and holds no table of measurements; "
            f'its files are in bowstring.data.datasets.path("{name}")'
        )
    if part is None and len(found.parts) > 1:
        raise InputError(f"{name} has the parts {listed(found.parts)}; name one")
    for file in found.files:
        if file.part is not None and part in (None, file.part):
            return _file(found, file)
    near = difflib.get_close_matches(str(part), found.parts, n=1)
    hint = f"did you mean {near[0]}? " if near else ""
    raise InputError(f"{name} has no part {quote(part)}; {hint}It has {listed(found.parts)}.")


def copy(name: str, folder: str | Path, *, progress: Progress | None = None) -> Path:
    """Copy a data set into a folder of its name.

    Parameters
    ----------
    name : str
        One of `available`.
    folder : str or Path
        Folder in which a folder NAME is created or, if it contains only files of this set,
        replaced; `BOWSTRING_DATA` may point to it afterwards.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    Path
        Path of the new folder.
    """
    found = describe(name)
    target = Path(folder) / name
    check_replaceable(resolved(target, f"cannot write {target}"), f"cannot write {name}")
    _check_copy(found, target)
    files = _files(found, progress)
    _check_copy(found, target)

    def fill(new: Path) -> None:
        for file in files:
            shutil.copyfile(file, new / file.name)

    write_whole(target, f"data set {name}", fill, lambda: _check_copy(found, target))
    return target


def _check_copy(found: DataSet, target: Path) -> None:
    """Refuse a folder that contains other files, or files that were changed."""
    known = {file.name: file.sha256 for file in found.files}
    if target.exists() and not target.is_dir():
        raise InputError(f"{target} is a file; name another folder")
    try:
        for there in sorted(target.iterdir()) if target.exists() else ():
            if there.name not in known or not there.is_file():
                raise InputError(
                    f"{target} holds {quote(there.name)}, which is none of {found.name}; name "
                    "another folder"
                )
            if _digest(there) != known[there.name]:
                raise InputError(
                    f"{there} is not the published file, as one that was changed, and existing "
                    "files are not overwritten; move it away or name another folder"
                )
    except OSError as error:
        raise InputError(f"{target} cannot be read: {error.strerror}") from None


# -- where files are ---------------------------------------------------------------------------


def _file(found: DataSet, file: DataFile) -> Path:
    """Return a checked file from the user's folder, or downloaded."""
    home = os.environ.get(VARIABLE)
    if home:
        return _given(Path(home), found, file)
    url = found.url(file)
    if url is None:
        raise InputError(
            f"{found.name} cannot be downloaded: {file.name} was transcribed from "
            f"{found.transcribed} of {found.repository}; set {VARIABLE} to a folder that has "
            f"{found.name}/{file.name}"
        )
    return _download(found, file, url)


def _given(home: Path, found: DataSet, file: DataFile) -> Path:
    folder = home / found.name
    if not folder.is_dir():
        raise InputError(
            f"{VARIABLE} is {home}, and there is no folder {found.name} in it; put the data there, "
            "or unset it so that they are downloaded"
        )
    there = folder / file.name
    try:
        digest = _digest(there)
    except FileNotFoundError:
        raise InputError(
            f"{there} is missing; {VARIABLE} names this folder, put the file there, or unset it "
            "so that it is downloaded"
        ) from None
    except OSError as error:
        raise InputError(f"{there} cannot be read: {error.strerror}") from None
    if digest != file.sha256:
        raise InputError(
            f"{there} is not the file published at commit {found.commit[:12]} of "
            f"{found.repository}: its SHA-256 begins with {digest[:12]}, not {file.sha256[:12]}; "
            "replace it"
        )
    return there


def _digest(file: Path) -> str:
    """SHA-256 of a file; raise `OSError` for a pipe or device, which may have no end."""
    with readable(file) as stream:
        found = os.fstat(stream.fileno())
        if not stat.S_ISREG(found.st_mode):
            raise OSError(errno.EINVAL, "it is not a regular file")
        if found.st_size > _MOST:
            raise OSError(
                errno.EFBIG,
                f"it has {found.st_size / 1e6:.3g} MB, a file of a data set has at most "
                f"{_MOST / 1e6:.3g} MB",
            )
        return hashlib.sha256(stream.read(_MOST)).hexdigest()


def _download(found: DataSet, file: DataFile, url: str) -> Path:
    cache = user_cache() / found.name / found.commit[:12]
    there = cache / file.name
    try:
        if _digest(there) == file.sha256:
            return there
    except OSError:
        pass  # missing or damaged: download it
    load_extra("download")  # before work begins
    data = _fetch(found, file, url)
    if hashlib.sha256(data).hexdigest() != file.sha256:
        raise InputError(
            f"{url} is not the file that it was (another SHA-256 than {file.sha256[:12]}...) and "
            "is not used; try again, and report it if this stays"
        )
    try:
        cache.mkdir(parents=True, exist_ok=True)
        with folder_beside(there) as work:
            (work / "new").write_bytes(data)
            os.replace(work / "new", there)
    except OSError as error:
        raise InputError(
            f"{file.name} of {found.name} cannot be kept in {cache}: {error.strerror or error}; "
            f"make the folder writable, or have the files in one that {VARIABLE} names"
        ) from None
    return there


class _Refused(Exception):
    """A server's answer that is refused; the text has the reason."""


def _fetch(found: DataSet, file: DataFile, url: str) -> bytes:
    """Download a URL with limits of size and time.

    A separate thread reads it, because a server that sends single bytes never lets a read time out.
    """
    answers: queue.SimpleQueue[bytes | Exception] = queue.SimpleQueue()
    given_up = threading.Event()

    def work() -> None:
        try:
            answers.put(_body(url, given_up))
        except Exception as error:
            answers.put(error)

    threading.Thread(target=work, name="download", daemon=True).start()
    try:
        answer = answers.get(timeout=_LONGEST)
    except queue.Empty:
        answer = _Refused(f"it is not there after {_LONGEST:g} s")
    finally:
        given_up.set()
    if isinstance(answer, bytes):
        return answer
    raise InputError(
        f"{file.name} of {found.name} cannot be downloaded from {url}: {_why(answer)}; "
        f"{VARIABLE} can name a folder that has it"
    )


def _body(url: str, given_up: threading.Event) -> bytes:
    import requests

    for _ in range(_REDIRECTS + 1):
        # Redirects are followed here: requests reads their whole body.
        with requests.get(
            url,
            stream=True,
            timeout=_SILENCE,
            allow_redirects=False,
            headers={"Accept-Encoding": "identity"},
        ) as answer:
            if answer.is_redirect:
                url = urllib.parse.urljoin(url, answer.headers["Location"])
                continue
            answer.raise_for_status()
            coding = answer.headers.get("Content-Encoding", "identity")
            if coding != "identity":  # compressed data may expand to gigabytes
                raise _Refused(f"the server sends it compressed ({coding[:20]}), unasked")
            data = bytearray()
            for block in answer.raw.stream(65536, decode_content=False):
                data += block
                if len(data) > _MOST:
                    raise _Refused(f"it is longer than {_MOST / 1e6:.3g} MB")
                if given_up.is_set():
                    break
            return bytes(data)
    raise _Refused(f"the server redirects more than {_REDIRECTS} times")


def _why(error: Exception) -> str:
    import requests

    if isinstance(error, _Refused):
        return str(error)
    if isinstance(error, requests.exceptions.HTTPError) and error.response is not None:
        return f"the server answers {error.response.status_code}"
    if isinstance(error, requests.exceptions.Timeout):
        return "the server does not answer in time"
    if isinstance(error, requests.exceptions.ProxyError):
        return "the proxy does not let it through"
    return "the network or the server cannot be reached"
