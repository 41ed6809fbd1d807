"""What users read: no phrase of `phrases.py` in texts, terminal, page and help; none of its names in signatures."""

from __future__ import annotations

import contextlib
import io

import phrases
import pytest

from fitball.cli.main import VERBS, main
from fitball.report.fit.document import fit_document
from fitball.report.form.document import as_markdown, on_terminal
from fitball.wording import Screen

FILES = phrases.read_by_users()
# Sentences as they were before there were rules for them.
BEFORE = (
    "It does not tell k_y",
    "The table identifies k_theta",
    "the table narrows it from both sides",
    "to 31 % of what was known before",
    "over assumptions that this table cannot tell apart",
    "1 optimum worth an ensemble",
    "None with fewer parameters comes up to it",
    "Do two masses earn their parameters?",
    "can move together without a trace in the data",
    "few draws there meet the population",
    "Who wants to carry on",
    "describe it just as good",
    "what the table has to say",
    "All of it stands in report.html",
    "There is none that predicts better",
    "walls bear no error",
    "half of it by priors",
)


def found_in(text):
    return [found[0] for pattern in phrases.PATTERNS for found in pattern.finditer(" ".join(text.split()))]


@pytest.mark.parametrize("sentence", BEFORE)
def test_the_patterns_find_what_was_written_before(sentence):
    assert found_in(sentence)


def test_every_pattern_has_an_example():
    used = {pattern for pattern in phrases.PATTERNS for sentence in BEFORE if pattern.search(sentence)}
    assert used == set(phrases.PATTERNS)


def test_no_text_has_a_banned_phrase():
    assert len(FILES) > 200
    assert [
        f"{path.relative_to(phrases.ROOT)}:{line}: {phrase}; write: {instead}"
        for path in FILES
        for line, phrase, instead in phrases.phrases_in(path)
    ] == []


def test_no_signature_has_a_banned_name():
    found = ((path, *place) for path in FILES for place in phrases.names_in(path))
    assert [f"{path.relative_to(phrases.ROOT)}:{line}: {name}" for path, line, name in found] == []


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb.name)
def test_no_help_has_a_banned_phrase(verb):
    out = io.StringIO()
    with contextlib.redirect_stdout(out), pytest.raises(SystemExit):
        main([verb.name, "--help"])
    assert found_in(out.getvalue()) == []


def test_neither_terminal_nor_page_of_a_fit_has_a_banned_phrase(short_fit):
    document = fit_document(short_fit)
    assert found_in(on_terminal(document, Screen())) == []
    assert found_in(as_markdown(document)) == []
