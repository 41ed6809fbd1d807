"""Damaged input of every kind: exit 0 or 2, no exception, no more text than one reads, no control characters."""

from __future__ import annotations

import os
import shutil
import threading
import warnings
from collections.abc import Sequence
from pathlib import Path

import pytest

from fitball.cli import validate
from fitball.cli.main import main
from fitball.data.grid_text import parse_grid
from fitball.data.impact_text import parse_uncertain_impact
from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.inference.problem.priors import parse_prior
from fitball.studies.fuzz import campaign, examples
from fitball.studies.fuzz.campaign import Finding, finding_text
from fitball.studies.fuzz.harness import Case, Main, Target, complaints, make_case, run_case
from fitball.studies.fuzz.targets import all_targets


@pytest.mark.parametrize("name", all_targets())
def test_damaged_input_is_used_or_refused(name: str, small_fit: Path, tmp_path: Path) -> None:
    target = all_targets(lambda folder: shutil.copytree(small_fit, folder))[name]
    valid = tmp_path / "valid"
    valid.mkdir()
    target.build(valid)
    found = []
    for index in range(target.few):
        case = make_case(target, valid, tmp_path / str(index), 1, index)
        ending = run_case(case, main)
        said = complaints(target, case, ending)
        if said:
            found.append(finding_text(Finding(case, tuple(said), ending.error)))
    assert not found, "\n".join(found)


def explode(_words: Sequence[str]) -> int:
    return 1 // 0


def chatter(_words: Sequence[str]) -> int:
    print("x" * 30_000)
    return 0


def steer(_words: Sequence[str]) -> int:
    print("\x1b[2J")
    return 0


def warn(_words: Sequence[str]) -> int:
    warnings.warn("overflow", RuntimeWarning, stacklevel=1)
    return 0


def fail(_words: Sequence[str]) -> int:
    raise SystemExit("no")


def sulk(_words: Sequence[str]) -> int:
    return 2


def behave(_words: Sequence[str]) -> int:
    return 0


def die(_words: Sequence[str]) -> int:
    os._exit(3)


def hang(_words: Sequence[str]) -> int:
    threading.Event().wait()
    return 0


def case_of(folder: Path) -> tuple[Target, Case]:
    target = all_targets()["scene"]
    (folder / "valid").mkdir()
    target.build(folder / "valid")
    return target, make_case(target, folder / "valid", folder / "case", 1, 0)


@pytest.mark.parametrize(
    ("main", "words"),
    [
        (explode, "exception: ZeroDivisionError"),
        (chatter, "30001 characters of text"),
        (steer, "control characters on the terminal: U+001B"),
        (warn, "a warning of a library"),
        (fail, "exit 1"),
        (sulk, "exit 2 without a word"),
    ],
)
def test_the_rule_has_teeth(main: Main, words: str, tmp_path: Path) -> None:
    target, case = case_of(tmp_path)
    (said,) = complaints(target, case, run_case(case, main))
    assert words in said


def test_cases_are_told_by_seed_and_index_alone(tmp_path: Path) -> None:
    target, case = case_of(tmp_path)
    again = make_case(target, tmp_path / "valid", tmp_path / "again", 1, 0)
    make_case(target, tmp_path / "valid", tmp_path / "other", 1, 1)
    assert (again.damage, again.words[0]) == (case.damage, case.words[0])
    scenes = [(tmp_path / name / "impacts.toml").read_bytes() for name in ("case", "again", "other", "valid")]
    assert scenes[0] == scenes[1] and len(set(scenes)) == 3
    assert complaints(target, case, run_case(case, behave)) == []


@pytest.mark.parametrize(
    ("main", "seconds", "memory", "words"),
    [
        (die, 600.0, campaign.MOST_BYTES, "the process died: exit code 3"),
        (behave, 600.0, 1, "GB of memory"),
        # However slow the machine, it never comes back.
        (hang, 0.1, campaign.MOST_BYTES, "over 0.1 s"),
    ],
)
def test_a_campaign_survives_and_tells(
    main: Main, seconds: float, memory: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaign, "MOST_SECONDS", seconds)
    monkeypatch.setattr(campaign, "MOST_BYTES", memory)
    told: list[int] = []
    found = campaign.run_target(all_targets()["scene"], 1, 2, tmp_path, main, told.append)
    assert [item.case.index for item in found] == [0, 1] and told == [1, 2]
    assert all(words in " ".join(item.complaints) for item in found)
    assert sorted(item.name for item in (tmp_path / "cases").iterdir()) == ["scene_0", "scene_1"]
    assert words in finding_text(found[0])


def test_validate_fuzz_tells_how_many(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--fuzz", "2", "--targets", "scene,force", "--out", str(tmp_path), "--quiet"]
    assert validate.main(words) == 0
    assert "scene: 2 cases, 0 broke the rule" in (text := capsys.readouterr().out)
    assert "4 cases (seed 1), 0 broke the rule" in text
    assert validate.main(["--fuzz", "2", "--targets", "scenes"]) == 2
    assert "did you mean 'scene'" in capsys.readouterr().err


def test_examples_are_valid_before_they_are_damaged(tmp_path: Path, small_fit: Path) -> None:
    for text in (*examples.IMPACTS, *examples.POINTS):
        parse_uncertain_impact(text)
    for text in examples.GRIDS:
        parse_grid(text)
    for text in examples.PRIORS:
        name, _, prior = text.partition("=")
        parse_prior(name, prior, 0.0, 10.0)
    targets = all_targets(lambda folder: shutil.copytree(small_fit, folder))
    for name, target in targets.items():
        folder = tmp_path / name
        folder.mkdir()
        target.build(folder)
        for table in (*folder.glob("table*"), *folder.glob("impacts.csv")):
            load_table(table)
    load_scene(tmp_path / "scene" / "impacts.csv")
    assert main(["datasets", "check", str(tmp_path / "force" / "impacts.csv")]) == 0
    port = tmp_path / "port"
    assert main(["verify", str(port / "port.csv"), "--fit", str(port / "fit"), "--quiet"]) == 0
