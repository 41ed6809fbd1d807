"""No text that fitball writes into a CSV file is a formula, and each is read back as it was."""

from __future__ import annotations

import csv
import io
import json
import re

import pandas as pd
from hypothesis import example, given
from hypothesis import strategies as st

from fitball.cli.main import main
from fitball.report.batch.rows import failed_row, read_rows
from fitball.report.form.files import csv_text
from fitball.visible import guarded, unguarded

# What spreadsheets compute, by the list of OWASP ("CSV Injection").
BEGINNINGS = "=+-@\t\r\n"
LETTERS = st.text(st.sampled_from([*BEGINNINGS, *"'a1.e,\" "]) | st.characters(codec="utf-8"))


def is_number(text):
    try:
        float(text)
    except ValueError:
        return False
    return re.search("[^0-9+-.e]", text, re.IGNORECASE) is None


@given(st.lists(LETTERS, min_size=1), st.lists(st.floats(allow_nan=False) | st.integers(), min_size=1))
@example(["=1", "'=1", "''=1", "'", "-5", "'-5", "-", "+1e5", "-1_0"], [-5, -0.5])
def test_no_cell_is_a_formula_and_all_come_back(texts, numbers):
    rows = [{"id": text, "=head": number} for text in texts for number in numbers[:3]]
    # Read by the module `csv`, as spreadsheets do it.
    heads, *cells = csv.reader(io.StringIO(csv_text(rows), newline=""))
    assert heads == ["id", "'=head"]
    for cell, _number in cells:
        assert cell[:1] not in [*BEGINNINGS] or is_number(cell)
    assert [number for _cell, number in cells] == [str(row["=head"]) for row in rows]
    assert unguarded([cell for cell, _number in cells]) == tuple(row["id"] for row in rows)


@given(LETTERS)
def test_only_what_would_be_computed_is_changed(text):
    core = text.lstrip("'")
    if core[:1] not in [*BEGINNINGS, *"\uff1d\uff0b\uff0d\uff20"] or re.fullmatch(r"[+-]?\d+", core, re.ASCII):
        assert guarded(text) == text
    else:
        assert guarded(text) in (text, "'" + text)


def test_a_column_that_others_wrote_stays_as_it_is():
    assert unguarded(["=a", "'=a", "b"]) == ("=a", "'=a", "b")


@given(LETTERS, LETTERS)
def test_a_batch_reads_its_rows_back(name, label):
    row = failed_row("t" + name, name) | {"label:ball": label or None}
    assert read_rows(csv_text([row])) == (row,)


IDS = ("=cmd|' /C calc'!A0", "@SUM(1)", "+a", "-5", "-b", "12", "plain")


def test_ids_go_through_predictions_and_back(small_fit, tmp_path, capsys):
    """A user's file, its predictions as CSV, and impacts taken from that; JSON has the ids as they are."""
    given, out = tmp_path / "new.csv", tmp_path / "out.csv"
    pd.DataFrame({"id": IDS, "v_x1": 10.0, "v_y1": 5.0, "omega_1": 0.0}).to_csv(given, index=False)
    for _round in range(2):
        assert main(["predict", str(small_fit), str(given), "--json", "--out", str(out), "--overwrite"]) == 0
        assert [row["id"] for row in json.loads(capsys.readouterr().out)["impacts"]] == list(IDS)
        frame = pd.read_csv(out, dtype=str)
        assert frame["id"].tolist() == ["'" + IDS[0], "'@SUM(1)", "'+a", "-5", "'-b", "12", "plain"]
        frame[["id", "v_x1 [m/s]", "v_y1 [m/s]", "omega_1 [rad/s]"]].to_csv(given, index=False)
