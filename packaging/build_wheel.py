"""Build the wheel of this machine, or the source distribution, into dist/.

    python packaging/build_wheel.py [--sdist]

On Linux zig links against an old C library, so that the wheel is a manylinux one and runs on any
distribution. maturin and zig are installed into .venv-wheel, by requirements/wheel.lock. Needs
Python, a Rust toolchain and, for the wheel, the page of `make playground`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
HOME = ROOT / ".venv-wheel"
LOCK = ROOT / "requirements" / "wheel.lock"
PAGE = ROOT / "python" / "bowstring" / "cli" / "playground.html"


def programs() -> Path:
    """Return the folder of maturin and zig; install them if it is missing or the lock is newer."""
    folder = HOME / ("Scripts" if os.name == "nt" else "bin")
    done = HOME / "installed"
    if not done.exists() or done.stat().st_mtime < LOCK.stat().st_mtime:
        venv.create(HOME, with_pip=True, symlinks=os.name != "nt")
        pip = [str(folder / "python"), "-m", "pip", "install", "-q", "--require-hashes"]
        subprocess.run([*pip, "-r", str(LOCK)], check=True)
        done.touch()
    return folder


def main() -> None:
    """Build the wheel or the source distribution."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sdist", action="store_true", help="the source distribution instead")
    args = parser.parse_args()
    folder = programs()
    if not (args.sdist or PAGE.is_file()):
        sys.exit(f"{PAGE.name} is missing: run `make playground` first (it needs Node.js)")
    command = ["sdist"] if args.sdist else ["build", "--release", "--locked"]
    if sys.platform == "linux" and not args.sdist:
        command += ["--zig", "--compatibility", "manylinux2014"]
    env = {**os.environ, "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run([str(folder / "maturin"), *command, "--out", "dist"], cwd=ROOT, env=env)
    sys.exit(done.returncode)


if __name__ == "__main__":
    main()
