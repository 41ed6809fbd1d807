"""What strangers meet first: one version, templates that can be read, what is published."""

import re
from pathlib import Path

import pytest
import yaml
from support.scripts import script

import fitball

ROOT = Path(__file__).resolve().parent.parent
FORGE = ROOT / ".github"

nightly = script("nightly")
release = script("try_release")


def test_version_citation_and_changelog_agree():
    version = release.stated_version("")
    assert version == fitball.__version__
    heads = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    # The newest stands first.
    assert heads[0] == version


def test_a_tag_of_another_version_is_refused():
    assert release.stated_version(f"v{fitball.__version__}") == fitball.__version__
    with pytest.raises(release.TrialError, match=r"tag v2\.9"):
        release.stated_version("v2.9")


def test_a_wheel_and_an_sdist_of_the_version_are_tried(tmp_path):
    (tmp_path / "fitball-3.0.0.tar.gz").touch()
    (tmp_path / "fitball-2.0.0-py3-none-any.whl").touch()
    with pytest.raises(release.TrialError, match="expected a wheel and an sdist"):
        release.files_of(tmp_path, "3.0.0")
    (tmp_path / "fitball-3.0.0-py3-none-any.whl").touch()
    names = [file.name for file in release.files_of(tmp_path, "3.0.0")]
    assert names == ["fitball-3.0.0-py3-none-any.whl", "fitball-3.0.0.tar.gz"]


def test_a_command_that_fails_says_what_it_said(tmp_path):
    with pytest.raises(release.TrialError, match="exit code 3\nspoilt"):
        release.call("sh", "-c", "echo spoilt; exit 3", cwd=tmp_path)


@pytest.mark.parametrize("name", ["tests", "release"])
def test_each_python_is_tried_on_each_system(name):
    jobs = yaml.safe_load((FORGE / f"workflows/{name}.yml").read_text("utf-8"))["jobs"]
    matrix = jobs["versions" if name == "tests" else "try"]["strategy"]["matrix"]
    assert tuple(matrix["python"]) == nightly.PYTHONS
    assert {system.partition("-")[0] for system in matrix["os"]} == {"ubuntu", "macos", "windows"}


def test_only_the_last_job_may_publish():
    workflow = yaml.safe_load((FORGE / "workflows/release.yml").read_text("utf-8"))
    jobs = workflow["jobs"]
    may = {name for name, job in jobs.items() if "id-token" in job.get("permissions", {})}
    assert may == {"publish"}
    assert {*jobs["publish"]["needs"]} == {*jobs} - may
    assert workflow["permissions"] == {"contents": "read"}


def test_forms_of_issues_ask_for_something():
    forms = sorted(FORGE.glob("ISSUE_TEMPLATE/[!c]*.yml"))
    assert len(forms) == 3
    for form in forms:
        page = yaml.safe_load(form.read_text("utf-8"))
        assert page["name"]
        assert page["description"]
        required = [part.get("validations", {}).get("required", False) for part in page["body"]]
        assert any(required), form.name
        names = [part["id"] for part in page["body"]]
        assert len(names) == len({*names})
