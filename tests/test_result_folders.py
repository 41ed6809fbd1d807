"""Damaged and foreign result folders: held against their structure once, at reading; messages name the field."""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import replace
from importlib.resources import files

import h5py
import jsonschema
import numpy as np
import pytest
from samples import problem_of, restored

import fitball
from fitball.cli.main import main
from fitball.data.scene import Scene
from fitball.data.tables import load_tables
from fitball.errors import ParameterError, ResultFolderError
from fitball.inference.calibrate import run
from fitball.inference.effort import Effort
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.sampling.chain_file import ChainFile, EnsembleChain
from fitball.repeat import write_numbers
from fitball.report.saved.fit_file import fit_schema
from fitball.report.saved.netcdf_files import write_data, write_netcdf
from fitball.report.saved.structure import read_json, read_toml
from fitball.values import Ball

SCHEMA = json.loads((files("fitball.report") / "fit.schema.json").read_text(encoding="utf-8"))


@pytest.fixture
def copy(small_fit, tmp_path):
    """A copy of a short fit that a test may spoil."""
    shutil.copytree(small_fit, tmp_path / "fit")
    return tmp_path / "fit"


def spoilt(folder, path, value):
    """Put `value` at a dotted place of `fit.json`, or take away what is there (...)."""
    content = json.loads((folder / "fit.json").read_text(encoding="utf-8"))
    node = content
    *way, last = path.split("/")
    for key in way:
        node = node[int(key) if isinstance(node, list) else key]
    last = int(last) if isinstance(node, list) else last
    if value is ...:
        del node[last]
    else:
        node[last] = value
    (folder / "fit.json").write_text(json.dumps(content), encoding="utf-8")
    return content


def test_the_published_schema_is_that_of_the_structure():
    """After a change: write `json.dumps(fit_schema(), indent=1)` and a newline to fitball/report/fit.schema.json."""
    assert json.loads(json.dumps(fit_schema())) == SCHEMA
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


# Place in fit.json, what is put there, and what the message says of it: what is wrong by itself, and what agrees with
# the schema and contradicts the rest of the file.
TYPED = [
    ("parameters/mu/sd", "0.1", "parameters.mu.sd: read '0.1', expected a number or null, got a text"),
    ("parameters/e_x/verdict", "certain", "parameters.e_x.verdict: read 'certain'"),
    ("parameters/mu/unit", ..., "parameters.mu: read {"),
    ("parameters/mu", 3, "parameters.mu: read 3, expected a section"),
    ("source/sha256", "1234", "source.sha256: read '1234'"),
    ("source/impacts", 7.5, "source.impacts: read 7.5, expected a whole number"),
    ("fitted/options", {"cor": 3}, "fitted.options.cor: read 3, expected a text"),
    ("fitted/ball/mass", "heavy", "fitted.ball.mass: read 'heavy'"),
    ("identifiability/evidence/mu/profile/drop", [1.0, "x"], "identifiability.evidence.mu.profile.drop: read"),
    ("identifiability/evidence/mu/profile/ends/0", 3, "identifiability.evidence.mu.profile.ends[0]: read 3"),
    (
        "identifiability/eigendirections/directions/0/components/mu",
        None,
        "components.mu: read None, expected a number",
    ),
    ("fitted/draws/3/2", True, "fitted.draws: read [["),
    ("seed", -1, "seed: read -1"),
]
FIELDS = [
    *TYPED,
    ("fitted/ball/mass", -0.05, "ball mass = -0.05: expected a number"),
    ("fitted/ball/radius", 1e300, "ball radius = 1e+300: expected a number from 1e-30"),
    ("fitted/ball/inertia", 1.0, "ball inertia = 1 kg m^2 exceeds"),
    ("surprise", 1, "unknown field surprise"),
    ("golden/rebound/v_z2", [], "unknown field golden.rebound.v_z2"),
    ("parameters/mu/name", "nu", "parameters, names: read nu, e_x"),
    ("fitted/point/0", 0.5, "fitted.point of mu: read 0.5, but its point is"),
    ("golden/rebound/v_x2/0", None, "golden.rebound.v_x2: a number is missing"),
    ("covariance/0/0", None, "covariance: expected finite numbers"),
    ("diagnostics/r_hat/mu", ..., "diagnostics.r_hat: read"),
    ("golden/impacts/omega_1/0", 1e9, "golden.impacts: a speed or spin beyond"),
    ("fitted/names/0", "nu", "fitted.names: read nu, e_x"),
    ("fitted/point", [0.5], "fitted.point: numbers of shape (1,), expected (7,)"),
    ("fitted/draws/3", [0.5], "fitted.draws: read [["),
    ("fitted/draws/3/0", -4.0, "fitted.draws of mu: outside its bounds [0, 5]"),
    ("parameters/cor_10/q16", 7.0, "parameters.cor_10: outside its bounds"),
    ("parameters/mu/prior", "normal(1)", "prior of mu: read 'normal(1)'"),
    ("parameters/mu/unit", "kg", "parameters.mu.unit: read 'kg', expected ''"),
    ("fitted/model_name", "grip-slap", "unknown model 'grip-slap'"),
    ("fitted/model_name", "two-mass", "parameters: without mass_ratio"),
    ("status", "point only", "status is 'point only', but"),
    ("diagnostics/warm_up", 100, "100 steps of warm-up in 100 steps"),
    ("golden/rebound/v_x2", [1.0], "differ in number"),
    ("golden/rebound/regime/0", 7, "7 is no sequence of phases"),
    ("golden/parameters/mu", 9.0, "golden.parameters of mu: read 9.0, but its point is"),
    ("covariance/2", [1.0], "covariance: read [["),
    ("identifiability/evidence/mu", ..., "identifiability.evidence: read e_x"),
    ("identifiability/evidence/mu/profile/values/1", 4.9, "profile of mu: its values do not rise"),
    ("source/measurements/0", "v_y2", "a name comes twice"),
]


@pytest.mark.parametrize(("path", "value", "said"), FIELDS)
def test_a_wrong_field_is_named_with_what_was_read(copy, path, value, said):
    spoilt(copy, path, value)
    with pytest.raises(ResultFolderError) as caught:
        fitball.load_fit(copy)
    assert said in str(caught.value)
    assert str(caught.value).startswith(f"{copy / 'fit.json'}: damaged: ")
    assert len(str(caught.value)) < 1000


def test_the_schema_refuses_what_is_wrong_by_itself(copy):
    """That parts contradict each other, or lie beyond bounds, no schema can say."""
    validator = jsonschema.Draft202012Validator(SCHEMA)
    original = (copy / "fit.json").read_bytes()
    validator.validate(json.loads(original))
    for k, (path, value, _said) in enumerate(FIELDS):
        assert validator.is_valid(spoilt(copy, path, value)) is (k >= len(TYPED)), path
        (copy / "fit.json").write_bytes(original)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b'{"a": 1, "a": 2}', "key 'a' comes twice"),
        (b'{"a": [{"b": 1, "b": 1}]}', "key 'b' comes twice"),
        (b'{"a": NaN}', "invalid character"),
        (b'{"a": Infinity}', "invalid character"),
        (b'{"a": 1e400}', "out of range"),
        (b'{"a": ' + b"9" * 5000 + b"}", ""),
        (b'{"a": "\\ud800 and more"}', "surrogate"),
        (b"[" * 100_000, "nested brackets"),
        (b"\xff\xfe{}", ""),
        (b"\xef\xbb\xbf{}", ""),
        (b'{"a": 1', "truncated"),
        (b"", "truncated"),
        (b'{"a": 1} 2', "trailing"),
    ],
)
def test_json_that_is_none_or_not_unique(tmp_path, text, said):
    (tmp_path / "fit.json").write_bytes(text)
    with pytest.raises(ResultFolderError, match="not readable as JSON") as caught:
        read_json(tmp_path / "fit.json")
    assert said in str(caught.value)


@pytest.mark.parametrize("text", ["a = nan", "a = -inf", "a = 1e999", "a = 1\na = 2", "a = " + "[" * 5000, "a"])
def test_toml_that_is_none_or_not_finite(tmp_path, text):
    (tmp_path / "run.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ResultFolderError, match="not readable as TOML"):
        read_toml(tmp_path / "run.toml")


def test_what_is_no_file(copy, capsys):
    """A folder or a link to itself where a file belongs, a name too long for any file."""
    for name in ("fit.json", "posterior.nc"):
        place = copy / name
        kept = place.read_bytes()
        place.unlink()
        place.mkdir()
        assert main(["predict", str(copy), "--impact", "v_y=10"]) == 2
        assert f"{name}: not a file" in capsys.readouterr().err
        place.rmdir()
        place.symlink_to(name)
        assert main(["predict", str(copy), "--impact", "v_y=10"]) == 2
        place.unlink()
        place.write_bytes(kept)
    for words in (["predict", "x" * 5000, "--impact", "v_y=10"], ["repeat", "x" * 5000]):
        assert main(words) == 2
        assert "Traceback" not in capsys.readouterr().err


def test_the_folder_of_a_table_names_the_results_in_it(tmp_path, capsys):
    for name in ("brody", "two-mass"):
        (tmp_path / "balls" / name).mkdir(parents=True)
        (tmp_path / "balls" / name / "fit.json").write_text("{}")
    assert main(["export", str(tmp_path / "balls"), "--to", "c"]) == 2
    said = capsys.readouterr().err
    assert f"did you mean {tmp_path / 'balls' / 'brody'} or {tmp_path / 'balls' / 'two-mass'}?" in said


def test_a_folder_in_the_place_of_a_result_is_not_replaced(tmp_path, capsys):
    (tmp_path / "out" / "fit.json").mkdir(parents=True)
    command = ["calibrate", "wang_zero_spin.csv", "--model", "brody", "--point-only", "--out", str(tmp_path / "out")]
    assert main([*command, "--overwrite"]) == 2
    assert "fit.json: is a folder" in capsys.readouterr().err


def _replace(name, array):
    def spoil(file):
        del file[name]
        file[name] = array(file) if callable(array) else array

    return spoil


def _entry(name, value):
    def spoil(file):
        file[name][3, 2] = value

    return spoil


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_entry("posterior/mu", np.nan), "/posterior/mu: entry [3, 2] is not a finite number"),
        (_entry("posterior/mu", -7.0), "draws of mu lie outside its bounds"),
        (_entry("sample_stats/lp", np.inf), "/sample_stats/lp: entry [3, 2]"),
        (_replace("posterior/mu", np.zeros((3, 4))), "read float64 of shape 3 x 4, expected floating-point numbers"),
        (_replace("posterior/mu", np.zeros((112, 50), dtype=int)), "read int64"),
        (_replace("posterior/mu", b"text"), "expected floating-point numbers"),
        (_replace("prior/mu", np.zeros((2, 9))), "/prior/mu: read float64 of shape 2 x 9"),
        (_replace("prior/mu", np.full((1, 9), 0.5)), "not the posterior draws"),
        (_replace("posterior/ensemble", np.zeros(112, dtype=int)), "expected 28 chains of each of 4 ensembles"),
        (lambda file: file.__delitem__("posterior/e_x"), "no array /posterior/e_x"),
        (lambda file: file.__delitem__("prior"), "no group prior"),
        (lambda file: file["posterior/mu"].__setitem__(..., file["posterior/mu"][...] + 1e-9), "of another fit"),
    ],
)
def test_a_damaged_posterior_is_refused(copy, spoil, said):
    with h5py.File(copy / "posterior.nc", "r+") as file:
        spoil(file)
    with pytest.raises(ResultFolderError) as caught:
        fitball.load_fit(copy).predict_interval(fitball.impacts(15.0, 6.0))
    assert said in str(caught.value)


def test_an_array_longer_than_its_file_is_not_read(copy):
    """A damaged length must not fill the memory: of the prior's draws nothing else says how many there are."""
    with h5py.File(copy / "posterior.nc", "r+") as file:
        del file["prior/mu"]
        file["prior"].create_dataset("mu", shape=(1, 10**12), dtype="f8", chunks=(1, 1000))
    with pytest.raises(ResultFolderError, match="more than the file has room for"):
        restored(copy)


def test_no_profiler_changes_the_bytes_of_a_netcdf_file(short_fit, tmp_path):
    # A frame that a profiler holds keeps what it knows alive, and HDF5 the room of a deleted array taken.
    files = {}
    for held in (False, True):
        frames = []
        before = sys.getprofile()
        if held:
            sys.setprofile(lambda frame, *_: frames.append(frame))  # noqa: B023 - called within this turn
        try:
            write_data(short_fit.problem, tmp_path / "data.nc")
            write_netcdf(short_fit, short_fit.posterior, tmp_path / "posterior.nc")
        finally:
            sys.setprofile(before)
        assert bool(frames) is held
        files[held] = [(tmp_path / name).read_bytes() for name in ("data.nc", "posterior.nc")]
    assert files[False] == files[True]


def test_a_label_with_a_slash_ends_in_no_other_group(tmp_path, brief):
    """Names of parameters hold the labels of a pooled column; HDF5 takes a slash for the way into a group."""
    table = load_tables(["wang_zero_spin.csv"])
    halves = tuple("hard/clay" if k < 4 else "grass" for k in range(len(table)))
    table = replace(table, labels={"surface": halves})
    problem = build_problem(table, Scene(), Choices(model="brody", pool={"mu": "surface"}))
    fit = run(problem, Effort(max_steps=100, cores=1, ensembles=2))
    write_numbers(fit, tmp_path)
    saved = fitball.load_fit(tmp_path)
    assert "mu_place[hard/clay]" in saved.free_names
    assert saved.posterior.values.tobytes() == fit.posterior.values.tobytes()
    assert main(["export", str(tmp_path), "--to", "netcdf"]) == 0


NAMES = ("mu", "e_x")
STATE = np.random.RandomState(3).get_state()


@pytest.fixture
def chain(tmp_path):
    """A chain file of two ensembles, 5 steps of 8 walkers over two parameters."""
    rng = np.random.default_rng(1)
    kept = ChainFile(tmp_path / "posterior.h5", "mark")
    parts = [EnsembleChain(rng.normal(size=(5, 8, 2)), rng.normal(size=(5, 8)), np.ones(8), STATE) for _ in range(2)]
    kept.write(parts, NAMES, (True, False))
    read = kept.read(2, 8, NAMES)
    assert read[1].chain.tobytes() == parts[1].chain.tobytes()
    return kept


def _state(index, value):
    return lambda file: file["ensemble_1"].attrs.__setitem__(f"random_state_{index}", value)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda file: file["ensemble_1/chain"].__setitem__((3, 2, 1), np.nan), "is not a finite number"),
        (lambda file: file["ensemble_1/chain"].__setitem__((3, 2, 1), 0.25), "damaged: read"),
        (lambda file: file["ensemble_0/log_prob"].__setitem__((4, 2), 1e308), "damaged: read"),
        (lambda file: file["ensemble_0/accepted"].__setitem__(4, 3), "damaged: read"),
        (lambda file: file.__delitem__("ensemble_1"), "damaged: read (1, 8, 2)"),
        (lambda file: file.__delitem__("ensemble_0"), "no group ensemble_0"),
        (lambda file: file.attrs.__delitem__("sha256"), "which older fitballs did not write"),
        (lambda file: file.attrs.__delitem__("fingerprint"), "not the chain of a fit"),
        (_replace("ensemble_1/log_prob", np.zeros((5, 7))), "expected floating-point numbers of shape 5 x 8"),
        (_replace("ensemble_1/chain", np.zeros((5, 6, 2))), "of shape any x 8 x 2"),
        (_state(0, "PCG64"), "not the state of a Mersenne twister"),
        (_state(1, np.zeros(7, dtype=np.uint32)), "not the state of a Mersenne twister"),
        (_state(2, 10**6), "not the state of a Mersenne twister"),
        (_state(2, 17), "damaged: read"),
        (_state(4, np.nan), "not the state of a Mersenne twister"),
    ],
)
def test_a_damaged_chain_is_not_resumed(chain, spoil, said):
    with h5py.File(chain.path, "r+") as file:
        spoil(file)
    with pytest.raises(ResultFolderError) as caught:
        chain.read(2, 8, NAMES)
    assert said in str(caught.value)


def test_a_whole_chain_of_other_shape_is_not_resumed(chain):
    for expected in ((3, 8, NAMES), (2, 10, NAMES), (2, 8, ("mu",))):
        with pytest.raises(ResultFolderError, match=r"read \(2, 8, 2\) ensembles, walkers and parameters"):
            chain.read(*expected)


def test_a_chain_that_is_cut_off_or_no_file_is_not_resumed(chain):
    kept = chain.path.read_bytes()
    for count in range(0, len(kept), len(kept) // 40):
        chain.path.write_bytes(kept[:count])
        with pytest.raises(ResultFolderError, match=r"posterior\.h5"):
            chain.read(2, 8, NAMES)
    chain.path.unlink()
    chain.path.mkdir()
    with pytest.raises(ResultFolderError, match="not a file"):
        chain.read(2, 8, NAMES)


def test_more_walkers_than_any_memory_holds():
    problem = problem_of("wang_zero_spin.csv", "brody")
    with pytest.raises(ParameterError, match="at most 20000 in all"):
        Effort(walkers=10**9).settings(problem)
    with pytest.raises(ParameterError, match="ball radius"):
        Ball(radius=1e200)
