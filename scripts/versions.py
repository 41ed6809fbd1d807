"""Does fitball run with the lowest and with the newest versions of its packages, on each Python of this machine?

For each Python and each of the two, an environment is made in a folder that is removed again, from pyproject.toml and
not from requirements.lock; verbs and quick tests run in it. Two to five minutes each, some hundred megabytes.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PYTHONS = ("3.11", "3.12", "3.13")
VERSIONS = ("lowest", "newest")
EXTRAS = ("parquet", "dask")
TABLE, FAST = "wang_zero_spin.csv", ("--model", "grip-slip", "--out")
FILM = str(ROOT / "datasets" / "tracks" / "table_tennis_topspin.hdf5")
VERBS = (
    ("calibrate", TABLE, "--point-only", "--out", "point"),
    ("calibrate", TABLE, *FAST, "fit"),
    ("plot", "fit", "all", "--out", "figures"),
    ("export", "point", "--to", "c", "--out", "bounce.h"),
    ("export", "fit", "--to", "netcdf", "--out", "fit.nc"),
    ("batch", TABLE, "wang_topspin.csv", "--point-only", *FAST, "batch"),
    ("track", FILM, "--out", "track"),
    ("compare", TABLE, "--quick", "--models", "grip-slip,brody", "--out", "compare"),
)
FILES = "arviz data_read data_units environment export_tables figure_style inference_priors minimiser observables"
TESTS = tuple(f"tests/test_{name}.py" for name in (*FILES.split(), "table_size"))
TOOLS = ("hypothesis", "jsonschema", "openpyxl", "pytest")


def required(versions: str) -> list[str]:
    """What pyproject.toml requires, as words for pip: at its "lowest" version, or as it is written."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = [*project["dependencies"], *(line for name in EXTRAS for line in project["optional-dependencies"][name])]
    return [line.replace(">=", "==") for line in lines] if versions == "lowest" else lines


def find_python(name: str) -> str | None:
    """The path of a Python of version `name` or at that path, from PATH or pyenv; None where there is none."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for candidate in (name, f"python{name}", "python", *map(str, sorted(pyenv.glob(f"{name}.*/bin/python")))):
        code = "import sys; print('{}.{}'.format(*sys.version_info), sys.executable)"
        try:
            done = subprocess.run([candidate, "-c", code], capture_output=True, text=True, check=False)
        except OSError:
            continue
        version, _space, path = done.stdout.strip().partition(" ")
        if path and (candidate == name or version == name):
            return path
    return None


def inside(environment: Path, name: str) -> str:
    """A program of an environment."""
    return str(environment / "Scripts" / f"{name}.exe" if os.name == "nt" else environment / "bin" / name)


def installing(place: Path, python: str, versions: str) -> Iterator[Sequence[str]]:
    """The commands that make an environment at `place`: packages as wheels only, as most users get them."""
    it = inside(place, "python")
    if uv := shutil.which("uv"):
        yield (uv, "venv", "--quiet", "--python", python, str(place))
        install: tuple[str, ...] = (uv, "pip", "install", "--quiet", "--python", it)
        extras = [word for name in EXTRAS for word in ("--extra", name)]
        end = "lowest-direct" if versions == "lowest" else "highest"
        wanted = ("--requirement", str(ROOT / "pyproject.toml"), *extras, "--resolution", end)
        fresh: tuple[str, ...] = ("--refresh-package", "fitball")
    else:
        yield (python, "-m", "venv", str(place))
        install, fresh = (it, "-m", "pip", "install", "--quiet"), ()
        wanted = tuple(required(versions))
    yield (*install, "--only-binary", ":all:", *wanted)
    yield (*install, "--no-deps", *fresh, str(ROOT))
    # ArviZ itself would raise what it shares with fitball above the lowest.
    yield (*install, *TOOLS, *(("arviz",) if versions == "newest" else ()))


def steps(place: Path, python: str, versions: str, tests: Sequence[str]) -> Iterator[tuple[str, bool]]:
    """What was run, and whether it ended well; nothing runs in an environment that could not be made."""
    work = place / "work"
    work.mkdir()
    kept = {"NUMBA_CACHE_DIR": str(place / "kernels"), "PYTHONPYCACHEPREFIX": str(place / "bytecode")}

    def run(command: Sequence[str], folder: Path) -> bool:
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "encoding": "utf-8", "errors": "replace"}
        done = subprocess.run(command, cwd=folder, env=os.environ | kept, check=False, **streams)
        if done.returncode:
            print(" ".join(command), *done.stdout.splitlines()[-30:], sep="\n    ", flush=True)
        return done.returncode == 0

    made = all(run(command, work) for command in installing(place / "venv", python, versions))
    yield "install", made
    if made:
        for words in VERBS:
            yield " ".join(words[:2]), run((inside(place / "venv", "fitball"), *words), work)
        # -P: the installed fitball is tested, not the folder that pytest is started in.
        pytest = (inside(place / "venv", "python"), "-P", "-m", "pytest", "-p", "no:cacheprovider", "--quiet")
        yield "pytest", run((*pytest, *tests), ROOT)


def main() -> int:
    """Try all; the exit code is 1 where something failed or no Python was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", action="append", help=f"version or path (repeatable; default: {PYTHONS})")
    parser.add_argument("--versions", choices=VERSIONS, action="append", help="repeatable; default: both")
    parser.add_argument("tests", nargs="*", help="what pytest is given, after -- (default: some quick files)")
    options = parser.parse_args()
    counts = [0, 0]
    for name in options.python or PYTHONS:
        python = find_python(name)
        if python is None:
            print(f"{name}: not on this machine", flush=True)
            counts[1] += bool(options.python)
            continue
        for versions in options.versions or VERSIONS:
            with tempfile.TemporaryDirectory(prefix="fitball-", ignore_cleanup_errors=True) as folder:
                begun = time.monotonic()
                for what, good in steps(Path(folder), python, versions, options.tests or TESTS):
                    counts[not good] += 1
                    spent, begun = time.monotonic() - begun, time.monotonic()
                    print(f"{name} {versions}: {what}: {'ok' if good else 'FAILED'} ({spent:.0f} s)", flush=True)
    print(f"{counts[0]} passed, {counts[1]} failed")
    return 0 if counts[0] and not counts[1] else 1


if __name__ == "__main__":
    sys.exit(main())
