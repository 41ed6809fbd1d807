"""What messages propose runs on the table, and helps; what does not is noticed."""

import pytest
from support.scripts import script

remedies = script("remedies")


@pytest.fixture(scope="module")
def faults():
    return remedies.tables_of_faults()


def studied(tmp_path, monkeypatch, texts):
    """Remedies of `check` made, run, helped, and lines on the others."""
    monkeypatch.chdir(tmp_path)
    for stem, text in texts.items():
        (tmp_path / f"{stem}.csv").write_text(text)
    tables = sorted(tmp_path.glob("*.csv"))
    return remedies.study(tables, tmp_path / "work", ("check",))


def test_every_remedy_of_check_helps(tmp_path, monkeypatch, faults):
    made, ran, helped, lines = studied(tmp_path, monkeypatch, faults)
    assert lines == []
    assert made == ran == helped
    # One of each table with a fault that an option mends.
    assert made >= 15


@pytest.mark.parametrize(
    ("sentence", "runs"),
    [
        ("look again: `fitball check t.csv`", True),
        ("leave it out (--ignore)", False),
        ("leave it out (--ignore v_y3)", False),
        ("fit it to each: `fitball calibrate t.csv --pool PARAMETER=COLUMN`", False),
    ],
)
def test_remedies_that_do_not_help_are_counted(tmp_path, monkeypatch, sentence, runs):
    """A note on a good table whose remedy is empty, wrong, not filled in, or changes nothing."""

    def run(words, out):
        if words == ["check", "t.csv"]:
            return remedies.Outcome(0, (sentence,))
        return remedies.Outcome(2 if "v_y3" in words else 0, (sentence,))

    monkeypatch.setattr(remedies, "run", run)
    made, ran, helped, lines = studied(tmp_path, monkeypatch, {"t": "v_y1,v_y2\n7,5\n8,6\n"})
    assert (made, ran, helped) == (1, int(runs), 0)
    assert len(lines) == 1


def test_commands_and_options_of_a_sentence():
    text = (
        'try `fitball compare t.csv --flip omega_2`, or --columns "v_1=a, b [mph],v_2=c"; --as-read'
    )
    found = remedies.remedies_in([text], ["check", "t.csv", "--columns", "v_1=a"], "fit")
    assert [remedy.words for remedy in found] == [
        ("compare", "t.csv", "--flip", "omega_2"),
        ("check", "t.csv", "--columns", "v_1=a, b [mph],v_2=c"),
        ("check", "t.csv", "--columns", "v_1=a", "--as-read"),
    ]
