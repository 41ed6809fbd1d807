"""Damaged input of every kind: exit 0 or 2, no exception, no more text than one reads, no control characters."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from fitball.cli.main import main
from fitball.studies.fuzz.campaign import Finding, finding_text
from fitball.studies.fuzz.harness import complaints, make_case, run_case
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
