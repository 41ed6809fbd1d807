"""Hints in a notebook are calls of Python with the arguments of the command."""

import ast
import inspect

import pytest

import fitball
from fitball.report.blocks import Report, Text
from fitball.report.calls import call_of, with_calls
from fitball.report.render import to_notebook, to_text

OPTIONS = [
    "--fix",
    "k_y=19000.0,mu=0.5",
    "--prior",
    "mu=normal(0.6, 0.1),cor_10=beta(30, 10)",
    "--pool",
    "mu=court",
    "--as-read",
]
ARGUMENTS = {
    "fix": {"k_y": 19000.0, "mu": 0.5},
    "prior": {"mu": "normal(0.6, 0.1)", "cor_10": "beta(30, 10)"},
    "pool": {"mu": "court"},
    "as_read": True,
}


@pytest.mark.parametrize("sources", [["a table.csv"], ["a.csv", "b.csv"]])
@pytest.mark.parametrize("verb", ["calibrate", "compare"])
def test_a_command_is_a_call_with_the_same_arguments(verb, sources):
    call = ast.parse(call_of(verb, [*sources, *OPTIONS]), mode="eval").body
    assert ast.unparse(call.func) == f"fitball.{verb}"
    (read,) = (ast.literal_eval(argument) for argument in call.args)
    assert read == (sources[0] if len(sources) == 1 else sources)
    arguments = {word.arg: ast.literal_eval(word.value) for word in call.keywords}
    assert arguments == ARGUMENTS
    accepted = inspect.signature(getattr(fitball, verb)).parameters
    assert set(arguments) <= set(accepted)


def test_commands_in_a_page_are_replaced_and_other_code_is_not():
    text = "Run <code>fitball plan FIT --target &#39;mu[a]&#39;</code> or <code>fit.nc</code>."
    assert with_calls(text) == "Run <code>fit.plan(target='mu[a]')</code> or <code>fit.nc</code>."


def test_a_notebook_shows_calls_and_the_terminal_commands():
    report = Report("A fit", [Text(["Next: `fitball compare a.csv --noise student-t`."])], [])
    assert "fitball compare a.csv --noise student-t" in to_text(report)
    assert "fitball.compare('a.csv', noise='student-t')" in to_notebook(report)
