"""Install a wheel where there is no Rust, and check that it works.

    python packaging/check_wheel.py [dist/bowstring-*.whl] [--size 8]

Makes an environment of its own in a temporary folder, installs the wheel and its dependencies, runs
the study of the built-in robot and solves one robot with each set of processor instructions. Needs
nothing but Python; any failure ends with exit code 1.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

SOLVE = """
import json
import bowstring as bs
from bowstring import _core
robot = bs.load_robot("amouri2019")
tips = [bs.solve(robot, [f, 0, 0]).tip.position.tolist() for f in (5.0, 40.0, 80.0)]
print(json.dumps({"instructions": _core.instructions(), "tips": tips}))
"""
IMPORT = "import time; t = time.perf_counter(); import bowstring; print(time.perf_counter() - t)"
#: Largest difference of tips between two instruction sets, due to rounding (m).
ROUNDING = 1e-11


def without(*prefixes: str) -> dict[str, str]:
    """Return the environment without the variables with these prefixes."""
    env = {k: v for k, v in os.environ.items() if not k.startswith(prefixes)}
    return {**env, "PYTHONUTF8": "1"}


def without_rust() -> dict[str, str]:
    """Return the environment without Rust, a browser, and variables that redirect Python."""
    env = without("CARGO", "RUST", "PYTHON", "VIRTUAL_ENV", "MATURIN", "BOWSTRING")
    places = env.get("PATH", "").split(os.pathsep)
    tools = ("cargo", "rustc", "maturin")
    env["BROWSER"] = "true"  # a command that takes the page and shows nothing
    env["PATH"] = os.pathsep.join(
        place for place in places if not any(shutil.which(tool, path=place) for tool in tools)
    )
    return env


def built(given: Path | None, pattern: str, command: str) -> Path:
    """Return the given package, or the newest in dist."""
    found = sorted((Path(__file__).parents[1] / "dist").glob(pattern), key=os.path.getmtime)
    package = (given or (found[-1] if found else Path("dist") / pattern)).resolve()
    if not package.is_file():
        sys.exit(f"there is no file {package}; make it by `{command}` first")
    return package


def run(command: list[str], **options: object) -> str:
    """Standard output of a command; exit with its error output if it fails."""
    options |= {"capture_output": True, "encoding": "utf-8", "errors": "replace"}
    done = subprocess.run(command, **options)  # type: ignore[call-overload]
    if done.returncode:
        sys.exit(f"{' '.join(command[:4])} ended with {done.returncode}:\n{done.stderr[-3000:]}")
    return str(done.stdout)


def main() -> None:
    """Check one wheel."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("wheel", type=Path, nargs="?", help="the one in dist if left out")
    parser.add_argument("--size", type=float, default=8.0, help="largest size, MB")
    args = parser.parse_args()
    wheel = built(args.wheel, "*.whl", "make wheel")
    size = wheel.stat().st_size / 1e6
    print(f"{wheel.name}: {size:.2f} MB")
    if size > args.size:
        sys.exit(f"the wheel weighs {size:.2f} MB, it may weigh {args.size:g} MB")
    env = without_rust()
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        home = Path(folder) / "env"
        venv.create(home, with_pip=True, symlinks=os.name != "nt")
        programs = home / ("Scripts" if os.name == "nt" else "bin")
        python = str(programs / "python")
        run([python, "-m", "pip", "install", "-q", str(wheel)], env=env, cwd=folder)
        print(f"installed after {time.perf_counter() - began:.1f} s")
        page = run([str(programs / "bowstring"), "playground"], env=env, cwd=folder)
        print(page.strip())
        study = [str(programs / "bowstring"), "study", "amouri2019", "--json"]
        verdict = json.loads(run(study, env=env, cwd=folder))["verdict"]
        print(f"verdict of the study after {time.perf_counter() - began:.1f} s")
        force = next(m for m in verdict["meanings"] if m["name"] == "cc_from_force")
        holds = force["valid_to_N"]
        if holds is None or not 55.0 < holds < 57.0:
            sys.exit(f"from force, constant curvature holds to {holds} N instead of 56 N")
        times = [float(run([python, "-c", IMPORT], env=env, cwd=folder)) for _ in range(3)]
        print(f"import: {min(times):.3f} s")
        solutions = {}
        for limit in ("avx512", "avx2", "plain"):
            limited = {**env, "BOWSTRING_INSTRUCTIONS": limit}
            said = json.loads(run([python, "-c", SOLVE], env=limited, cwd=folder))
            solutions[said["instructions"]] = [x for tip in said["tips"] for x in tip]
        first = solutions["plain"]
        for name, tips in solutions.items():
            apart = max(abs(a - b) for a, b in zip(first, tips, strict=True))
            print(f"instructions {name}: within {apart:.1e} m of plain ones")
            if apart > ROUNDING:
                sys.exit(f"tips with {name} differ by {apart:.1e} m, more than rounding")


if __name__ == "__main__":
    main()
