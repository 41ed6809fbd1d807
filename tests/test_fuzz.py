"""Damaged input of every kind: exit 0 or 2, no exception, no more text than one reads, no control characters.

`--fuzz N` damages each kind of input N times.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import pytest
from fuzz import examples
from fuzz.batch_folders import of_a_batch
from fuzz.contended import contended
from fuzz.file_names import file_names
from fuzz.harness import findings, make_case
from fuzz.saved_files import of_a_fit
from fuzz.surroundings import run_in_shell, surroundings
from fuzz.user_files import hand_written
from fuzz.workbooks import workbooks

from fitball.cli.main import main
from fitball.data.lines import parse_grid, parse_uncertain_impact
from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.inference.problem.parameters import parse_prior

NAMES = [target.name for target in (*hand_written(), *of_a_fit(Path()), *of_a_batch(Path()))]


@pytest.fixture
def targets(small_fit, monkeypatch):
    # Figures of batches draw what was read, slowly; one population is read as all are.
    monkeypatch.setattr("fitball.report.batch.document.default_names", lambda _series: ())
    monkeypatch.setattr("fitball.report.batch.figure.batch_figure", lambda *_given, **_others: None)
    monkeypatch.setattr("fitball.report.figures.canvas.save_figure", lambda *_given: b"")
    return {target.name: target for target in (*hand_written(), *of_a_fit(small_fit), *of_a_batch(small_fit))}


def built(target, folder):
    """The folder of its valid input."""
    valid = folder / "valid" / target.name
    valid.mkdir(parents=True)
    target.build(valid)
    return valid


@pytest.mark.parametrize("name", NAMES)
def test_damaged_input_is_used_or_refused(name, targets, tmp_path, pytestconfig):
    target = targets[name]
    cases = pytestconfig.getoption("fuzz") or target.few
    found = findings(target, built(target, tmp_path), tmp_path, main, cases)
    assert not found, "\n".join(found)


@pytest.mark.parametrize("make", [file_names, workbooks])
def test_a_table_may_be_called_and_kept_as_it_likes(make, tmp_path, pytestconfig):
    target = make()
    cases = pytestconfig.getoption("fuzz") or target.few
    found = findings(target, built(target, tmp_path), tmp_path, main, cases)
    assert not found, "\n".join(found)


@pytest.mark.skipif(sys.platform == "win32", reason="redirections of a shell")
@pytest.mark.parametrize("make", [surroundings, contended])
def test_no_surroundings_end_in_a_traceback(make, tmp_path, pytestconfig):
    """Nor do others who write into the same folder."""
    target = make()
    cases = pytestconfig.getoption("fuzz") or target.few
    found = findings(target, built(target, tmp_path), tmp_path, run_in_shell, cases)
    assert not found, "\n".join(found)


def explode(_words):
    return 1 // 0


def chatter(_words):
    print("x" * 30_000)
    return 0


def steer(_words):
    print("\x1b[2J")
    return 0


def warn(_words):
    warnings.warn("overflow", RuntimeWarning, stacklevel=1)
    return 0


def fail(_words):
    raise SystemExit("no")


@pytest.mark.parametrize(
    ("main", "words"),
    [
        (explode, "exception: ZeroDivisionError"),
        (chatter, "30001 characters of text"),
        (steer, "control characters on the terminal: U+001B"),
        (warn, "a warning of a library"),
        (fail, "exit 1"),
        (lambda _words: 2, "exit 2 without a word"),
    ],
)
def test_the_rule_has_teeth(main, words, targets, tmp_path):
    valid = built(targets["scene"], tmp_path)
    (said,) = findings(targets["scene"], valid, tmp_path, main, 1)
    assert words in said and "fitball " in said
    # What broke the rule can be looked at, what kept it is gone.
    assert (tmp_path / "0" / "impacts.toml").exists()
    assert findings(targets["scene"], valid, tmp_path / "kept", lambda _words: 0, 1) == []
    assert list((tmp_path / "kept").iterdir()) == []


def test_cases_are_told_by_their_index_alone(targets, tmp_path):
    target = targets["scene"]
    valid = built(target, tmp_path)
    case, again, _other = (
        make_case(target, valid, tmp_path / str(number), index) for number, index in enumerate((0, 0, 1))
    )
    assert (again.damage, again.words[0]) == (case.damage, case.words[0])
    scenes = [(folder / "impacts.toml").read_bytes() for folder in (*(tmp_path / str(k) for k in range(3)), valid)]
    assert scenes[0] == scenes[1] and len(set(scenes)) == 3


def test_examples_are_valid_before_they_are_damaged(targets, tmp_path):
    for text in (*examples.IMPACTS, *examples.POINTS):
        parse_uncertain_impact(text)
    for text in examples.GRIDS:
        parse_grid(text)
    for text in examples.PRIORS:
        name, _, prior = text.partition("=")
        parse_prior(name, prior, 0.0, 10.0)
    for target in targets.values():
        folder = built(target, tmp_path)
        for table in (*folder.glob("table*"), *folder.glob("impacts.csv")):
            load_table(table)
    valid = tmp_path / "valid"
    load_scene(valid / "scene" / "impacts.csv")
    assert main(["datasets", "check", str(valid / "force" / "impacts.csv")]) == 0
    assert main(["verify", str(valid / "port" / "port.csv"), "--fit", str(valid / "port" / "fit"), "--quiet"]) == 0
