"""The templates of verdicts and adequacy, each filled once: short, without banned phrases, no field left over."""

import re
from string import Formatter

import pytest
from phrases import PATTERNS

from fitball.inference.results import sentences

# Sample facts by field; an attribute of a field is a number.
FACTS = {
    "names": "mass_ratio, k_y and mu", "name": "mu", "others": "k_y", "columns": "v_x2 and v_y2", "column": "omega_2",
    "they": sentences.THEY, "its": sentences.THEIR_PRIORS, "few": "Seven impacts are", "count": "Two",
    "tests": "24 residual tests", "where": " in omega_2",
    "limit": sentences.ONLY_STRONG.format(share=71.0), "known": "expected", "what": "residuals of omega_2",
    "size": "13.7 rad/s", "reference": "10 rad/s", "ratio": "1.4", "within": "[0.5, 0.6]",
    "faults": "v_x2: bias in group b (12 % of the residual variance)", "fault": "v_x2: trend with theta_1",
    "share": "12 %", "instead_of": "noise=normal", "gain": "12 ± 3", "scene": "", "tied": "", "more": "", "order": "",
    "together": "k_y: its own value comes from the priors of both", "bounded": "the data give only an upper bound",
    "ids": "zero-2", "regimes": " (grip)", "agree": "", "condition": "mass_ratio >= COR", "end": "0.52",
    "why": "fixed by the scene", "reason": "the data reduce its uncertainty to 31 % of the prior's",
}  # fmt: skip


class Number(float):
    """A number whose every attribute is one."""

    def __getattr__(self, name):
        return self


class Facts(dict):
    """The facts, and a number for every other field; of a field with a format the number."""

    def __init__(self, formats):
        super().__init__({name: Number(71.4) for name, form in formats.items() if form})

    def __missing__(self, name):
        return FACTS.get(name, "7")


def templates():
    for name, value in vars(sentences).items():
        if name.isupper() and not name.startswith("_"):
            for template in (value,) if isinstance(value, str) else value:
                yield pytest.param(template, id=name)


def filled(template):
    fields = {
        field.partition(".")[0]: form for _text, field, form, _conversion in Formatter().parse(template) if field
    }
    return template.format_map(Facts(fields))


@pytest.mark.parametrize("template", [*templates()])
def test_each_template_reads_well(template):
    text = filled(template)
    assert text.strip() and not re.search(r"[{}]|\bNone\b|  ", text)
    assert not [pattern.pattern for pattern in PATTERNS if pattern.search(text)]
    for sentence in re.split(r"(?<=[.:;]) ", text):
        assert len(sentence.split()) <= 25, sentence
    # A sentence ends as one; a part of one does not.
    if len(text.split()) > 2:
        assert text.endswith(".") == text.lstrip()[0].isupper() or template.startswith("{"), text


def test_names_and_counts():
    assert [sentences.listed(names) for names in ((), ("a",), ("a", "b"), ("a", "b", "c"))] == [
        "", "a", "a and b", "a, b and c",
    ]  # fmt: skip
    assert [sentences.counted(count) for count in (1, 12, 13, 1300)] == ["One", "Twelve", "13", "1,300"]
