"""Text of strangers in source code: ports and the page with sliders compile, run, and obey none of it."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_export_ports import ALL, NODE, fitted, port_of, run, self_tested
from test_interactive import models  # noqa: F401 - a fixture

from fitball import FitballError, load_fit
from fitball.cli.main import main
from fitball.exports.interactive import interactive_page, round_impact
from fitball.exports.port.port import HARMLESS, source_text

# What ends a comment, a string, a line or a script in some language, or goes on in the next line.
ENDS = (
    "*/", "*\\", "*??/", "*\\\n/", "\\u002a/", "\\x2a/", "\\N{ASTERISK}/", '"', '"""', "'''", "'", "`", "${", "{{",
    "{%", "@@", "@UP@", "</script>", "<script>", "<!--", "-->", "]]>", "%n%s", "\\", "??/", "//", "#", "\n", "\r",
    "\r\n", "\v", "\f", "\x1c", "\x85", "\u2028", "\u2029", "\0", "\u202e", "\u2066", "\ufeff", "\udc80",
    "\U000e0041", "\\\n", "??/\n", "\\U0000000a", "\n\"\"\"\n", "\n*/\n", "\n\t", ";", "});",
)  # fmt: skip
# What each language would do then. A quotation mark within tells what ran from what is only shown.
DEEDS = (
    'console.log("PW"+"NED");', 'print("PW"+"NED")', 'System.Console.WriteLine("PW"+"NED");', "#error PWNED",
    '__attribute__((constructor)) static void f(void) { puts("PW" "NED"); }', 'static void f() { } } class PWNED {',
    'var x = print("PW"+"NED")', "# coding: utf-7",
)  # fmt: skip
HOSTILE = tuple(f"{end}{deed}{end[::-1]}" for end, deed in product(ENDS, DEEDS)) + ENDS
TOGETHER = "".join(HOSTILE)


def hostile(port):
    """The port with every hostile string in every text field of it."""
    call, valid = port.call, port.valid
    count = len(call.columns)
    return replace(
        port,
        model=TOGETHER,
        titles=(*port.titles, *HOSTILE),
        call=replace(call, columns=tuple("".join(HOSTILE[k::count]) for k in range(count))),
        valid=replace(valid, below=TOGETHER, above=TOGETHER),
    )


def untouched(said):
    """What a self-test printed, which passed and did nothing else."""
    lines = said.strip().split("\n")
    assert len(lines) == 1 and lines[0].endswith(": passed"), lines[-3:]
    assert "PWNED" not in said.replace("error PWNED", "").replace("class PWNED", "")


@pytest.mark.parametrize("language", ALL)
def test_no_text_of_a_port_is_obeyed(language, tmp_path):
    assert len(HOSTILE) >= 400
    untouched(self_tested(language, hostile(port_of(fitted("grip-slip"))), tmp_path).stdout)


def in_every_field(folder, text):
    """Put `text` into `fit.json`, into every kind of text that a fit is read back with; return how many those are."""
    path = folder / "fit.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    kinds = {}

    def gather(node, way):
        for key, value in node.items() if isinstance(node, dict) else enumerate(node):
            kind = (*way, key if isinstance(key, str) else "*")
            if isinstance(value, str):
                kinds.setdefault(kind, []).append((node, key))
            elif isinstance(value, dict | list):
                gather(value, kind)

    gather(content, ())
    taken = []
    for places in kinds.values():
        before = [node[key] for node, key in places]
        for node, key in places:
            node[key] = HOSTILE[0]
        path.write_text(json.dumps(content), encoding="utf-8")
        try:
            load_fit(folder)
            taken.append(places[0])
        except FitballError:
            for (node, key), value in zip(places, before, strict=True):
                node[key] = value
    for node, key in taken:
        node[key] = text
    path.write_text(json.dumps(content), encoding="utf-8")
    return len(taken)


LONE = re.compile("[\ud800-\udfff]")


def test_no_text_of_a_fit_is_obeyed(small_fit, tmp_path):
    """From `fit.json` through `export` and `simulate --fit --html`, as a user does it."""
    shutil.copytree(small_fit, tmp_path / "fit")
    assert in_every_field(tmp_path / "fit", LONE.sub("", TOGETHER)) > 50
    saved = str(tmp_path / "fit")
    for name, ending, runner in (("python", "py", [sys.executable]), ("javascript", "js", [NODE])):
        assert main(["export", saved, "--to", name, "--out", str(tmp_path / f"bounce.{ending}")]) == 0
        if runner[0] is not None:
            untouched(run([*runner, f"bounce.{ending}"], tmp_path))
    assert main(["simulate", "--fit", saved, "--html", "--out", str(tmp_path / "page.html")]) == 0
    held((tmp_path / "page.html").read_text(encoding="utf-8"), tmp_path)


class Scripts(HTMLParser):
    """The elements of a page, and what its scripts hold."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.scripts = [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, *sorted(name for name, _value in attrs)))

    def handle_data(self, data):
        if self.cdata_elem == "script":
            self.scripts.append(data)


def held(page, folder):
    """One script, which runs until it asks for a document, and says nothing."""
    found = Scripts(page)
    assert sum(tag[0] == "script" for tag in found.tags) == 1
    assert not [tag for tag in found.tags if any(name.startswith("on") for name in tag[1:])]
    if NODE is not None:
        (folder / "page.js").write_text("".join(found.scripts), encoding="utf-8")
        done = subprocess.run([NODE, "page.js"], cwd=folder, capture_output=True, text=True, check=False)
        assert done.stdout == "" and "ReferenceError: document is not defined" in done.stderr
    return found.tags


def test_no_text_of_the_page_with_sliders_is_obeyed(models, tmp_path):  # noqa: F811
    model = models["preset"]
    plain = held(interactive_page(model, round_impact(model), "A sentence.", "a phrase"), tmp_path)
    page = interactive_page(model, round_impact(model), TOGETHER, TOGETHER)
    assert held(page.encode("utf-8", "replace").decode(), tmp_path) == plain


@given(st.text(st.characters(exclude_categories=())))
def test_source_text_has_letters_digits_and_harmless_punctuation_alone(text):
    """Nothing harmful is left, nothing else is changed, and twice is once."""
    found = source_text(text)
    assert not set(found) - set(HARMLESS) - {char for char in found if char.isalnum()}
    assert not set(HARMLESS) & set('"\\`*#<?!$@{}|&^~\n\r\t\0\x0b\x0c\x85\u2028\u2029\u202e')
    assert source_text(found) == found
    kept = "".join(char for char in text if char.isalnum() or char in HARMLESS)
    assert kept == text or found != kept
    assert source_text(kept) == kept
