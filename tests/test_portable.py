"""What is promised beyond this machine: systems, versions, the source archive, and what tests need besides Python."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import warnings
from functools import cache
from pathlib import Path

import mypy
import pytest
import versions
import yaml

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
SOURCES = sorted((ROOT / "fitball").rglob("*.py"))
# Texts that only some systems understand, and the files that look there and do without where nothing is found.
POSIX_TEXTS = {
    r"^/(tmp|var|etc|home|usr)\b": (),
    r"^/(dev|proc)/|\"/(dev|proc)/": ("bench/clock.py", "bench/measure.py", "files.py"),
    r"(?<!\w)%-[a-zA-Z]": (),
    r"^/[\w.-]+\.\w+$": (),
}


def system_bound(text, name="new.py"):
    """Texts and calls of a module that another system would not understand, or would read in another encoding."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            if any(re.search(pattern, node.value) and name not in known for pattern, known in POSIX_TEXTS.items()):
                found.append((node.lineno, node.value))
        elif isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            words = [ast.unparse(word) for word in node.args] + [word.arg for word in node.keywords]
            binary = any(re.fullmatch(r"'[rwax]*b[rwax+]*'", word or "") for word in words)
            text_file = re.search(r"(^open|\.read_text|\.write_text)$", called)
            path_shown = called.endswith(".relative_to") and f"{ast.unparse(node)}." not in text
            if path_shown or (text_file and "encoding" not in words and not binary):
                found.append((node.lineno, called))
    return found


def test_sources_hold_nothing_that_only_one_system_understands():
    found = {name: system_bound(file.read_text(encoding="utf-8"), name) for file in SOURCES
             if (name := file.relative_to(ROOT / "fitball").as_posix())}  # fmt: skip
    assert {name: lines for name, lines in found.items() if lines} == {}


@pytest.mark.parametrize(
    "line",
    ["open('x')", "p.read_text()", "p.write_text(t)", "x = '/tmp'", "f'{t:%-d}'", "folder + '/fit.json'",
     "f'{p.relative_to(q)}'", "x = '/proc/self/stat'", "open('x', 'w')"],
)  # fmt: skip
def test_such_lines_are_found(line):
    assert system_bound(line)


def differs_by_system(module):
    """Whether the type checker knows parts of a module of Python that only some systems have."""
    stubs = Path(mypy.__file__).parent / "typeshed" / "stdlib"
    top = module.partition(".")[0]
    files = [stubs / f"{top}.pyi", *(stubs / top).rglob("*.pyi")]
    return any("sys.platform" in file.read_text(encoding="utf-8") for file in files if file.is_file())


def imported(text):
    """Modules that a text imports."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from (item.name for item in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module


def faults(system, files):
    """What the type checker says of files, each apart from other packages."""
    words = ["--config-file=", "--platform", system, "--python-version", "3.11", "--follow-imports", "skip"]
    words += ["--ignore-missing-imports", "--cache-dir", os.devnull]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *words, *map(str, files)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout, done.stderr
    return {line for line in done.stdout.splitlines() if ": error:" in line}


@pytest.mark.slow
def test_calls_of_the_system_are_there_on_others(tmp_path):
    """What Python has on each system the type checker knows: os.fork, fcntl, signal.SIGKILL and others are errors."""
    bound = cache(differs_by_system)
    files = [file for file in SOURCES if any(map(bound, imported(file.read_text(encoding="utf-8"))))]
    assert 40 < len(files) < len(SOURCES)
    # A control: calls that only POSIX has.
    wrong = tmp_path / "wrong.py"
    wrong.write_text("import fcntl, os, signal\n\nfcntl.flock(1, 2)\nos.kill(os.fork(), signal.SIGKILL)\n", "utf-8")
    here = faults("linux", [*files, wrong])
    for system, count in (("win32", 3), ("darwin", 0)):
        new = faults(system, [*files, wrong]) - here
        assert len([line for line in new if "wrong.py" in line]) == count
        assert [line for line in new if "wrong.py" not in line] == []


@pytest.mark.parametrize(("module", "ours"), [("matplotlib.mathtext", False), ("fitball.values", True)])
def test_only_our_own_use_of_what_will_go_is_a_fault(module, ours):
    given = (DeprecationWarning("it goes"), None, "file.py", 1, module)
    if ours:
        with pytest.raises(DeprecationWarning):
            warnings.warn_explicit(*given)
    else:
        warnings.warn_explicit(*given)


def test_a_forge_would_run_every_python_and_both_ends_of_the_versions():
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "tests.yml").read_text(encoding="utf-8"))["jobs"]
    matrix = jobs["versions"]["strategy"]["matrix"]
    known = [words.rpartition(" ")[2] for words in PROJECT["classifiers"] if re.search(r":: 3\.\d", words)]
    assert matrix["python"] == list(versions.PYTHONS) == known
    assert matrix["versions"] == list(versions.VERSIONS)
    assert [name.partition("-")[0] for name in matrix["os"]] == ["ubuntu", "macos", "windows"]
    for job in jobs.values():
        assert "steps" in job and "runs-on" in job
        for step in job["steps"]:
            for place in re.findall(r"scripts/[\w.]+", step.get("run", "")):
                assert (ROOT / place).is_file()


def test_floors_are_versions():
    assert [line for line in versions.required("lowest") if not re.fullmatch(r"[\w-]+==\d+(\.\d+)*", line)] == []


def test_the_source_archive_has_what_its_scripts_and_tests_need(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(tmp_path)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as packed:
        names = {name.partition("/")[2] for name in packed.getnames()}
    wanted = {"requirements.lock", "pyproject.toml", ".github/workflows/tests.yml", ".ci/run", ".gitignore"}
    for top in ("fitball", "scripts", "tests", "datasets", "docs"):
        wanted |= {
            file.relative_to(ROOT).as_posix() for file in (ROOT / top).rglob("*")
            if file.is_file() and not {"__pycache__", "_made"} & set(file.parts)
        }  # fmt: skip
    assert wanted - names == set()


def test_what_was_skipped_for_want_of_a_program_is_said_at_the_end():
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k",
         "keeps_what_python_means or twenty_phases", "tests/test_export_translator.py"],
        cwd=ROOT, capture_output=True, text=True, check=False, env={**os.environ, "PATH": ""},
    )  # fmt: skip
    *_others, compiler, node, last = done.stdout.splitlines()
    assert "no C compiler: 1. To run them, install gcc" in compiler and "no node: 1." in node, done.stdout
    assert last.startswith("2 skipped")
