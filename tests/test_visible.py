"""Text from files cannot steer a terminal, hide, or fill it, whichever verb prints it."""

from __future__ import annotations

import io
import json
import sys
import unicodedata
from argparse import Namespace

import pytest

from fitball.cli.main import main
from fitball.cli.terminal import screen_of, show, visible_streams
from fitball.errors import Fault, TableError
from fitball.report.form.document import Document, on_terminal
from fitball.visible import EACH, LINE, LINES, folded, kind_of, one_line, visible
from fitball.wording import Screen, shown_on

EVERYTHING = "".join(map(chr, range(sys.maxunicode + 1)))
DIRECTIONS = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}
ESCAPE, CSI, OVERRIDE = "\x1b[31m", "\x9b2J", "\u202e"
HOSTILE = f"{ESCAPE}{CSI}{OVERRIDE}\x07"


def steers(character):
    """What Unicode says of it; line feed and tab are the program's own."""
    kind = unicodedata.category(character)
    return (kind in ("Cc", "Cs", "Zl", "Zp") and character not in "\n\t") or (
        unicodedata.bidirectional(character) in DIRECTIONS
    )


def test_nothing_that_steers_remains_and_nothing_that_is_read_is_lost():
    shown = visible(EVERYTHING)
    assert not any(map(steers, shown))
    kept = [c for c in EVERYTHING if c.isprintable() or c in "\n\t\u200c\u200d"]
    assert visible("".join(kept)) == "".join(kept)


def test_json_stays_json():
    text = "".join(c for c in EVERYTHING if steers(c) and unicodedata.category(c) != "Cs") + "\U000e0041\ufeff"
    shown = visible(json.dumps({text: text}, ensure_ascii=False))
    assert json.loads(shown) == {text: text}


def test_one_line_keeps_both_ends_of_what_is_long():
    line = one_line(f"read '{'a' * 100_000}\n\t'; expected a number")
    assert len(line) <= LINE and "\n" not in line and "\t" not in line
    assert line.startswith("read 'aaa") and line.endswith("\\u000a\\u0009'; expected a number")
    assert "[... 100038 characters in all ...]" in line
    assert one_line(line) == line and one_line("short") == "short"


def test_faults_of_a_kind_are_folded():
    lines = [("x", f"row {k}: x") for k in range(100)] + [("y", "y is wrong")]
    assert folded(lines) == [*(f"row {k}: x" for k in range(EACH)), "y is wrong", "... and 95 more like: row 0: x"]
    many = folded((k, str(k)) for k in range(1000))
    assert many == [*map(str, range(LINES)), f"... and {1000 - LINES} others"]
    assert kind_of("read '1e9', expected at most 5") == kind_of("read 'x', expected at most 6.5e-3")
    assert kind_of("read '1', expected a number") != kind_of("read '1', expected a speed")


def test_a_table_of_faults_is_told_in_bounds_and_carries_them_all():
    faults = [Fault(f"read '{k}'; expected a number", k, k + 1, f"c{k % 60}") for k in range(100_000)]
    error = TableError("t.csv", faults)
    assert len(error.faults) == 100_000
    assert len(str(error)) < 20_000
    assert "100000 faults" in str(error) and "1,667 rows (first: row 3, line 4), column 'c3'" in str(error)


@pytest.fixture
def hostile(tmp_path):
    """A table, with its scene, that tries to steer the terminal from every text it has."""
    place = tmp_path / "hostile.csv"
    rows = [f"{HOSTILE}{k},{HOSTILE}{k % 2},{HOSTILE},{12 + k},{5 + k},9,{4 + k},250" for k in range(4)]
    head = f"id,surface,{HOSTILE.replace('[', '')}own,v_x1,v_y1,v_x2,v_y2,omega_2"
    place.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    quoted = json.dumps(HOSTILE)
    place.with_suffix(".toml").write_text(
        f"[source]\ndescription = {quoted}\ncitation = {quoted}\n[surface]\nname = {quoted}\n", encoding="utf-8"
    )
    return place


def printed(capsys, code, *words):
    """All that a command prints; nothing of it steers."""
    try:
        ended = main([str(word) for word in words])
    except SystemExit as left:
        ended = left.code
    assert ended == code
    text = "".join(capsys.readouterr())
    assert not [c for c in text if steers(c)]
    return text


def test_verbs_that_print_text_of_tables(hostile, small_fit, tmp_path, capsys):
    out = tmp_path / "out"
    commands = [
        ("datasets", "show", hostile),
        ("datasets", "show", hostile, "--json"),
        ("datasets", "check", hostile),
        ("datasets", "check", hostile, "--json"),
        ("calibrate", hostile, "--model", "grip-slip", "--point-only", "--full", "--out", out),
        ("predict", small_fit, hostile),
        ("predict", small_fit, hostile, "--json"),
        ("predict", out, hostile),
        ("export", out, "--to", "markdown", "--out", "-"),
        ("export", out, "--to", "json", "--out", "-"),
    ]
    for words in commands:
        text = printed(capsys, 0, *words)
        assert "\\u009b2J\\u202e" in text or words[0] == "export", text


def test_errors_that_quote_files_and_options(hostile, small_fit, tmp_path, capsys):
    bad = tmp_path / "bad.csv"
    bad.write_text(f"id,{HOSTILE},v_y1,v_y2 [{HOSTILE}]\n1,2,{HOSTILE},4\n1,2,3,4\n", encoding="utf-8")
    scene = tmp_path / "bad.toml"
    scene.write_text(f'["{json.dumps(HOSTILE)[1:-1]}"]\n', encoding="utf-8")
    force = tmp_path / "force.csv"
    force.write_text(f"id,t,F\n{HOSTILE},1,2\n", encoding="utf-8")
    commands = [
        ("datasets", "check", bad),
        ("datasets", "show", bad),
        ("datasets", "check", "wang_all", "--scene", scene),
        ("datasets", "check", "wang_all", "--force-records", force),
        ("datasets", "show", HOSTILE),
        ("predict", small_fit, bad),
        ("verify", bad, "--fit", small_fit),
        ("calibrate", "wang_all", "--prior", HOSTILE),
        ("calibrate", "wang_all", "--fix", f"{HOSTILE}=1"),
        ("calibrate", "wang_all", "--model", HOSTILE),
        ("simulate", "--impact", HOSTILE),
        ("export", small_fit, "--to", "lookup", "--range", HOSTILE),
        ("compare", "wang_all", "--models", HOSTILE),
        ("repeat", HOSTILE),
        ("plot", HOSTILE, "corner"),
        (HOSTILE,),
    ]
    for words in commands:
        assert "\\u001b" in printed(capsys, 2, *words), words


def test_whatever_a_verb_prints_passes_through_one_place(monkeypatch, capsys):
    def say():
        print(HOSTILE)
        print(HOSTILE, file=sys.stderr)
        sys.stdout.write(HOSTILE)
        return []

    monkeypatch.setattr("fitball.data.bundled.bundled_tables", say)
    assert printed(capsys, 0, "datasets", "list").count("\\u001b") == 3


def test_what_an_encoding_lacks_is_no_exception(monkeypatch, tmp_path):
    place = tmp_path / "t.csv"
    place.write_text("id,v_y1,v_y2\nμ,4,3\n\U0001f3be,5,4\n", encoding="utf-8")
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, "iso-8859-1"))
    assert main(["datasets", "show", str(place)]) == 0
    sys.stdout.flush()
    assert b"\\u03bc" in raw.getvalue() and b"\\U0001f3be" in raw.getvalue()


def test_what_the_system_refuses_is_told_without_a_traceback(small_fit, capsys):
    assert main(["predict", str(small_fit), "--impact", "v_y=6", "--out", "a" * 5000]) == 2
    assert "File name too long" in capsys.readouterr().err


@pytest.mark.parametrize(("given", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False), ({"TERM": "dumb"}, False)])
def test_colours_are_for_terminals_that_take_them(given, coloured, monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "64")
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    assert screen_of(Namespace()) == Screen()
    out = Terminal()
    monkeypatch.setattr(sys, "stdout", out)
    with visible_streams():
        shape = screen_of(Namespace(full=False))
        with shown_on(shape):
            show(on_terminal(Document("T \x1b[2J", [], [])))
    assert shape == Screen(64, coloured, False)
    assert ("\x1b[1m" in out.getvalue()) is coloured and "\x1b[2J" not in out.getvalue()
