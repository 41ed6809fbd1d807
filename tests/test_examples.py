"""Examples in the docstrings of public names run, as a reader would type them."""

import doctest
import inspect
import os
from functools import cached_property

import pytest

import fitball
from fitball import cli

# Examples that take seconds or more: they run where FITBALL_SLOW_EXAMPLES is set.
SLOW = {
    "Fit.compare",
    "Fit.plan",
    "Fit.to_datatree",
    "bench",
    "compare",
    "plan",
    "rederive",
}


def members(cls):
    """Names and documented members of a class that fitball defines, inherited ones included."""
    for name in dir(cls):
        member = inspect.getattr_static(cls, name)
        member = getattr(member, "__func__", member)
        home = next(base for base in cls.__mro__ if name in vars(base))
        ours = home.__module__.startswith("fitball.") and not name.startswith("_")
        if ours and (inspect.isfunction(member) or isinstance(member, property | cached_property)):
            yield name, member


def documented():
    """Docstrings of public functions and classes, of their methods and properties, by name: a
    member under the class that defines it, if that is public.
    """
    docstrings = {}
    for name in fitball.__all__:
        thing = getattr(fitball, name)
        if inspect.isfunction(thing) or inspect.isclass(thing):
            docstrings[name] = inspect.getdoc(thing) or ""
        for member_name, member in members(thing) if inspect.isclass(thing) else ():
            home = next(cls for cls in thing.__mro__ if member_name in vars(cls)).__name__
            owner = home if home in fitball.__all__ else name
            docstrings[f"{owner}.{member_name}"] = inspect.cleandoc(member.__doc__ or "")
    return docstrings


DOCSTRINGS = documented()
WITH = sorted(name for name, docstring in DOCSTRINGS.items() if ">>>" in docstring)


def failures(docstring):
    """What a run of the examples of a docstring prints against what it says; empty if they agree.
    No name is defined at their begin, as where a reader copies them to.
    """
    options = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    example = doctest.DocTestParser().get_doctest(docstring, {}, "example", None, None)
    printed = []
    doctest.DocTestRunner(optionflags=options, verbose=False).run(example, out=printed.append)
    return "".join(printed)


@pytest.mark.parametrize("name", WITH)
def test_an_example_prints_what_it_says(name, tmp_path, monkeypatch):
    if name in SLOW and not os.environ.get("FITBALL_SLOW_EXAMPLES"):
        pytest.skip("takes seconds")
    monkeypatch.chdir(tmp_path)
    docstring = DOCSTRINGS[name]
    assert "Example:\n    >>> " in docstring, "examples are in a section `Example:`"
    assert failures(docstring) == ""


def test_every_public_name_has_an_example():
    assert [name for name in DOCSTRINGS if name not in WITH] == []


def test_a_wrong_example_is_seen():
    assert failures("Example:\n    >>> 1 + 1\n    2\n") == ""
    assert "Got:\n    2" in failures("Example:\n    >>> 1 + 1\n    3\n")


def test_examples_of_python_are_not_in_the_help_of_the_command_line():
    for verb in cli.VERBS.values():
        words = cli.help_of(verb)
        assert ">>>" not in "".join([words.summary, words.text, words.examples])
        assert not any(">>>" in text for _, text in words.arguments.values())
