"""Examples in public docstrings run, and every public function has one."""

from __future__ import annotations

import doctest
import inspect

import pytest

import fitball

FUNCTIONS = [name for name in fitball.__all__ if inspect.isfunction(getattr(fitball, name))]
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def examples(name):
    """Doctests of a public name and of its public methods."""
    found = doctest.DocTestFinder().find(getattr(fitball, name), f"fitball.{name}", module=False)
    return [test for test in found if test.examples]


@pytest.fixture(scope="module")
def namespace(small_fit):
    """What examples may speak of: a quick fit and its folder."""
    return {"fitball": fitball, "folder": small_fit, "fit": fitball.load_fit(small_fit)}


@pytest.mark.parametrize("name", [name for name in fitball.__all__ if not name.startswith("__")])
def test_examples_of_public_names(name, namespace, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for test in examples(name):
        test.globs = dict(namespace)
        told = []
        doctest.DocTestRunner(optionflags=OPTIONS).run(test, out=told.append)
        assert not told, "".join(told)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_public_function_has_an_example(name):
    assert examples(name)
