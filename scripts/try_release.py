"""Try what would be published: `try_release.py DIST [--python 3.11 ...]`.

The wheel and the sdist in DIST are each installed in an empty environment, which does the main job
outside of the checkout. A Python that is not on this machine is named as not run; with `--python`
it is a fault. The version must be that of CITATION.cff, and of `--tag v3.0.0` where it is given.
"""

import argparse
import os
import runpy
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
NIGHTLY: dict[str, Any] = runpy.run_path(str(ROOT / "scripts" / "nightly.py"))
# What the main job must have written.
MADE = ("fit.json", "report.html", "summary.csv")
# The last lines of a command that failed which are shown.
LAST_CHARACTERS = 2000


class TrialError(Exception):
    """A file that would be published fails; the message says how."""


def call(*command: str | Path, cwd: Path) -> str:
    """Run a command as a user, without the sources of this checkout; what it prints.

    Raises:
        TrialError: the command fails; the message has its last lines.
    """
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        list(map(str, command)),
        cwd=cwd,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
    )
    if done.returncode:
        raise TrialError(
            f"{command[0]}: exit code {done.returncode}\n{done.stdout}"[-LAST_CHARACTERS:]
        )
    return done.stdout


def stated_version(tag: str) -> str:
    """The version of CITATION.cff.

    Raises:
        TrialError: a `tag` that is given is of another version.
    """
    lines = (ROOT / "CITATION.cff").read_text(encoding="utf-8").splitlines()
    version = next(line.partition(": ")[2] for line in lines if line.startswith("version: "))
    if tag and tag != f"v{version}":
        raise TrialError(f"tag {tag}, but CITATION.cff has version {version}")
    return version


def files_of(dist: Path, version: str) -> Sequence[Path]:
    """The wheel and the sdist of a version in a folder.

    Raises:
        TrialError: there is not one of each.
    """
    files = [*dist.glob(f"fitball-{version}-*.whl"), *dist.glob(f"fitball-{version}.tar.gz")]
    if [file.suffix for file in files] != [".whl", ".gz"]:
        raise TrialError(f"{dist}: expected a wheel and an sdist of {version}, found {files}")
    return [file.resolve() for file in files]


def try_file(python: str, file: Path, version: str) -> None:
    """Install a file in an empty environment of a Python, and do the main job with it.

    Raises:
        TrialError: it cannot be installed, has another version, or the main job fails.
    """
    with tempfile.TemporaryDirectory() as temporary:
        work = Path(temporary)
        call(python, "-m", "venv", work / "venv", cwd=work)
        programs = work / "venv" / ("Scripts" if os.name == "nt" else "bin")
        pip = (
            programs / "python",
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
        )
        call(*pip, file, cwd=work)
        said = call(programs / "fitball", "--version", cwd=work).strip()
        if said != f"fitball {version}":
            raise TrialError(f"{file.name} says '{said}'")
        job = ("calibrate", "wang_zero_spin.csv", "--point-only", "--out", "fit")
        call(programs / "fitball", *job, cwd=work)
        missing = [name for name in MADE if not (work / "fit" / name).is_file()]
        if missing:
            raise TrialError(f"the main job made no {', '.join(missing)}")


def main() -> int:
    """Try both files by each Python; 1 where one fails."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("dist", type=Path, metavar="DIST")
    parser.add_argument("--python", nargs="+", default=[])
    parser.add_argument("--tag", default="")
    arguments = parser.parse_args()
    failed = 0
    try:
        version = stated_version(arguments.tag)
        files = files_of(arguments.dist, version)
    except TrialError as error:
        print(error)
        return 1
    for number in arguments.python or NIGHTLY["PYTHONS"]:
        try:
            python = NIGHTLY["python_of"](number)
        except NIGHTLY["FailedError"] as error:
            print(f"Python {number}: not run, {error}", flush=True)
            failed += bool(arguments.python)
            continue
        for file in files:
            try:
                try_file(python, file, version)
                print(f"Python {number}, {file.name}: ok", flush=True)
            except TrialError as error:
                print(f"Python {number}, {file.name}: FAILED: {error}", flush=True)
                failed += 1
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
