"""Tab completes: asked as bash asks, with the names that the registries know, and nothing heavy loaded for it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from test_house import HEAVY

from fitball.cli.main import SHELLS, main

BIN = Path(sys.executable).parent
ASK = """source <(fitball completion bash)
while IFS= read -r COMP_LINE; do
  COMP_POINT=${#COMP_LINE}; COMP_TYPE=9; COMPREPLY=()
  _python_argcomplete fitball
  (IFS='|'; printf '%s\\n' "${COMPREPLY[*]}")
done
"""
CASES = {
    "fitball cali": "calibrate ",
    "fitball calibrate --mo": "--model ",
    "fitball calibrate mine.c": "mine.csv ",
    "fitball calibrate deeper/": "deeper/notes.md|deeper/two.CSV",
    "fitball calibrate x.csv --scene ": "deeper/|fits/|mine.csv|mine.png|mine.toml",
    "fitball datasets ch": "check ",
}


@pytest.fixture
def place(tmp_path):
    for name in ("mine.csv", "mine.toml", "mine.png", "deeper/two.CSV", "deeper/notes.md", "fits/mine/fit.json"):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    return tmp_path


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_bash_completes(place):
    done = subprocess.run(
        ["bash", "-c", ASK], cwd=place, input="".join(f"{line}\n" for line in CASES), text=True, capture_output=True,
        env={**os.environ, "PATH": f"{BIN}{os.pathsep}{os.environ['PATH']}"}, check=True,
    )  # fmt: skip
    # Where one answer is left, bash's own blank is part of it, or the shell puts it there.
    # Files come in the order of the folder.
    answers = [sorted(line.rstrip().split("|")) for line in done.stdout.split("\n")[:-1]]
    assert dict(zip(CASES, answers, strict=True)) == {line: text.rstrip().split("|") for line, text in CASES.items()}


@pytest.mark.parametrize(
    "words",
    ["calibrate --", "plot fits/mine --", "compare x.csv --m", "datasets ", ""],
)
def test_completing_loads_nothing_heavy(words):
    line = f"fitball {words}"
    code = (
        "import os, sys\nfrom fitball.cli.main import main\nos.dup2(1, 8)\nos.dup2(2, 9)\n"
        "try:\n    main([])\nexcept SystemExit:\n    pass\n"
        f"print('HEAVY', [name for name in {(*HEAVY, 'numpy')!r} if name in sys.modules])"
    )
    asked = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE_IFS": "|"}
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **asked}, capture_output=True, text=True, check=False
    )
    assert "|" in done.stdout and "HEAVY []" in done.stdout, done.stdout + done.stderr


@pytest.mark.parametrize("shell", SHELLS)
def test_every_shell_has_a_script(shell, capsys):
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert "fitball" in script
    if shutil.which(shell) is not None:
        assert subprocess.run([shell, "-n"], input=script, text=True, check=False).returncode == 0


def test_another_shell_is_named_with_a_suggestion(capsys):
    assert main(["completion", "bsh"]) == 2
    assert "unknown shell 'bsh': did you mean 'bash'?" in capsys.readouterr().err
