"""What a user's editor and type checker see of the package."""

import ast
import inspect
import pydoc
import re
import rlcompleter
import shutil
import subprocess
import sys
import typing
from importlib.resources import files
from pathlib import Path

import pytest

import fitball

# A line a mistake, with what a checker must say of it; all other lines are right.
SCRIPT = """\
import fitball
from fitball import Fit, Frames

fit: Fit = fitball.calibrate("wang_all", model="two-mass", fix={"mu": 0.5}, point_only=True)
predicted: Frames = fit.predict(impact="v_1=17, theta_1=20 deg")
frame = predicted.frames["predictions"]
text: str = fit.report(full=False)
compared: Frames = fit.compare(models="two-mass,brody", quick=True)
paths = fit.save("folder")
first = paths[0].name.upper()
fitball.calibrate("wang_all", point_onyl=True)  # wrong
fit.predict(impct="v_1=17, theta_1=20 deg")  # wrong
fit.plan(count="5")  # wrong
fit.simulate()  # wrong
fitball.predict("folder").reports()  # wrong
fitball.load_fit(3)  # wrong
fitball.calibrated  # wrong
"""
WRONG = [number for number, line in enumerate(SCRIPT.splitlines(), 1) if line.endswith("# wrong")]
FUNCTIONS = [name for name in fitball.__all__ if inspect.isfunction(getattr(fitball, name))]
CLASSES = [name for name in fitball.__all__ if inspect.isclass(getattr(fitball, name))]


@pytest.fixture
def script(tmp_path):
    """A user's script in a folder of its own."""
    place = tmp_path / "script.py"
    place.write_text(SCRIPT)
    return place


def lines_with_errors(printed):
    """Numbers of the lines of the script that a checker calls errors."""
    found = re.findall(r"script\.py:(\d+)(?::\d+)?(?: -)?:? error", printed)
    return sorted({int(number) for number in found})


def test_mypy_sees_mistakes_of_a_user_and_no_others(script, tmp_path):
    # Others' types take half of the time, and have no part in this.
    packages = "matplotlib.*,numba.*,pandas.*,scipy.*,xarray.*"
    config = tmp_path / "mypy.ini"
    config.write_text(f"[mypy]\n[mypy-{packages}]\nfollow_imports = skip\n")
    options = ["--strict", "--config-file", str(config), "--cache-dir", str(tmp_path / "cache")]
    command = [sys.executable, "-P", "-m", "mypy", *options, script.name]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert lines_with_errors(run.stdout) == WRONG, run.stdout + run.stderr


@pytest.mark.skipif(not shutil.which("pyright"), reason="pyright is not installed")
def test_pyright_sees_mistakes_of_a_user_and_no_others(script, tmp_path):
    command = ["pyright", "--pythonpath", sys.executable, script.name]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert lines_with_errors(run.stdout) == WRONG, run.stdout + run.stderr


def test_the_package_says_that_it_has_types():
    assert files("fitball").joinpath("py.typed").is_file()


@pytest.mark.parametrize("name", FUNCTIONS)
def test_hints_of_a_public_function_resolve(name):
    function = getattr(fitball, name)
    hints = typing.get_type_hints(function)
    assert set(inspect.signature(function).parameters) <= set(hints)
    assert not any(isinstance(hint, str | typing.ForwardRef) for hint in hints.values())


@pytest.mark.parametrize("name", CLASSES)
def test_hints_of_methods_of_a_public_class_resolve(name):
    for _, member in inspect.getmembers(getattr(fitball, name), inspect.isfunction):
        if not member.__name__.startswith("__"):
            typing.get_type_hints(member)


def test_hints_name_what_is_returned():
    assert typing.get_type_hints(fitball.calibrate)["return"] is fitball.Fit
    assert typing.get_type_hints(fitball.predict)["return"] is fitball.Frames
    assert typing.get_type_hints(fitball.Fit.compare)["return"] is fitball.Frames


def test_public_names_are_those_that_checkers_completions_and_dir_see():
    tree = ast.parse(Path(fitball.__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    imported = {alias.name for node in block.body for alias in node.names}
    assert {*imported, "__version__"} == {*fitball.__all__}
    assert [*imported - {*fitball._HOME_OF}] == []
    assert dir(fitball) == sorted(fitball.__all__)
    completer = rlcompleter.Completer({"fitball": fitball})
    assert completer.complete("fitball.calib", 0) == "fitball.calibrate("


def test_help_of_the_package_and_of_a_verb():
    text = pydoc.render_doc(fitball, renderer=pydoc.plaintext)
    assert 'fitball.calibrate("my_balls.csv")' in text
    text = pydoc.render_doc(fitball.calibrate, renderer=pydoc.plaintext)
    assert "point_only" in text
    assert "-> 'Fit'" in text
