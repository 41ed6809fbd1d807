"""`fitball repeat`: bit-equal, equal within tolerance, or different and where."""

from __future__ import annotations

import json
import shutil
from contextlib import contextmanager
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import xarray as xr
from samples import problem_of, search_briefly

from fitball.api import begin, pose
from fitball.cli.main import main
from fitball.data.bundled import bundled_folder
from fitball.data.scene import load_scene
from fitball.data.tables import load_tables
from fitball.errors import ResultFolderError
from fitball.inference.calibrate import fingerprint
from fitball.inference.effort import Effort
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.results.source import digest
from fitball.inference.sampling.convergence import standard_errors, summaries
from fitball.repeat import Outcome, compared, read_kept, write_numbers
from fitball.report.saved.run_file import find_tables, read_run, record_problem, run_text

BALLS = """id,v_x1 [m/s],v_y1 [m/s],omega_1 [rpm],v_x2 [m/s],v_y2 [m/s],omega_2 [rpm]
a,16.0,5.0,0,11.5,4.1,2400
b,15.0,7.5,50,8.9,6.0,2700
c,13.0,10.0,0,7.6,7.6,2500
d,10.0,13.0,-30,5.6,9.5,1900
e,6.0,15.0,10,2.9,10.6,1000
"""


@pytest.fixture(scope="module", autouse=True)
def _briefly():
    """What is made and made again is the same short search."""
    with pytest.MonkeyPatch.context() as patch:
        search_briefly(patch)
        yield


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A table and, in `fit/`, a converged fit of it without its figures."""
    place = tmp_path_factory.mktemp("repeat")
    (place / "balls.csv").write_text(BALLS, encoding="utf-8")
    problem = problem_of(place / "balls.csv", "grip-slip")
    write(problem, Effort(seed=5, cores=1, walkers=16, ensembles=2), place / "fit")
    pooled(place / "point")
    return place


def pooled(folder):
    """A point fit of two tables, without its figures."""
    names = ["wang_zero_spin.csv", "wang_topspin.csv"]
    write(pose(names, Choices(model="grip-slip", pool={"mu": "table"})), Effort(point_only=True, cores=1), folder)


def write(problem, effort, folder):
    """What `repeat` needs of a result folder."""
    fit = begin(problem, effort, folder).fit()
    write_numbers(fit, folder)
    (folder / "run.toml").write_text(run_text(fit, folder), encoding="utf-8")


@pytest.fixture
def copy(home, tmp_path):
    """A copy of all of it that a test may spoil."""
    shutil.copytree(home, tmp_path / "copy")
    return tmp_path / "copy"


@pytest.fixture(scope="module")
def problem(home):
    record = read_run(home / "fit")
    return record_problem(record, find_tables(record))


def content(folder):
    return {item.name: item.read_bytes() for item in sorted(folder.iterdir())}


def edited(copy, old, new):
    """A changed copy of `run.toml`, beside it."""
    text = (copy / "fit" / "run.toml").read_text(encoding="utf-8")
    assert old in text
    (copy / "fit" / "changed.toml").write_text(text.replace(old, new), encoding="utf-8")
    return str(copy / "fit" / "changed.toml")


def test_the_same_bytes_on_two_cores_and_the_original_untouched(home, capsys):
    before = content(home / "fit")
    assert main(["repeat", str(home / "fit" / "fit.json"), "--cores", "2", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["outcome"] == "bit-equal"
    assert found["same_bytes"] == {"fit.json": True, "draws": True, "chain": True}
    assert found["different"] == []
    assert content(home / "fit") == before


def test_another_seed_is_equal_within_monte_carlo_error(copy, capsys):
    assert main(["repeat", edited(copy, "seed = 5", "seed = 6"), "--json"]) == 0
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert found["outcome"] == "equal within tolerance"
    assert "run.toml has seed 6, but the fit used seed 5" in err
    assert not any(found["same_bytes"].values())
    ratios = [item["ratio"] for item in found["compared"] if item["ratio"] is not None]
    assert len(ratios) == 7 * 8
    # Not all nearly zero either: the errors are no wider than what another seed moves.
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.6
    assert found["largest"]["ratio"] == max(ratios) < found["limit"] < 5.0


def test_a_table_of_a_batch_is_repeated_without_its_draws(copy, capsys):
    (copy / "fit" / "posterior.nc").unlink()
    (copy / "fit" / "posterior.h5").unlink(missing_ok=True)
    (copy / "fit" / "row.json").write_text("{}", encoding="utf-8")
    assert main(["repeat", str(copy / "fit"), "--cores", "1"]) == 0
    assert "all numbers of fit.json (its draws were not kept): the same bytes" in capsys.readouterr().out
    main(["repeat", edited(copy, "seed = ", "seed = 1"), "--cores", "1"])
    assert "standard errors." in capsys.readouterr().out


def test_another_prior_is_different(copy, capsys):
    assert main(["repeat", edited(copy, 'mu = "lognormal(0.6, 0.4)"', 'mu = "lognormal(0.55, 0.05)"')]) == 1
    out, err = capsys.readouterr()
    assert "repeated: different" in out
    assert "mu median" in out
    assert "run.toml has the prior lognormal(0.55, 0.05) for mu" in err


def test_a_standard_error_is_the_scatter_of_numbers_sampled_anew():
    """Of an autoregressive chain, whose effective sample size is known."""
    rng = np.random.default_rng(3)

    def chains():
        found = np.empty((2, 400, 8))
        state = rng.standard_normal((2, 8))
        for k in range(400):
            state = 0.6 * state + 0.8 * rng.standard_normal((2, 8))
            found[:, k] = state
        return found

    made = [chains() for _ in range(40)]
    scatter = {name: np.std([summaries(item)[name] for item in made], ddof=1) for name in summaries(made[0])}
    stated = {name: np.mean([standard_errors(item)[name] for item in made[:3]]) for name in scatter}
    for name, value in scatter.items():
        assert stated[name] == pytest.approx(value, rel=0.3), name
    # That of independent draws is half as large: the control.
    assert scatter["median"] > 1.5 * np.sqrt(np.pi / 2.0 / (2 * 400 * 8))


@contextmanager
def changed(folder):
    """What `fit.json` says, to be changed."""
    said = json.loads((folder / "fit.json").read_text(encoding="utf-8"))
    yield said
    (folder / "fit.json").write_text(json.dumps(said), encoding="utf-8")


def spoil_number(folder, name, number, factor):
    with changed(folder) as said:
        said["parameters"][name][number] *= factor


def beside_other_draws(problem, copy, home):
    """A spoilt fit compared where bits say nothing."""
    other = read_kept(home / "fit")
    shifted = replace(other.posterior, values=other.posterior.values * (1.0 + 1e-7))
    return compared(problem, read_kept(copy / "fit"), replace(other, posterior=shifted, chains=None))


def spoil_draw(folder, name):
    with xr.open_datatree(folder / "posterior.nc", engine="h5netcdf") as tree:
        tree.load()
    tree["posterior"][name].values[3, 7] *= 1.0 + 1e-9
    (folder / "posterior.nc").unlink()
    tree.to_netcdf(folder / "posterior.nc", engine="h5netcdf")


def spoil_chain(folder):
    with h5py.File(folder / "posterior.h5", "r+") as file:
        file["ensemble_1/chain"][warm_up(folder) + 7, 2, 4] += 1e-6


def warm_up(folder):
    return json.loads((folder / "fit.json").read_text("utf-8"))["diagnostics"]["warm_up"]


@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (lambda folder: spoil_number(folder, "e_x", "median", 1.0 + 1e-6), "e_x median"),
        (lambda folder: spoil_number(folder, "mu", "contraction", 0.9), "mu contraction"),
        (lambda folder: spoil_draw(folder, "offset"), "offset draw (ensemble 0, step {}, walker 3)"),
        (spoil_chain, "cor_slope draw (ensemble 1, step {}, walker 2)"),
    ],
)
def test_a_number_changed_by_hand_is_found_and_named(home, copy, problem, spoil, named):
    spoil(copy / "fit")
    found = compared(problem, read_kept(copy / "fit"), read_kept(home / "fit"))
    assert found.outcome is Outcome.DIFFERENT
    named = named.format(warm_up(copy / "fit") + 7)
    assert named in [item.what for item in found.different]
    assert {item.what.split()[0] for item in found.different} == {named.split()[0]}


def test_a_changed_number_is_found_beside_another_seed_too(home, copy, problem):
    """There the bits say nothing: the draws of the fit itself must bear its numbers out."""
    spoil_number(copy / "fit", "e_x", "sd", 1.0 + 1e-6)
    assert [item.what for item in beside_other_draws(problem, copy, home).different] == ["e_x sd"]


def test_golden_impacts_are_bounced_anew(home, copy, problem):
    with changed(copy / "fit") as said:
        said["golden"]["rebound"]["v_x2"][3] += 1e-6
    found = compared(problem, read_kept(copy / "fit"), read_kept(home / "fit"))
    assert "golden impact 4 v_x2" in [item.what for item in found.different]


def test_a_changed_verdict_is_a_difference(home, copy, problem):
    with changed(copy / "fit") as said:
        said["parameters"]["mu"]["verdict"] = "prior-dominated"
    assert [item.what for item in beside_other_draws(problem, copy, home).different] == ["mu verdict"]


def test_other_versions_are_said_and_their_rounding_allowed(home, copy, problem):
    with changed(copy / "fit") as said:
        said["versions"]["numba"] = "0.1"
        said["covariance"][0][0] *= 1.0 + 1e-6
    found = compared(problem, read_kept(copy / "fit"), read_kept(home / "fit"))
    assert found.outcome is Outcome.WITHIN
    assert "numba 0.1, now" in found.notes[0]


def test_changed_and_missing_data(copy, capsys):
    place = copy / "balls.csv"
    then = sha256(place.read_bytes()).hexdigest()
    place.write_text(BALLS.replace("11.5", "11.6"), encoding="utf-8")
    now = sha256(place.read_bytes()).hexdigest()
    assert main(["repeat", str(copy / "fit")]) == 2
    err = capsys.readouterr().err
    assert then in err
    assert now in err
    assert "changed since the fit" in err
    place.unlink()
    assert main(["repeat", str(copy / "fit")]) == 2
    err = capsys.readouterr().err
    assert "--data" in err
    assert then in err
    moved = copy / "moved.csv"
    moved.write_text(BALLS, encoding="utf-8")
    record = read_run(copy / "fit")
    assert find_tables(record, [str(moved)]) == (moved,)
    with pytest.raises(ResultFolderError, match="made from 1 table"):
        find_tables(record, [str(moved), str(moved)])


def test_measurements_changed_since_are_refused(copy, capsys):
    place = copy / "fit" / "data.nc"
    with xr.open_dataset(place, engine="h5netcdf") as found:
        spoilt = found.load()
    spoilt["v_y2"][1] += 0.1
    spoilt.to_netcdf(place, engine="h5netcdf")
    assert main(["repeat", str(copy / "fit")]) == 2
    assert "these measurements are not those" in capsys.readouterr().err
    # A fit of a table that was changed in Python before: its own files agree, but not with the table's file.
    with changed(copy / "fit") as said:
        said["source"]["digest"] = digest({name: spoilt[name].to_numpy() for name in spoilt.variables})
    assert main(["repeat", str(copy / "fit")]) == 2
    assert "its v_y2 are not those of" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('kind = "fitball run"\nschema_version = 2\n', "", "run calibrate again"),
        ("schema_version = 2", "schema_version = 9", "reads version 2"),
        ("mass = ", "mess = ", "damaged: unknown field ball.mess"),
        ("seed = 5", 'seed = "five"', "fitball.seed: read 'five', expected a whole number"),
        ('kind = "fitball run"', 'kind = "a recipe"', "read kind 'a recipe', expected 'fitball run'"),
    ],
)
def test_a_run_file_that_cannot_be_used(copy, capsys, old, new, words):
    assert main(["repeat", edited(copy, old, new)]) == 2
    assert words in capsys.readouterr().err


def test_the_new_result_can_be_kept_but_not_over_the_old(copy, capsys, monkeypatch, without_figures):
    monkeypatch.chdir(copy)
    assert main(["repeat", "point", "--out", "point"]) == 2
    said = capsys.readouterr().err
    # Only what the verb has is advised.
    assert "name another folder with --out" in said and "--overwrite" not in said and "--resume" not in said
    assert main(["repeat", "point", "--out", "again"]) == 0
    out = capsys.readouterr().out
    assert "repeated: bit-equal" in out
    assert "a point fit" in out
    first, again = content(copy / "point"), content(copy / "again")
    assert [first[name] for name in ("fit.json", "run.toml")] == [again[name] for name in ("fit.json", "run.toml")]
    assert "report.html" in again


SCENE = """[ball]
mass = { value = 0.0577, sd = 0.0003 }
inertia_ratio = { value = 0.55, sd = 0.01 }
[surface]
name = "clay"
mu = 0.6
[contact_time]
value = 4.0e-3
sd = 0.5e-3
[measurement]
velocity_sd = 0.2
nominal_spin_sd = 7.0
[priors]
eps_slope = "normal(0, 0.0003)"
"""
KINDS = {
    "default": (["balls.csv"], Choices()),
    "closures": (["balls.csv"], Choices(closures={"torsion": "free", "normal": "total"})),
    "scene": (["scene.csv"], Choices(fix={"eps_slope": 1e-4}, priors={"k_y": "lognormal(3e4, 0.5)"})),
    "other model than the scene's": (["scene.csv"], Choices(model="grip-slip")),
    "tables": (["wang_zero_spin.csv", "wang_topspin.csv"], Choices(model="grip-slip", pool={"mu": "table"})),
    "structure": (["wang_all.csv"], Choices(noise="student-t", offsets="group", pool={"cor_10": "group"})),
    "velocity noises apart": (["balls.csv"], Choices(model="grip-slip", velocity_noise="separate")),
    "one velocity noise": (["wang_all.csv"], Choices(model="grip-slip", velocity_noise="tied")),
    "one component known": (["scene.csv"], Choices(model="grip-slip", fix={"v_y_sd": 0.1})),
    "incident": (["incident.csv"], Choices(model="grip-slip")),
    "incident taken as exact": (["incident.csv"], Choices(model="grip-slip", incident_errors=False)),
    "stated errors": (["stated.csv"], Choices(model="grip-slip")),
    "stated errors alone": (["stated.csv"], Choices(model="grip-slip", velocity_noise="stated")),
    "no scatter of one": (["stated.csv"], Choices(model="grip-slip", fix={"v_x_sd": 0.0})),
    "measured COR": (["balls.csv"], Choices(model="thesis-exact", closures={"cor": "measured"})),
    "drop": (["drop.csv"], Choices()),
    "no spin": (["nospin.csv"], Choices()),
}


@pytest.mark.parametrize("kind", KINDS)
def test_run_toml_holds_all_that_defines_the_problem(tmp_path, kind):
    rows = [line.split(",") for line in BALLS.splitlines()]
    (tmp_path / "balls.csv").write_text(BALLS, encoding="utf-8")
    (tmp_path / "scene.csv").write_text(BALLS, encoding="utf-8")
    (tmp_path / "scene.toml").write_text(SCENE, encoding="utf-8")
    sds = ["v_x1_sd,omega_1_sd [rpm]", *["0.2,50"] * 5]
    lines = [",".join([*row, sd]) for row, sd in zip(rows, sds, strict=True)]
    (tmp_path / "incident.csv").write_text("\n".join(lines), encoding="utf-8")
    sds = ["v_x2_sd,omega_2_sd [rpm]", *["0.02,10"] * 5]
    lines = [",".join([*row, sd]) for row, sd in zip(rows, sds, strict=True)]
    (tmp_path / "stated.csv").write_text("\n".join(lines), encoding="utf-8")
    (tmp_path / "drop.csv").write_text("v_y1,v_y2\n3,2.5\n7,5.4\n", encoding="utf-8")
    (tmp_path / "nospin.csv").write_text("\n".join(",".join([*r[1:3], *r[4:6]]) for r in rows), encoding="utf-8")
    names, choices = KINDS[kind]
    sources = [str(tmp_path / name) if (tmp_path / name).exists() else name for name in names]
    table = load_tables(sources)
    made = build_problem(table, load_scene(sources[0]), choices)
    effort = Effort(seed=8, walkers=64, max_steps=800, ess=333.0)
    found = SimpleNamespace(
        ensembles=effort.ensembles, walkers=64, steps=700, max_steps=effort.max_steps, target_ess=effort.ess
    )
    values = dict.fromkeys(item.name for item in made.parameters)
    fit = SimpleNamespace(problem=made, seed=8, diagnostics=found, point=SimpleNamespace(values=values))
    (tmp_path / "run.toml").write_text(run_text(fit, tmp_path), encoding="utf-8")
    record = read_run(tmp_path)
    again = record_problem(record, find_tables(record))
    assert replace(record.effort, cores=effort.cores) == effort
    assert again.parameters == made.parameters
    assert again.notes == made.notes
    assert again.scene.nominal_spin_sd == made.scene.nominal_spin_sd
    assert again.scene.velocity_sd == made.scene.velocity_sd
    assert dict(again.scene.ball_sd) == dict(made.scene.ball_sd)
    assert fingerprint(again, effort) == fingerprint(made, effort)


def test_run_toml_names_tables_from_the_result_folder(home):
    (table,) = read_run(home / "fit").file.table.files
    assert (table.file, table.bundled) == ("../balls.csv", False)
    assert not Path(table.file).is_absolute()
    wang = load_tables([bundled_folder() / "wang_all.csv"])
    assert wang.files == ((str((bundled_folder() / "wang_all.csv").resolve()), wang.digest),)
