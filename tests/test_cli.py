"""The command line as a frame: what a signature says, mistakes of words, what is imported for
help.
"""

import os
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball import cli
from fitball.base.errors import FitballError
from fitball.saved import files_of_fit

DATA = Path(__file__).parent / "data"
TABLES = {
    "t.csv": "surface,v_x1,v_y1,omega_1,v_x2,v_y2,omega_2\nclay,15.6,4.8,0,11.1,4.2,239\nhard,16,"
    "5,0,11.3,4.3,245\n",
    "d.csv": "v_y1,v_y2\n5,4\n6,4.7\n7,5.5\n",
    "n.csv": "surface,v_x1,v_y1\nice,15,5\n",
    "x.csv": "t,x [m],y [m]\n0,0.1,0.5\n0.01,0.2,0.4\n",
    "x.mp4": "\0\0\0 ftypisom",
}


def _parsed(*words):
    return vars(cli.make_parser().parse_args(words))


def _exit(capsys, *words):
    """Exit code and what was said of a mistake in words."""
    with pytest.raises(SystemExit) as caught:
        cli.main(words)
    return caught.value.code, capsys.readouterr().err


def test_options_are_those_of_the_signature():
    line = (
        "calibrate a.csv b.csv --fix mu=0.5,eps_slope=0 --fix e_x=0.1 --flip v_y2,omega_1 "
        "--as-read --seed 7 --out x "
        "--prior mu=normal(0.6,0.1),e_x=uniform(-1,1)"
    )
    parsed = _parsed(*line.split())
    assert parsed["data"] == ["a.csv", "b.csv"]
    assert parsed["fix"] == {"mu": 0.5, "eps_slope": 0.0, "e_x": 0.1}
    assert parsed["prior"] == {"mu": "normal(0.6,0.1)", "e_x": "uniform(-1,1)"}
    assert parsed["flip"] == ["v_y2", "omega_1"]
    assert parsed["as_read"] is True
    assert parsed["point_only"] is False
    assert parsed["seed"] == 7
    assert parsed["_out"] == "x"
    assert _parsed("check")["data"] == []


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("calibrat", "a.csv"), "calibrate"),
        (("--vers",), "--version"),
        (("--out", "x", "check"), "--out"),
        (("calibrate", "a.csv", "--seed", "1.5"), "--seed"),
        (("calibrate", "a.csv", "--see", "1"), "--seed"),
        (("calibrate", "a.csv", "--over"), "--overwrite"),
        (("calibrate", "a.csv", "--no-figures"), "--figures"),
        (("predict", "fit", "a.csv", "b.csv"), "b.csv"),
        (("simulate", "--map"), "--map"),
        (("calibrate", "a.csv", "--fix", "mu=much"), "mu"),
        (("calibrate", "a.csv", "--fix", "mu=1", "--fix", "mu=2"), "mu=2"),
        (("calibrate", "a.csv", "--prior", "mu"), "mu"),
    ],
)
def test_a_mistake_in_words_ends_with_two_and_names_what_is_near(capsys, words, named):
    code, message = _exit(capsys, *words)
    assert code == 2
    assert named in message


# What cannot be wrong by itself, or is the mistake of another option.
SURE = {"progress", "data", "fit", "figures", "out"}


def _outcome(line):
    """The exit code of a command, the code of its error, or "words" of a mistake in words."""
    try:
        return str(cli.run(_parsed(*shlex.split(line)), ""))
    except FitballError as error:
        return error.code
    except SystemExit as end:
        return {2: "words"}[end.code]


def test_bad_input_of_every_verb_has_a_code_and_leaves_no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    surfaces = table_of(36, ("clay", "hard"))
    fits = {
        "F": fit_by_hand(surfaces),
        "P": fit_by_hand(sampled=False),
        "D": fit_by_hand(table_of(12, drop=True)),
    }
    fits["T"] = fit_by_hand(surfaces, model="two-mass")
    for name, fit in fits.items():
        Path(name).mkdir()
        for file, content in files_of_fit.files(fit).items():
            Path(name, file).write_bytes(content())
    for name, text in TABLES.items():
        Path(name).write_text(text)
    before = sorted(Path().rglob("*"))
    text = (DATA / "mistakes.toml").read_text(encoding="utf-8")
    by_verb = tomllib.loads(text)["verb"]
    expected = {}
    for verb, mistakes in by_verb.items():
        for words, code in mistakes:
            expected[f"{verb} {words}"] = code
    assert {line: _outcome(line) for line in expected} == expected
    assert {*by_verb} == {*cli.VERBS}
    assert sorted(Path().rglob("*")) == before
    for verb, function in cli.VERBS.items():
        # A batch has what a table does not accept in the row of that table (test_batch).
        if verb == "batch":
            continue
        tried = " ".join(words for words, _ in by_verb[verb])
        for name, parameter in cli.parameters_of(function).items():
            if name not in SURE and not isinstance(parameter.default, bool):
                assert f"--{name.rstrip('_').replace('_', '-')}" in tried, verb


def _raises(code):
    """What holds of a call that ends with this code."""
    return pytest.raises(FitballError, check=lambda error: error.code == code)


@pytest.mark.parametrize(
    ("code", "verb", "data", "options"),
    [
        ("no-data", "calibrate", [], {}),
        ("no-data", "track", None, {}),
        ("not-a-number", "calibrate", "wang_all", {"fix": {"mu": ""}}),
        ("names", "calibrate", "wang_all", {"flip": 3}),
        ("names", "compare", "wang_all", {"models": [len]}),
        ("prior", "calibrate", "wang_all", {"prior": {"mu": 0.5}}),
        ("pairs", "calibrate", "wang_all", {"prior": {"mu": None}}),
        ("pairs", "calibrate", "wang_all", {"fix": {1: 0.5}}),
        ("pairs", "calibrate", "wang_all", {"fix": [("mu", 0.5)]}),
        ("own-model", "calibrate", "wang_all", {"model": len}),
        ("own-model", "batch", "wang_all", {"model": len}),
        ("own-model", "load_fit", "none", {"model": len}),
        ("own-model", "load_batch", "none", {"model": len}),
    ],
)
def test_mistakes_in_python_have_codes_too(code, verb, data, options, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with _raises(code):
        getattr(fitball, verb)(data, **options)


def _options_by_name(function):
    """Options that are values by name."""
    parameters = cli.parameters_of(function).values()
    return [option.name for option in parameters if option.annotation in ("Pairs", "Numbers")]


def test_values_by_name_are_no_text_in_python(tmp_path, monkeypatch):
    """A text, as the command line has it, is refused by every verb and method."""
    monkeypatch.chdir(tmp_path)
    fit = fit_by_hand(table_of(36, ("clay", "hard")))
    needed = {
        "calibrate": {"data": "wang_all"},
        "check": {"data": "wang_all"},
        "compare": {"data": "wang_all"},
        "predict": {"fit": fit, "impact": "v_1=17, theta_1=20 deg"},
        "plan": {"fit": fit},
        "simulate": {"impact": "v_1=17, theta_1=20 deg"},
        "track": {"data": "table_tennis_topspin"},
        "batch": {"data": "wang_all"},
        "export": {"to": "json", "model": "brody"},
    }
    tried = set()
    for verb, function in cli.VERBS.items():
        for option in _options_by_name(function):
            tried.add(verb)
            call = needed.get(verb, {})
            if (verb, option) == ("simulate", "level"):
                call = {**call, "fit": fit}
            with _raises("pairs"):
                function(**call, **{option: "surface=clay"})
    assert tried == {*needed, "rederive"}
    with _raises("count"):
        fit.plan(count=2.5)


def test_a_negative_value_is_no_option():
    assert _parsed("calibrate", "a.csv", "--fix", "eps_10=-0.001")["fix"] == {"eps_10": -0.001}


def test_every_option_has_words():
    for verb in cli.VERBS.values():
        shared = cli.help_of(cli.VERBS["calibrate"]).arguments
        words = cli.help_of(verb)
        parameters = dict(cli.parameters_of(verb))
        parameters.pop("progress", None)
        assert words.summary
        assert set(parameters) <= set(words.arguments) | set(shared)
        # A flag is off, and means the same in every verb.
        for parameter in parameters.values():
            assert parameter.default is not True


@pytest.mark.parametrize(
    ("verb", "options", "folder"),
    [
        ("calibrate", {"data": ["a/b.csv"], "model": ""}, "fits/b/default"),
        ("calibrate", {"data": ["b.csv", "c.csv"], "model": "own/f.py:g"}, "fits/b/f.py_g"),
        ("calibrate", {"data": ["fits/clip/track/impacts.csv"], "model": ""}, "fits/clip/default"),
        # Two sheets are two tables; the number of a descriptor is another in each call.
        ("calibrate", {"data": ["b.xlsx#two"], "model": ""}, "fits/b-two/default"),
        ("calibrate", {"data": ["...csv"], "model": ".."}, "fits/_/_"),
        ("calibrate", {"data": ["/dev/fd/63"], "model": ""}, "fits/pipe/default"),
        ("calibrate", {"data": [""], "model": ""}, "fits/calibrate"),
        ("predict", {"fit": "fits/b/default", "data": "new.csv"}, "fits/b/default/predict"),
        ("compare", {"data": ["b.csv"]}, "fits/b/compare"),
        ("rederive", {}, "fits/rederive"),
    ],
)
def test_where_a_result_goes(verb, options, folder):
    assert cli.default_folder(verb, options).as_posix() == folder


def test_what_is_of_a_fit_goes_below_it_and_beside_what_is_there(tmp_path):
    options = {"data": [str(tmp_path)], "model": ""}
    folder = cli.default_folder("calibrate", options)
    assert folder == tmp_path / "calibrate"
    assert cli.next_free_folder(folder) == folder
    for name, following in (
        ("calibrate", "calibrate-2"),
        ("calibrate-2", "calibrate-3"),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / "report.html").touch()
        assert cli.next_free_folder(folder) == tmp_path / following


def imports_of(words, packages):
    """What a command prints, run by itself, and which of these packages it imported."""
    code = (
        f"import sys, fitball.cli as c\ntry:\n    c.main({words!r})\nexcept SystemExit:\n    pass\n"
        f"sys.exit(','.join({packages!r} & set(sys.modules)) or 0)"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", code],
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stdout, done.stderr


def test_help_needs_no_heavy_package():
    heavy = {"numpy", "pandas", "scipy", "numba", "matplotlib", "emcee", "lmfit", "msgspec"}
    printed, imported = imports_of(["calibrate", "--help"], heavy | {"jinja2", "tqdm"})
    assert imported == ""
    assert "--as-read" in printed


def test_a_check_needs_no_package_that_fits():
    fitting = {"scipy", "numba", "matplotlib", "emcee", "lmfit"}
    printed, imported = imports_of(["check", "wang_all"], fitting)
    assert imported == ""
    assert "21 impacts" in printed


def test_the_package_runs_as_a_module():
    done = subprocess.run(
        [sys.executable, "-P", "-m", "fitball", "--version"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0
    assert done.stdout.startswith("fitball ")


def test_too_little_memory_is_said_in_words(capsys, monkeypatch):
    def hungry(data, *, scene=""):
        raise MemoryError("2.9 GiB")

    monkeypatch.setitem(cli.VERBS, "check", hungry)
    hungry.__name__ = "check"
    assert cli.main(["check", "t.csv"]) == 2
    assert "2.9 GiB" in capsys.readouterr().err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_errors_that_nobody_can_read_and_a_backend_that_is_none():
    code = (
        "import sys; from fitball import cli; k = cli.main(['check', 'none.csv']); import "
        "matplotlib; sys.exit(k)"
    )
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-P", "-c", code],
            env={**os.environ, "MPLBACKEND": "no"},
            stderr=full,
        )
    assert done.returncode == 2
