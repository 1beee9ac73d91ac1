"""Install the source distribution in an empty folder and check its contents.

    python packaging/check_sdist.py [dist/bowstring-*.tar.gz]

Makes an environment of its own in a temporary folder and has pip build and install the archive
there, as for a user without a suitable wheel. Needs Python and a Rust toolchain; any failure ends
with exit code 1.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import tarfile
import tempfile
import time
import venv
from pathlib import Path

from check_wheel import built, run, without

#: Contents: files to build from, no tests, pages or data.
NEEDED = {"Cargo.lock", "Cargo.toml", "CHANGELOG.md", "CITATION.cff", "LICENSE", "PKG-INFO"}
NEEDED |= {"README.md", "pyproject.toml"}
ALLOWED = re.compile(
    r"python/bowstring/[\w/]+\.(py|pyi|typed|html\.j2|js)"
    r"|python/bowstring/(robot/builtin|data/mappings)/[\w-]+\.yaml"
    r"|python/bowstring/suite/sets/[\w-]+/(robot|protocol)\.yaml"
    r"|python/bowstring/validity/chart_response\.npz"
    r"|crates/[\w-]+/(src|tests|benches|examples)/[\w/]+\.rs"
    r"|crates/[\w-]+/(Cargo\.toml|README\.md|cbindgen\.toml|include/[\w]+\.h)"
)


def check_files(archive: Path) -> None:
    """Exit if a file is missing that a build or a user needs, or if there is any other."""
    with tarfile.open(archive) as tar:
        names = {name.split("/", 1)[1] for name in tar.getnames() if "/" in name}
    if missing := NEEDED - names:
        sys.exit(f"{archive.name} lacks {', '.join(sorted(missing))}")
    if others := sorted(name for name in names - NEEDED if not ALLOWED.fullmatch(name)):
        sys.exit(f"{archive.name} holds what is not needed to build: {', '.join(others[:10])}")
    print(f"{archive.name}: {archive.stat().st_size / 1e6:.2f} MB, {len(names)} files")


def main() -> None:
    """Check one source distribution."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("sdist", type=Path, nargs="?", help="the one in dist if left out")
    archive = built(parser.parse_args().sdist, "*.tar.gz", "make sdist")
    check_files(archive)
    env = without("PYTHON", "VIRTUAL_ENV", "MATURIN", "BOWSTRING", "CARGO_TARGET")
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        home = Path(folder) / "env"
        venv.create(home, with_pip=True, symlinks=os.name != "nt")
        programs = home / ("Scripts" if os.name == "nt" else "bin")
        pip = [str(programs / "python"), "-m", "pip", "install", "-q", "--no-cache-dir"]
        run([*pip, str(archive)], env=env, cwd=folder)
        print(f"built and installed after {time.perf_counter() - began:.1f} s")
        bowstring = str(programs / "bowstring")
        print(run([bowstring, "--version"], env=env, cwd=folder).strip())
        solve = [bowstring, "solve", "amouri2019", "--tension", "80,0,0", "--json"]
        status = json.loads(run(solve, env=env, cwd=folder))["status"]
        if status != "converged":
            sys.exit(f"the built-in robot at 80 N ends with {status}")


if __name__ == "__main__":
    main()
