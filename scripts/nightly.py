"""The long things, a line of result each: `scripts/test --nightly [PART ...]`, in the environment
of scripts/test.

pages      pages of all verbs in Chromium, 400 and 1280 px wide: errors, addresses asked for,
           widths, pictures
ports      ports compiled and run; those without a compiler are skipped
docs       generated parts, links, words, and the commands of all pages
hostile    damaged tables, scenes, fits, names and places
studies    short runs of the studies, with their controls
readonly   the main job by a user who can write nothing but the result
types      what pyright says of a user's script
versions   the wheel of the sdist with the lowest and with the newest packages, on each Python found
"""

import argparse
import html
import itertools
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PYTHONS = ("3.11", "3.12", "3.13")
ENDS = ("lowest", "newest")
TOOLS = ("hypothesis", "mpmath", "openpyxl", "pytest", "pytest-xdist")
QUICK = (
    "read saved sampling least_squares calibrate render exports scheduling cli batch tracks "
    "models plot"
)
# Words for Python, -P but for studies, which import each other; WORK is a folder that is removed
# again.
COMMANDS = {
    "ports": [
        "-P -m pytest -q -rs -p no:cacheprovider tests/test_port.py tests/test_port_space.py "
        "tests/test_port_text.py"
    ],
    "docs": ["-P scripts/docs.py --check", "-P scripts/docs.py --run"],
    "hostile": ["-P scripts/hostile.py", "-P scripts/hostile.py --control"],
    "studies": [
        "scripts/validation/sbc.py WORK --only grip-slip --tables 100",
        "scripts/validation/films.py --films 10",
    ],
}
# The checker of a user's script, besides mypy.
PYRIGHT = "pyright==1.1.414"
# What each verb is asked for its page, in the folder of that name; `fit` is the first one's.
PAGES = {
    "fit": "calibrate wang_all.csv --figures all",
    "drop": "calibrate synthetic_drop.csv",
    "check": "check wang_all.csv",
    "compare": "compare wang_zero_spin.csv --models grip-slip,brody",
    "predict": "predict fit synthetic_court.csv",
    "plan": "plan fit --target mu --count 4",
    "simulate": "simulate fit --impact 'v_1=25, theta_1=20 deg'",
    "track": "track table_tennis_topspin.csv",
    "batch": "batch wang_zero_spin.csv wang_topspin.csv --model grip-slip",
    "export": "export fit --to page",
    "rederive": "rederive",
    "bench": "bench",
}
# Put into each page, which a frame shows: what it complains of goes to the page around it.
WATCH = """<script>(() => {
  const found = [];
  addEventListener('error', e => found.push(e.message || e.target.tagName + ' did not load'), true);
  addEventListener('unhandledrejection', e => found.push('rejected: ' + e.reason));
  console.error = console.warn = (...words) => found.push('console: ' + words.join(' '));
  addEventListener('load', async () => {
    document.querySelectorAll('details').forEach(one => one.open = true);
    const broken = () => found.push('a picture is broken');
    await Promise.all([...document.images].map(one => one.decode().catch(broken)));
    const width = document.documentElement.scrollWidth;
    if (width > innerWidth) found.push(`${width} px wide`);
    for (const one of performance.getEntriesByType('resource'))
      if (!one.name.startsWith('data:')) found.push('asks for ' + one.name);
    parent.postMessage([name, found], '*');
  });
})()</script>"""
FRAMES = """<!doctype html><script>const all = {};
addEventListener('message', e => {
    all[e.data[0]] = e.data[1];
    document.title = JSON.stringify(all);
});</script>"""
CONTROL = (
    "<head><p style='width: 2000px'><script>console.error('said'); nothing()</script><img "
    "src='none.png'>"
)


class FailedError(Exception):
    """What went wrong, in words."""


def done(*command: str | Path, cwd: Path = ROOT, **environment: str) -> str:
    """The last line of what a command prints. Raises FailedError with the last ones where it
    fails.
    """
    found = subprocess.run(
        list(map(str, command)),
        cwd=cwd,
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
    )
    lines = found.stdout.splitlines() or [""]
    if found.returncode:
        raise FailedError(
            "\n".join(
                [f"{shlex.join(map(str, command))}: exit code {found.returncode}", *lines[-25:]]
            )
        )
    return lines[-1].strip("= ")


def pages(work: Path) -> str:
    """Make and show all pages; the control has faults, which must be found at both widths."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise FailedError("no Chromium is installed")
    shown = {"control": CONTROL}
    frames = FRAMES
    widths = (400, 1280)
    for name, words in PAGES.items():
        fitball = Path(sys.executable).with_name("fitball")
        done(fitball, *shlex.split(words), "--out", name, "--quiet", cwd=work)
        shown[name] = next((work / name).glob("*.html")).read_text("utf-8")
    for name, text in shown.items():
        (work / f"{name}.html").write_text(text.replace("<head>", f"<head>{WATCH}", 1), "utf-8")
        frames += "".join(
            f"<iframe name='{name} {n}' src={name}.html width={n} frameborder=0></iframe>"
            for n in widths
        )
    (work / "all.html").write_text(frames)
    flags = (
        "--headless",
        "--no-sandbox",
        f"--user-data-dir={work}/profile",
        "--virtual-time-budget=60000",
    )
    answer = subprocess.run(
        [browser, *flags, "--dump-dom", work / "all.html"],
        capture_output=True,
        check=False,
    ).stdout
    title = answer.decode().partition("<title>")[2].partition("</title>")[0]
    found = json.loads(html.unescape(title) or "{}")
    bad = [
        f"{name}: {'; '.join(said)}"
        for name, said in found.items()
        if said and "control" not in name
    ]
    missing = {f"{name} {width}" for name in [*PAGES, "control"] for width in widths} - set(found)
    bad += [f"{name}: no answer" for name in sorted(missing)]
    bad += [
        f"control: only {found[f'control {n}']}"
        for n in widths
        if len(found.get(f"control {n}", "")) < 5
    ]
    if bad:
        raise FailedError("\n".join(bad))
    return f"{len(found)} views"


def readonly(work: Path) -> str:
    """Root becomes another user for it."""
    (out := work / "out").mkdir(mode=0o777)
    out.chmod(0o777)
    work.chmod(0o755)
    nobody = (
        ("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups") if os.getuid() == 0 else ()
    )
    nowhere = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "MPLCONFIGDIR"), "/proc/none") | {
        "NUMBA_CACHE_DIR": ""
    }
    calibrate = (
        Path(sys.executable).with_name("fitball"),
        "calibrate",
        "wang_zero_spin.csv",
        "--out",
        out / "fit",
    )
    return done(*nobody, *calibrate, cwd=Path("/"), **nowhere)


def types(work: Path) -> str:
    """What pyright says of a user's script, beside mypy: `tests/test_types.py` skips it where it is
    not installed.
    """
    place = work / "pyright"
    pip = (sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
    done(*pip, "--target", place, PYRIGHT)
    path = os.pathsep.join([str(place / "bin"), os.environ["PATH"]])
    test = (sys.executable, "-P", "-m", "pytest", "-q", "-p", "no:cacheprovider")
    return done(*test, "tests/test_types.py", PATH=path, PYTHONPATH=str(place))


def python_of(version: str) -> str:
    """The Python that runs this, one of PATH or pyenv. Raises FailedError where there is none."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for one in (
        sys.executable,
        f"python{version}",
        *map(str, pyenv.glob(f"{version}.*/bin/python")),
    ):
        if shutil.which(one):
            found = subprocess.run(
                [one, "--version"],
                capture_output=True,
                text=True,
                check=False,
            ).stdout
            if found.startswith(f"Python {version}."):
                return one
    raise FailedError("not on this machine")


def versions(work: Path, version: str, end: str) -> str:
    """Quick tests in an environment of its own: lowest as pyproject.toml names it, newest as pip
    finds it.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *extras["parquet"], *extras["dask"]]
    if end == "lowest":
        wanted = [line.replace(">=", "==") for line in wanted]
    done(python_of(version), "-m", "venv", work / "venv")
    python = work / "venv" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    pip = (python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
    done(*pip, "--only-binary", ":all:", *wanted, *TOOLS)
    done(*pip, "hatchling")
    done(python, "-m", "hatchling", "build", "-t", "sdist", "-d", work)
    done(*pip, "--no-deps", "--no-build-isolation", next(work.glob("*.tar.gz")))
    test = (
        python,
        "-P",
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-n",
        "2",
        "--dist",
        "loadfile",
    )
    return done(
        *test,
        *(f"tests/test_{name}.py" for name in QUICK.split()),
        NUMBA_CACHE_DIR=str(work),
    )


def run(work: Path, name: str, *given: str) -> str:
    """One part. Raises FailedError."""
    if name in COMMANDS:
        lines = [line.replace("WORK", str(work)) for line in COMMANDS[name]]
        return ", ".join(done(sys.executable, *line.split()) for line in lines)
    if given:
        return versions(work, *given)
    return {"pages": pages, "readonly": readonly, "types": types}[name](work)


def main() -> int:
    """Run the parts, print their lines; 1 where one failed."""
    names = ("pages", *COMMANDS, "readonly", "types", "versions")
    parser = argparse.ArgumentParser(
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("parts", nargs="*", metavar="PART", choices=("all", *names), default="all")
    parser.add_argument(
        "--python",
        nargs="+",
        default=PYTHONS,
        help="for versions (default: 3.11 3.12 3.13)",
    )
    parser.add_argument("--end", nargs="+", default=ENDS, choices=ENDS)
    asked = parser.parse_args()
    parts = names if "all" in asked.parts else asked.parts
    todo: list[tuple[str, ...]] = [(name,) for name in parts if name != "versions"]
    if "versions" in parts:
        todo += [("versions", *pair) for pair in itertools.product(asked.python, asked.end)]
    failed = 0
    for part in todo:
        begun = time.monotonic()
        good = True
        with tempfile.TemporaryDirectory(prefix="fitball-", ignore_cleanup_errors=True) as folder:
            try:
                said = run(Path(folder), *part)
            except FailedError as error:
                said = str(error)
                good = False
                failed = failed + 1
        line = (
            f"{' '.join(part)}: {'ok' if good else 'FAILED'} in {time.monotonic() - begun:.0f} "
            f"s: {said}"
        )
        print(line.replace("\n", "\n    "), flush=True)
    print(f"{len(todo) - failed} passed, {failed} failed")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
