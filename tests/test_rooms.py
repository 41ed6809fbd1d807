"""The rooms of the package: who may import whom, held by import-linter; and what each room says of itself."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
CONTRACTS = [contract["name"] for contract in SETTINGS["tool"]["importlinter"]["contracts"]]
# For each contract a module and what it must not import.
BREAKS = {
    "Information flows one way": ("fitball.data.table", "fitball.report.form.numbers"),
    "Inference: what is asked, how probable, what is found, what follows": (
        "fitball.inference.problem.priors", "fitball.inference.likelihood.residuals",
    ),
    "Report: shapes, then files and figures, then each verb's own words": (
        "fitball.report.form.files", "fitball.report.saved.structure",
    ),
    "Models: kernels, faces, registry": ("fitball.models.types", "fitball.models.registry"),
    "Only figures draw": ("fitball.inference.results.results", "matplotlib"),
    "Only the minimiser knows lmfit": ("fitball.inference.point.point_fit", "lmfit"),
    "Only sampling knows emcee": ("fitball.inference.point.point_fit", "emcee"),
    "Only scheduling starts processes, by joblib or Dask": ("fitball.report.batch.document", "joblib"),
    "Models need numpy and numba only, their oracle scipy and mpmath too": ("fitball.models.model", "pandas"),
}  # fmt: skip
ROOMS = sorted(place.parent for place in (ROOT / "fitball").rglob("__init__.py") if place.parent.name != "fitball")
# What every module may use.
OPEN_TO_ALL = {
    "environment", "errors", "files", "kinds", "observables", "values", "version",
    "visible", "wording",
}  # fmt: skip


@pytest.fixture
def copied(tmp_path):
    """The tree, to be spoilt."""
    shutil.copytree(ROOT / "fitball", tmp_path / "fitball", ignore=shutil.ignore_patterns("__pycache__", "*.html.j2"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def lint(place):
    """What import-linter says of a tree, by contract."""
    linter = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run([linter, "--no-cache"], cwd=place, capture_output=True, text=True, check=False)
    verdicts = dict(re.findall(r"^(.+?) (KEPT|BROKEN)\b", done.stdout, re.MULTILINE))
    details = re.split(r"\n([^\n]+)\n-+\n", done.stdout.partition("Broken contracts")[2])
    return verdicts, dict(zip(details[1::2], details[2::2], strict=True)), done


@pytest.mark.parametrize("guard", ["", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    "])
def test_each_contract_is_broken_by_what_it_forbids(copied, guard):
    """Also where only a type checker would see it."""
    assert list(BREAKS) == CONTRACTS
    for module, forbidden in BREAKS.values():
        place = (copied / module.replace(".", "/")).with_suffix(".py")
        place.write_text(f"{place.read_text('utf-8')}\n{guard}import {forbidden}\n", encoding="utf-8")
    verdicts, details, done = lint(copied)
    assert verdicts == dict.fromkeys(CONTRACTS, "BROKEN"), done.stdout + done.stderr
    for name, (module, forbidden) in BREAKS.items():
        assert f"{module} -> {forbidden}" in details[name], name


def test_a_room_without_a_place_in_its_layers_is_refused(copied):
    for folder in ("inference", "report", "models"):
        (copied / "fitball" / folder / "attic").mkdir()
        (copied / "fitball" / folder / "attic" / "__init__.py").touch()
    verdicts, _details, done = lint(copied)
    assert [name.partition(":")[0] for name, verdict in verdicts.items() if verdict == "BROKEN"] == [
        "Inference", "Report", "Models",
    ], done.stdout + done.stderr  # fmt: skip


def imported(room):
    """Other rooms that modules of this one import, those within it aside."""
    inner = [place for place in ROOMS if room in place.parents]
    found = set()
    for module in room.rglob("*.py"):
        if not any(place in module.parents for place in inner):
            for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("fitball."):
                    found.add(node.module)
    return {name.removeprefix("fitball.") for name in found if not f"{name}.".startswith(f"{name_of(room)}.")}


def stands(place):
    """Whether there is such a room or module."""
    return place.is_dir() or place.with_suffix(".py").is_file()


def name_of(room):
    return ".".join(room.relative_to(ROOT).parts)


@pytest.mark.parametrize("room", ROOMS, ids=name_of)
def test_a_room_says_what_it_is_for_what_it_offers_and_whom_it_may_import(room):
    text = ast.get_docstring(ast.parse((room / "__init__.py").read_text(encoding="utf-8")))
    said = re.fullmatch(
        r"(?P<purpose>.{40,})\n\nOffers: (?P<offers>.+)\nMay import: (?P<rooms>.+)\.", text, re.DOTALL
    )
    assert said, text
    allowed = OPEN_TO_ALL | (set() if said["rooms"] == "nothing else" else set(re.split(r",\s", said["rooms"])))
    for name in imported(room):
        assert any(f"{name}.".startswith(f"{one}.") for one in allowed), name
    for one in allowed:
        assert stands(ROOT / "fitball" / one.replace(".", "/")), one
    names = re.findall("`([A-Za-z_]+)`", said["offers"])
    assert names
    inside = "\n".join(module.read_text(encoding="utf-8") for module in room.rglob("*.py"))
    for name in names:
        defined = re.search(rf"^(?:def|class) {name}\b|^{name}\b.*=", inside, re.MULTILINE)
        assert defined or stands(room / name) or name == "fitball", name
