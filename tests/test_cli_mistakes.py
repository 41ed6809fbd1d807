"""A slip of the keyboard is named and a suggestion made, in one style; what is half said is not guessed."""

from __future__ import annotations

import pytest

from fitball.cli.main import VERBS, main
from fitball.cli.options import Group

MISTAKES = [
    ("calibrat", "unknown verb 'calibrat': did you mean 'calibrate'?", "fitball --help"),
    ("--modle calibrate", "unknown option '--modle' before a verb", "fitball --help"),
    ("calibrate --modle grip-slip", "unknown option '--modle' of calibrate: did you mean '--model'?", "--help"),
    ("calibrate --model brody --mxsteps=3 x.csv", "unknown option '--mxsteps' of calibrate: did", "--help"),
    ("compare x.csv -quick", "unknown option '-quick' of compare: did you mean '--quick'?", "fitball compare --help"),
    ("datasets chek x.csv", "unknown action 'chek': did you mean 'check'?", "fitball datasets --help"),
    ("datasets check x.csv --jsn", "unknown option '--jsn' of datasets check: did you mean '--json'?", "--help"),
    ("plot fit corner more", "unexpected argument 'more': plot", "fitball plot --help"),
    ("calibrate x.csv --seed one", "argument --seed: read 'one', expected a whole number", "calibrate --help"),
    ("calibrate", "the following arguments are required: DATA", "calibrate --help"),
    # Abbreviations: what one means is said, never done.
    ("calibrate x.csv --over", "unknown option '--over' of calibrate: did you mean '--overwrite'?", "--help"),
    ("compare x.csv --m brody", "unknown option '--m' of compare: did you mean '--models' or '--max-", "--help"),
    ("compare x.csv --se=2", "unknown option '--se' of compare: did you mean '--seed'?", "compare --help"),
]  # fmt: skip


@pytest.mark.parametrize(("line", "said", "where"), MISTAKES)
def test_what_is_not_known_is_named_with_a_suggestion(line, said, where, capsys):
    with pytest.raises(SystemExit) as left:
        main(line.split())
    assert left.value.code == 2
    err = capsys.readouterr().err
    assert err.startswith("fitball: ") and said in err and where in err
    assert len(err.splitlines()) == 2


VALUES = [
    (["calibrate", "wang_all.csv", "--model", "two_mass"], "unknown model 'two_mass': did you mean 'two-mass'?"),
    (["calibrate", "wang_all.csv", "--closure", "norml=total"], "unknown closure 'norml': did you mean 'normal'?"),
    (["calibrate", "wang_all.csv", "--closure", "normal=totl"], "unknown option 'totl' of closure normal: did you"),
    (["calibrate", "wang_all.csv", "--noise", "student"], "unknown noise 'student': did you mean 'student-t'?"),
    (["calibrate", "wang_all.csv", "--noise", "seperate"], "unknown noise 'seperate': did you"),
    (["calibrate", "wang_all.csv", "--fix", "k_tehta=1"], "unknown parameter 'k_tehta': did you mean 'k_theta'?"),
    (["calibrate", "wang_all.csv", "--prior", "mu=norml(1, 1)"], "unknown family 'norml': did you mean 'normal'?"),
    (["simulate", "--impact", "v=17, theta=18", "--set", "muu=1"], "unknown parameter 'muu' of model two-mass: did"),
    (["export", "nowhere", "--to", "pyhton"], "unknown format 'pyhton': did you mean 'python'?"),
    (["plot", "nowhere", "coner"], "unknown figure 'coner': did you mean 'corner'?"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "said"), VALUES)
def test_values_are_told_in_the_same_words(words, said, capsys):
    assert main(words) == 2
    assert said in capsys.readouterr().err


OLD = {"--config": "--scene", "--force": "--force-records", "--velocity-noise": "--noise", "--of": "--parameters"}


@pytest.mark.parametrize(
    ("words", "old"),
    [
        (["datasets", "check", "wang_all", "--config", "nowhere"], "--config"),
        (["datasets", "check", "wang_all", "--config=nowhere"], "--config"),
        (["datasets", "check", "wang_all", "--force", "nowhere"], "--force"),
        (["calibrate", "wang_all", "--velocity-noise", "nowhere"], "--velocity-noise"),
        (["population", "--of", "mu", "nowhere"], "--of"),
        (["repeat", "nowhere", "--force", "x.csv"], "--force"),
    ],
)
def test_an_old_name_is_taken_with_a_note(words, old, capsys):
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert f"note: {old} is now {OLD[old]}" in err.splitlines()[0] and "nowhere" in out + err
    assert main([*words, "--quiet"]) == 2 if words[0] != "population" else True
    assert words[0] == "population" or "note" not in capsys.readouterr().err


def test_help_has_no_old_names_and_shows_defaults():
    verbs = [(verb, *verb.actions) for verb in VERBS]
    for verb in (one for some in verbs for one in some):
        listed = [one for part in verb.options for one in (part.options if isinstance(part, Group) else [part])]
        assert not {one.flag for one in listed} & {*OLD}, verb.name
        for one in listed:
            default = one.more.get("default")
            hidden = default in (None, "", 0) or default == [] or default == {}
            assert hidden or "default: " in one.help, f"{verb.name} {one.flag}"


@pytest.mark.parametrize("verb", [verb.name for verb in VERBS])
def test_help_is_as_wide_as_the_terminal(verb, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        main([verb, "--help"])
    # Examples are one line each: they are copied.
    lines = [line for line in capsys.readouterr().out.split("\n") if not line.startswith("  ")]
    assert max(map(len, lines)) <= 80


@pytest.mark.parametrize("out", ["", " ", ".", "/", "x\0y", "new.csv/", "here"])
def test_a_file_is_no_folder_and_nothing_is_no_place(out, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "here").mkdir()
    verbs = ["predict", "export --to json", "calibrate", "plot", "batch", "plan", "compare", "simulate", "rederive"]
    # All others write into folders.
    for verb in verbs if not out.strip() or "\0" in out else verbs[:1]:
        given = [] if verb in ("simulate", "rederive") else ["nowhere"]
        with pytest.raises(SystemExit) as left:
            main([*verb.split(), *given, "--out", out])
        assert left.value.code == 2
        assert "argument --out: read '" in capsys.readouterr().err and not [*(tmp_path / "here").iterdir()]


def test_a_negative_number_is_no_option(capsys, small_fit):
    assert main(["predict", str(small_fit), "--impact", "v=17, theta=18", "--seed", "-1"]) == 2
    assert "expected a whole number, 0" in capsys.readouterr().err
