"""The long tests, a line of result each: `scripts/test --nightly [PART ...]`, in the environment of
scripts/test.

pages      pages of all verbs in Chromium, 400 and 1280 px wide: errors, addresses that are
           requested, widths, pictures
ports      ports compiled and run; those without a compiler are skipped
engines    recipes of the engine page in the physics engines themselves, with controls
docs       generated parts, links, words, the commands of all pages, all examples of docstrings
site       the manual as a site, in Chromium as `pages`; tutorials run as notebooks
foreign    values and new measurements of balls that fitball's models are not
hostile    damaged tables, scenes, fits, names and places
studies    short runs of the studies, with their controls
remedies   commands and options that messages and pages propose, run on their tables
readonly   the main job by a user who can write nothing but the result
shapes     films as trackers' packages write them, read (scripts/shapes.py)
types      what pyright says of a user's script
versions   the wheel of the sdist with the lowest and with the newest packages, on each Python found
"""

import argparse
import html
import itertools
import json
import os
import runpy
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Names by which systems call Chromium.
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
# Versions of Python that fitball supports.
PYTHONS = ("3.11", "3.12", "3.13")
# Versions of the packages that fitball needs.
ENDS = ("lowest", "newest")
# Packages that the quick tests need besides.
TOOLS = ("hypothesis", "mpmath", "openpyxl", "pytest", "pytest-xdist")
# Tests of what other packages compute, read, write or draw for fitball.
QUICK = (
    "read saved sampling least_squares calibrate render exports scheduling cli batch tracks "
    "models plot"
)
# Arguments of Python by part. Studies import each other, thus without -P. WORK is a folder that is
# removed again.
COMMANDS = {
    "ports": [
        "-P -m pytest -q -rs -p no:cacheprovider tests/test_port.py tests/test_port_space.py "
        "tests/test_port_text.py tests/test_port_range.py tests/test_port_left_out.py "
        "tests/test_port_step.py"
    ],
    "engines": ["-P scripts/engines/check.py WORK"],
    "docs": [
        "-P scripts/docs.py --check",
        "-P scripts/docs.py --run",
        "-P -m pytest -q -p no:cacheprovider tests/test_examples.py",
    ],
    "foreign": ["scripts/validation/foreign.py WORK --tables 160"],
    "remedies": ["-P scripts/remedies.py"],
    "hostile": ["-P scripts/hostile.py", "-P scripts/hostile.py --control"],
    "studies": [
        "scripts/validation/sbc.py WORK --only grip-slip --tables 100",
        "scripts/validation/films.py --films 10",
        "scripts/validation/home_films.py WORK --sessions 10",
    ],
}
# The checker of a user's script, besides mypy.
PYRIGHT = "pyright==1.1.414"
# Command of each page, by the folder of its result; `fit` is used by those after it.
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
# Script that is put into each page, which a frame shows. It sends faults of its page to the page
# around it.
WATCH = """<script>(() => {
  const faults = [];
  const failed = e => faults.push(e.message || e.target.tagName + ' did not load');
  addEventListener('error', failed, true);
  addEventListener('unhandledrejection', e => faults.push('rejected: ' + e.reason));
  console.error = console.warn = (...words) => faults.push('console: ' + words.join(' '));
  addEventListener('load', async () => {
    document.querySelectorAll('details').forEach(details => details.open = true);
    const broken = () => faults.push('a picture is broken');
    await Promise.all([...document.images].map(image => image.decode().catch(broken)));
    const width = document.documentElement.scrollWidth;
    if (width > innerWidth) faults.push(`${width} px wide`);
    for (const entry of performance.getEntriesByType('resource'))
      if (!entry.name.startsWith('data:')) faults.push('asks for ' + entry.name);
    parent.postMessage([name, faults], '*');
  });
})()</script>"""
# Page around the frames: its title collects the faults of all.
FRAMES = """<!doctype html><script>const all = {};
addEventListener('message', e => {
    all[e.data[0]] = e.data[1];
    document.title = JSON.stringify(all);
});</script>"""
# A page with five faults and more, which must be found.
CONTROL = (
    "<head><p style='width: 2000px'><script>console.error('said'); nothing()</script><img "
    "src='none.png'>"
)


# Faults of CONTROL at a width, at least.
CONTROL_FAULTS = 5
# Widths of a page [px]: of a phone, and of a desk.
WIDTHS = (400, 1280)
# Lines of a command that failed which are shown.
LAST_LINES = 25
# User `nobody`, who owns no file.
NOBODY = 65534


class FailedError(Exception):
    """A part of the long tests failed; the message says why."""


def run_command(*command: str | Path, cwd: Path = ROOT, **environment: str) -> str:
    """Run a command; the last line that it prints.

    Raises:
        FailedError: the command fails; the message has its last lines.
    """
    process = subprocess.run(
        list(map(str, command)),
        cwd=cwd,
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
    )
    lines = process.stdout.splitlines() or [""]
    if process.returncode:
        failure = f"{shlex.join(map(str, command))}: exit code {process.returncode}"
        raise FailedError("\n".join([failure, *lines[-LAST_LINES:]]))
    return lines[-1].strip("= ")


def show_pages(work: Path, pages: Mapping[str, Path], may_load: str = "data:") -> str:
    """Show pages, files below `work` by name, at both widths, each beside a control that has
    faults. Pages may load what begins with `may_load`. How many views there were.

    Raises:
        FailedError: no Chromium is installed, or a page has faults.
    """
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise FailedError("no Chromium is installed")
    (work / "control.html").write_text(CONTROL, "utf-8")
    watch = WATCH.replace("data:", may_load)
    frames = FRAMES
    for name, path in {"control": work / "control.html", **pages}.items():
        text = path.read_text("utf-8")
        path.write_text(text.replace("<head>", f"<head>{watch}", 1), "utf-8")
        address = path.relative_to(work).as_posix()
        for width in WIDTHS:
            label = f"{name} {width}"
            frames += f"<iframe name='{label}' src={address} width={width} frameborder=0></iframe>"
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
    faults_of_views = json.loads(html.unescape(title) or "{}")
    bad = faults_of_pages(faults_of_views, pages)
    if bad:
        raise FailedError("\n".join(bad))
    return f"{len(faults_of_views)} views"


def check_pages(work: Path) -> str:
    """Make and show the pages of all verbs.

    Raises:
        FailedError: no Chromium is installed, a verb fails, or a page has faults.
    """
    pages = {}
    for name, words in PAGES.items():
        fitball = Path(sys.executable).with_name("fitball")
        run_command(fitball, *shlex.split(words), "--out", name, "--quiet", cwd=work)
        page = next((work / name).glob("*.html"))
        pages[name] = page.rename(work / f"{name}.html")
    return show_pages(work, pages)


def packages_beside(work: Path, *requirements: str) -> Path:
    """Install packages into a folder beside those of this Python, by a pip of its own.

    Raises:
        FailedError: they cannot be installed.
    """
    run_command(sys.executable, "-m", "venv", work / "pip")
    python = work / "pip" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    pip = (python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
    run_command(*pip, "--no-deps", "--target", work / "packages", *requirements)
    return work / "packages"


def check_site(work: Path) -> str:
    """Build the manual and show all of its pages; run the tutorials as notebooks.

    Raises:
        FailedError: packages cannot be installed, the manual has faults, or a notebook fails.
    """
    packages = str(packages_beside(work, "--requirement", str(ROOT / "requirements-docs.lock")))
    site = work / "site"
    docs = (sys.executable, "-P", "scripts/docs.py", "--site", site)
    run_command(*docs, PYTHONPATH=packages)
    pages = {}
    for path in sorted(site.rglob("*.html")):
        pages[path.relative_to(site).with_suffix("").as_posix()] = path
    shown = show_pages(work, pages, "file:")
    notebooks = (sys.executable, "-P", "scripts/notebooks.py", work / "notebooks", "--run")
    return f"{shown}, {run_command(*notebooks, PYTHONPATH=packages)}"


def faults_of_pages(
    faults_of_views: Mapping[str, Sequence[str]],
    pages: Iterable[str],
) -> list[str]:
    """What is wrong with pages, by the faults that their views sent; a view is `PAGE WIDTH`."""
    bad = []
    for name, faults in faults_of_views.items():
        if faults and "control" not in name:
            bad.append(f"{name}: {'; '.join(faults)}")
    expected = {f"{name} {width}" for name in [*pages, "control"] for width in WIDTHS}
    bad += [f"{name}: no answer" for name in sorted(expected - set(faults_of_views))]
    for width in WIDTHS:
        faults = faults_of_views.get(f"control {width}", [])
        if len(faults) < CONTROL_FAULTS:
            bad.append(f"control: only {faults}")
    return bad


def check_readonly(work: Path) -> str:
    """Fit a table as a user who can write nothing but the result; root becomes another user.

    Raises:
        FailedError: the fit fails.
    """
    out = work / "out"
    out.mkdir(mode=0o777)
    # The mode of mkdir is cut by the umask.
    out.chmod(0o777)
    work.chmod(0o755)
    as_nobody: tuple[str, ...] = ()
    if os.getuid() == 0:
        as_nobody = ("setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups")
    nowhere = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "MPLCONFIGDIR"), "/proc/none")
    nowhere["NUMBA_CACHE_DIR"] = ""
    fitball = Path(sys.executable).with_name("fitball")
    calibrate = (fitball, "calibrate", "wang_zero_spin.csv", "--out", out / "fit")
    return run_command(*as_nobody, *calibrate, cwd=Path("/"), **nowhere)


def check_types(work: Path) -> str:
    """Check a user's script by pyright, besides mypy; `tests/test_types.py` skips pyright where it
    is not installed.

    Raises:
        FailedError: pyright cannot be installed, or finds a fault.
    """
    packages = packages_beside(work, PYRIGHT)
    path = os.pathsep.join([str(packages / "bin"), os.environ["PATH"]])
    test = (sys.executable, "-P", "-m", "pytest", "-q", "-p", "no:cacheprovider")
    return run_command(*test, "tests/test_types.py", PATH=path, PYTHONPATH=str(packages))


def check_shapes(work: Path) -> str:
    """Let trackers' packages write films in an environment of their own, and read these.

    Raises:
        FailedError: a package cannot be installed or write, or a film is read wrong.
    """
    shapes = runpy.run_path(str(ROOT / "scripts" / "shapes.py"))
    packages = [f"{name}=={version}" for name, version in shapes["PACKAGES"].items()]
    films = work / "films"
    films.mkdir()
    run_command(sys.executable, "-m", "venv", work / "venv")
    python = work / "venv" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    run_command(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages)
    run_command(python, "-W", "ignore", "scripts/shapes.py", "--write", films)
    return run_command(sys.executable, "-P", "scripts/shapes.py", films)


def python_of(version: str) -> str:
    """The Python of a version: that which runs this, one of PATH or of pyenv.

    Raises:
        FailedError: none has this version.
    """
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    of_pyenv = map(str, pyenv.glob(f"{version}.*/bin/python"))
    for python in (sys.executable, f"python{version}", *of_pyenv):
        if shutil.which(python):
            command = [python, "--version"]
            process = subprocess.run(command, capture_output=True, text=True, check=False)
            if process.stdout.startswith(f"Python {version}."):
                return python
    raise FailedError("not on this machine")


def check_versions(work: Path, version: str, end: str) -> str:
    """Run the quick tests in a new environment of this Python. At the end `lowest` it has the
    versions of packages that pyproject.toml states, else the newest.

    Raises:
        FailedError: no such Python, packages cannot be installed, or a test fails.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    requirements = [*project["dependencies"], *extras["parquet"], *extras["dask"]]
    if end == "lowest":
        requirements = [requirement.replace(">=", "==") for requirement in requirements]
    run_command(python_of(version), "-m", "venv", work / "venv")
    python = work / "venv" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    pip = (python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
    run_command(*pip, "--only-binary", ":all:", *requirements, *TOOLS)
    run_command(*pip, "hatchling")
    run_command(python, "-m", "hatchling", "build", "-t", "sdist", "-d", work)
    run_command(*pip, "--no-deps", "--no-build-isolation", next(work.glob("*.tar.gz")))
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
    files = [f"tests/test_{name}.py" for name in QUICK.split()]
    return run_command(*test, *files, NUMBA_CACHE_DIR=str(work))


def run_part(work: Path, name: str, *version_and_end: str) -> str:
    """Run a part in a folder; the last lines of its commands.

    Raises:
        FailedError: the part fails.
    """
    if name in COMMANDS:
        lines = [line.replace("WORK", str(work)) for line in COMMANDS[name]]
        # Examples of docstrings that take seconds are left out of the quick tests.
        return ", ".join(
            run_command(sys.executable, *line.split(), FITBALL_SLOW_EXAMPLES="1") for line in lines
        )
    if name == "versions":
        return check_versions(work, *version_and_end)
    checks = {
        "pages": check_pages,
        "readonly": check_readonly,
        "shapes": check_shapes,
        "site": check_site,
        "types": check_types,
    }
    return checks[name](work)


def main() -> int:
    """Run the parts and print a line for each; 1 where a part failed."""
    names = ("pages", *COMMANDS, "readonly", "shapes", "site", "types", "versions")
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
    arguments = parser.parse_args()
    chosen = names if "all" in arguments.parts else arguments.parts
    parts: list[tuple[str, ...]] = [(name,) for name in chosen if name != "versions"]
    if "versions" in chosen:
        pairs = itertools.product(arguments.python, arguments.end)
        parts += [("versions", *pair) for pair in pairs]
    failed = 0
    for part in parts:
        begun = time.monotonic()
        verdict = "ok"
        with tempfile.TemporaryDirectory(prefix="fitball-", ignore_cleanup_errors=True) as folder:
            try:
                words = run_part(Path(folder), *part)
            except FailedError as error:
                words = str(error)
                verdict = "FAILED"
                failed += 1
        seconds = time.monotonic() - begun
        line = f"{' '.join(part)}: {verdict} in {seconds:.0f} s: {words}"
        print(line.replace("\n", "\n    "), flush=True)
    print(f"{len(parts) - failed} passed, {failed} failed")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
