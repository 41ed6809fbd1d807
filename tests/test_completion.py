"""Tab completes: asked as bash asks, with the names that the registries know, and nothing heavy loaded for it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from test_house import HEAVY

from fitball.cli import known_names
from fitball.cli.completion import OFFERS, SHELLS, TABLES
from fitball.cli.main import main, make_parser

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
    "fitball calibrate mi": "mine.csv ",
    "fitball calibrate wang_t": "wang_topspin.csv ",
    "fitball calibrate deeper/": "deeper/two.CSV ",
    "fitball calibrate x.csv --model g": "grip-slip ",
    "fitball calibrate x.csv --closure normal=t": "total ",
    "fitball calibrate x.csv --model brody --closure ": "cor=line|cor=saturating",
    "fitball calibrate x.csv --fix mu": "mu=",
    "fitball calibrate x.csv --prior spin": "spin_sd=",
    "fitball calibrate x.csv --prior mu=literature:cl": "clay ",
    "fitball calibrate x.csv --config ": "deeper/|fits/|mine.toml",
    "fitball calibrate x.csv --seed ": "",
    "fitball compare x.csv --models brody,two-mass+torsion=f": "free ",
    "fitball simulate --impact v=3 --set mu": "mu=",
    "fitball plot fits/": "fits/mine",
    "fitball plot fits/mine cor": "corner ",
    "fitball export fits/mine --to pyt": "python ",
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
    answers = [line.rstrip() for line in done.stdout.split("\n")[:-1]]
    assert dict(zip(CASES, answers, strict=True)) == {line: answer.rstrip() for line, answer in CASES.items()}


@pytest.mark.parametrize(
    "words",
    ["calibrate x.csv --fix ", "calibrate x.csv --prior mu=", "plot fits/mine ", "compare x.csv --models brody,", ""],
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


def test_names_are_those_of_the_registries():
    from fitball.data.columns import LABELS
    from fitball.inference.problem.measurement_noise import SEPARATE, TIED
    from fitball.inference.problem.noise import KINDS
    from fitball.inference.problem.parameters import NOISE_SPECS
    from fitball.models.registry import MODELS, closure_options
    from fitball.studies.thesis.simulate_examples import EXAMPLES

    assert {name: closure_options(name) for name in MODELS} == known_names.CLOSURES
    assert tuple(NOISE_SPECS) == known_names.NOISE_PARAMETERS
    assert tuple(KINDS) == known_names.NOISES
    assert {TIED, SEPARATE} == set(known_names.VELOCITY_NOISES)
    assert set(known_names.LABELS) == set(LABELS) - {"id"}
    assert tuple(example.name for example in EXAMPLES) == known_names.EXAMPLES[:-1]
    assert all(ending == ending.lower() for ending in TABLES)


def test_what_is_offered_is_asked_for_somewhere():
    from fitball.cli.completion import _actions

    assert set(OFFERS) <= {action.dest for action in _actions(make_parser())}


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
