"""Pinned packages: what a user needs is in one list, what developers need besides in another, and
what the manual and notebooks are made with in a third.
"""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
# Runs the command line with none of the packages that are named first.
WITHOUT = """
import sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in absent:
            raise ModuleNotFoundError(f"no {name} for users", name=name)

absent = set(sys.argv[1].split(","))
sys.meta_path.insert(0, Absent())
from fitball import cli
sys.exit(cli.main(sys.argv[2:]))
"""


def pinned(name):
    """Versions in a lock, by name of package."""
    versions = {}
    for line in (ROOT / name).read_text(encoding="utf-8").splitlines():
        package, equals, version = line.partition("==")
        assert equals, line
        assert re.fullmatch(r"[\w.]+", version), line
        assert canonicalize_name(package) not in versions, line
        versions[canonicalize_name(package)] = version
    return versions


USER = pinned("requirements.lock")
DEVELOPER = pinned("requirements-dev.lock")
MANUAL = pinned("requirements-docs.lock")
# Extras of what the manual and notebooks are made with.
MANUAL_EXTRAS = ("docs", "notebooks")


def needed(texts):
    """Names of packages that requirements name, and of all that these require."""
    names = set()
    waiting = [Requirement(text) for text in texts]
    while waiting:
        name = canonicalize_name(waiting.pop().name)
        if name in names:
            continue
        names.add(name)
        try:
            further = [Requirement(text) for text in requires(name) or []]
        except PackageNotFoundError:
            # Of one that is not installed here no requirements can be read.
            continue
        waiting += [
            one for one in further if one.marker is None or one.marker.evaluate({"extra": ""})
        ]
    return names


def test_a_package_is_pinned_once():
    assert not {*USER} & {*DEVELOPER}
    assert not {*USER, *DEVELOPER} & {*MANUAL}


def test_users_get_what_the_package_and_its_build_require_and_no_more():
    required = needed(PROJECT["project"]["dependencies"] + PROJECT["build-system"]["requires"])
    assert {*USER} == required


def test_developers_get_the_rest():
    extras = PROJECT["project"]["optional-dependencies"]
    chosen = [texts for name, texts in extras.items() if name not in MANUAL_EXTRAS]
    required = needed([text for texts in chosen for text in texts])
    assert required <= {*USER, *DEVELOPER}


def test_the_manual_is_made_with_pinned_packages():
    extras = PROJECT["project"]["optional-dependencies"]
    required = needed([text for name in MANUAL_EXTRAS for text in extras[name]])
    assert required <= {*USER, *DEVELOPER, *MANUAL}
    assert {"sphinx", "furo", "jupytext", "nbclient"} <= {*MANUAL}


def test_the_main_job_needs_none_of_the_packages_for_developers(tmp_path):
    distributions = packages_distributions()
    absent = [
        name
        for name, owners in distributions.items()
        if {canonicalize_name(owner) for owner in owners} <= {*DEVELOPER}
    ]
    if "pytest" not in absent:
        pytest.skip("the packages for developers are not installed here")
    words = ["calibrate", "wang_zero_spin", "--model", "brody", "--out", "fit", "--figures", "all"]
    for command in (words, ["export", "fit", "--to", "json"], ["predict", "fit", "wang_all"]):
        run = subprocess.run(
            [sys.executable, "-c", WITHOUT, ",".join(absent), *command],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
        assert run.returncode == 0, run.stderr[-2000:]
