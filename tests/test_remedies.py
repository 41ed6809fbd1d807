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


@pytest.mark.parametrize(
    ("verb", "sentence", "found"),
    [
        # A switch of the verb, whatever stands behind it.
        ("track", "see what was tracked with --film-only first", ("--film-only",)),
        ("track", "begin later, as in --from 0.4", ("--from", "0.4")),
        ("calibrate", "ask for it: --derive court=mu", ("--derive", "court=mu")),
        # The verb has no such option.
        ("check", "see what was tracked with --film-only first", ("--film-only",)),
    ],
)
def test_options_are_those_of_the_verb(verb, sentence, found):
    (remedy,) = remedies.remedies_in([sentence], [verb, "t.csv"], "fit")
    assert remedy == remedies.Remedy((verb, "t.csv", *found), sentence)


def test_where_a_result_goes_and_what_only_the_user_knows_are_no_remedies():
    sentences = [
        "replace it with --overwrite, or --out DIR",
        "state the rate: --fps",
        "the films without `--film-only`",
        "leave out --sound",
    ]
    assert list(remedies.remedies_in(sentences, ["track", "t.csv"], "fit")) == []


def test_an_option_that_the_verb_does_not_have_does_not_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.csv").write_text("v_y1,v_y2\n7,5\n8,6\n")
    words = ["check", "t.csv"]
    sentence = "see what was tracked with --film-only first"
    before = remedies.Outcome(0, (sentence,))
    (remedy,) = remedies.remedies_in([sentence], words, "fit")
    assert remedies.helps(remedy, before, words, tmp_path / "again") == (False, False)
