"""Many tables: names, what fails, what stays, laboratory tests and populations over them."""

import json
import os
import signal
import sys
from hashlib import sha256

import cloudpickle
import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgba
from support.drawn import cut_off
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball.base.errors import FolderError, InputError, MachineError, ModelError, ParameterError
from fitball.batches import many, page, rows
from fitball.batches.batch import Batch
from fitball.batches.tables import safe_name, tables_by_name
from fitball.cli import main
from fitball.data.scene import BallSection
from fitball.report.render import to_text
from fitball.report.style import MODEL_COLOUR

# Workers cannot import this file: what it defines travels whole.
cloudpickle.register_pickle_by_value(sys.modules[__name__])
GOOD = [f"court {k}" for k in range(1, 4)]


class Deadly:
    """A table that ends the process that reads it, but for ours."""

    def __init__(self):
        self.ours = os.getpid()

    @property
    def iloc(self):
        return None if os.getpid() == self.ours else os.kill(os.getpid(), signal.SIGKILL)


WRONG = {
    "flip": ("odd", "unknown-column"),
    "ignore": ("odd", "unknown-column"),
    "columns": ({"odd": "v_x1"}, "columns"),
    "fix": ({"odd": 1.0}, "unknown-parameter"),
    "prior": ({"mu": "odd(1)"}, "prior"),
    "pool": ({"mu": "odd"}, "unknown-label-column"),
}


@pytest.mark.parametrize("option", WRONG)
def test_every_table_gets_the_options(option, courts):
    value, code = WRONG[option]
    batch = fitball.batch(
        [courts / "court 1.csv"],
        out="all",
        cores=1,
        figures="none",
        **{option: value},
    )
    assert batch.tables["code"].tolist() == [code]


@pytest.fixture
def courts(tmp_path, monkeypatch):
    """Three good tables, one broken, one empty, and what is no table."""
    folder = tmp_path / "courts"
    folder.mkdir()
    for k, name in enumerate(GOOD):
        table_of(8 + k).to_csv(folder / f"{name}.csv", index=False)
    (folder / "broken.csv").write_text("v_1,theta_1,v_y2\n17,much,5\n18,200,5\n")
    (folder / "empty.csv").write_text("")
    (folder / "notes.md").write_text("not a table")
    monkeypatch.chdir(tmp_path)
    return folder


OPTIONS = {"model": "brody", "point_only": True, "progress": False}


def test_a_scene_of_a_folder_counts_for_its_tables(courts):
    """A table with a scene of its own keeps that; one outside has none."""
    (courts / "lot.toml").write_text("[ball]\nmass = 0.05\n")
    (courts / "court 2.toml").write_text("[ball]\nmass = 0.06\n")
    outside = courts.parent / "outside.csv"
    outside.write_bytes((courts / "court 1.csv").read_bytes())
    sources = iter([courts, outside])
    batch = fitball.batch(sources, out="all", cores=1, figures="none", **OPTIONS)
    masses = {name: batch[name].run.scene.ball.mass for name in (*GOOD, "outside")}
    assert masses == {"court 1": 0.05, "court 2": 0.06, "court 3": 0.05, "outside": None}
    assert [note.code for note in batch.notes] == ["scene-of-folder", "no-posterior"]
    options = {"out": "other", "cores": 1, "figures": "none", **OPTIONS}
    stated = fitball.batch([courts], scene=fitball.Scene(ball=BallSection(mass=0.055)), **options)
    assert {stated[name].run.scene.ball.mass for name in GOOD} == {0.055}
    assert [note.code for note in stated.notes] == ["no-posterior"]


def test_several_scenes_of_a_folder_are_refused(courts):
    for name in ("lot.toml", "other.toml"):
        (courts / name).write_text("")
    with pytest.raises(ParameterError) as refusal:
        fitball.batch([courts], out="all", cores=1, figures="none", **OPTIONS)
    assert refusal.value.code == "several-scenes"
    (courts / "other.toml").unlink()
    (courts / "lot.toml").write_text("[project]\n")
    with pytest.raises(InputError) as fault:
        fitball.batch([courts], out="all", cores=1, figures="none", **OPTIONS)
    assert (fault.value.source, fault.value.code) == (str(courts / "lot.toml"), "scene")


@pytest.mark.skipif(os.name != "posix", reason="signals of a POSIX system")
def test_a_table_that_ends_its_process_is_a_failed_row(courts):
    path = courts / "court 1.csv"
    batch = fitball.batch([path, Deadly()], cores=2, figures="none", **OPTIONS)
    assert batch.tables["code"].to_dict() == {"court 1": "", "table": "worker-died"}
    # As calibrate does, whatever the processes.
    alone = fitball.calibrate(path, **OPTIONS)
    assert batch["court 1"] == alone
    assert batch["court 1"].run.key == alone.run.key


def test_what_fails_is_a_row_and_what_is_finished_is_not_fitted_again(courts, capsys):
    batch = fitball.batch([courts], out="all", cores=1, figures="none", **OPTIONS)
    assert list(batch.tables.index) == ["broken", *GOOD, "empty"]
    codes = dict.fromkeys(GOOD, "") | {"broken": "not-a-number", "empty": "empty"}
    assert batch.tables["code"].to_dict() == codes
    assert batch.exit_code == 1
    assert set(batch.failed) == {"broken", "empty"}
    for name in ("broken", "court 9"):
        with pytest.raises(KeyError):
            batch[name]
    folder = courts.parent / "all"
    places = {name: folder / name / "fit.json" for name in GOOD}
    assert sorted(folder.glob("*/fit.json")) == sorted(places.values())
    loaded = fitball.load_batch("all")
    second = loaded["court 2"]
    assert second == batch["court 2"]
    assert second.run.table.name == "court 2"
    assert batch.tables.loc["court 2", "mu"] == second.parameters["mu"].point
    pd.testing.assert_frame_equal(loaded.tables, batch.tables.loc[GOOD], check_dtype=False)
    digest = sha256((courts / "court 2.csv").read_bytes()).hexdigest()
    assert batch.tables.loc["court 2", ["sha256", "seed"]].tolist() == [digest, 1]
    # Files are of the numbers; without the deadly one, in this process, nothing is made again but
    # what was damaged.
    csv = pd.read_csv("all/batch.csv", index_col="table")
    mu = batch.tables["mu"].tolist()
    assert csv["mu"].tolist() == pytest.approx(mu, rel=1e-15, nan_ok=True)
    record = json.loads(places["court 1"].read_text())
    record["headline"] = "edited"
    places["court 1"].write_text(json.dumps(record))
    before = {name: path.stat().st_mtime_ns for name, path in places.items()}
    third = places["court 3"]
    third.unlink()
    del before["court 3"]
    (third.parent / ".fitball-0.partial").write_text("half")
    words = "batch courts --out all --model brody --point-only --as-read --cores 1 --figures none"
    assert main(words.split()) == 1
    rewritten = set()
    for name, path in places.items():
        if path.stat().st_mtime_ns != before.get(name):
            rewritten.add(name)
    assert rewritten == {"court 1", "court 3"}
    assert not list(third.parent.glob("*.partial"))
    text = capsys.readouterr().out
    assert "3 of 5 tables" in text
    assert "broken" in text
    assert str(courts.parent) not in text
    assert "edited" not in places["court 1"].read_text()


def test_fits_of_other_data_stay_unless_they_are_to_be_replaced(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plain = {
        "model": "grip-slip",
        "point_only": True,
        "progress": False,
        "cores": 1,
        "figures": "none",
    }
    tables = {"a": table_of(8), "b: clay": table_of(9)}
    first = fitball.batch(tables, **plain)
    assert list(first.tables.index) == ["a", "b_ clay"]
    assert first.exit_code == 0
    assert first.folder.name == "batch"
    folder = first.folder
    record = folder / "a" / "fit.json"
    contents = record.read_bytes()
    tables["a"] = table_of(10)
    second = fitball.batch(tables, **plain)
    assert second.tables["code"].tolist() == ["older-result", ""]
    assert record.read_bytes() == contents
    third = fitball.batch(tables, overwrite=True, all_files=True, **plain)
    assert third.tables["impacts"].tolist() == [10, 9]
    assert third["a"].run.table.name == "table"
    for name in third.tables.index:
        assert (folder / name / "report.html").exists()
    assert (folder / "report.html").exists()
    assert not list(folder.glob("*.png"))
    # A folder of another result is none of a batch.
    with pytest.raises(FolderError) as caught:
        fitball.batch(tables, out=folder / "a", **plain)
    assert caught.value.code == "older-result"


def test_functions_of_a_user_are_needed_when_fits_are_read(tmp_path):
    def ball(v_x1, v_y1, omega_1, ball, cor="normal(0.75, 0.1)"):
        return v_x1, cor * v_y1, omega_1

    user_model = fitball.model_from(ball)
    options = {**OPTIONS, "model": user_model}
    batch = fitball.batch({"a": table_of(8)}, out=tmp_path, **options)
    assert batch["a"] == fitball.load_batch(tmp_path, user_model)["a"]
    with pytest.raises(ModelError) as caught:
        fitball.load_batch(tmp_path)
    assert caught.value.code == "own-model"


def test_a_function_of_a_file_is_read_with_the_fits_that_it_made(tmp_path, monkeypatch):
    file = tmp_path / "mine.py"
    file.write_text(
        "def ball(v_x1, v_y1, omega_1, ball, cor='normal(0.75, 0.1)'):\n"
        "    return v_x1, cor * v_y1, omega_1\n"
    )
    model = f"{file}:ball"
    options = {**OPTIONS, "model": model, "figures": "none"}
    tables = {"a": table_of(8), "b": table_of(9)}
    batch = fitball.batch(tables, out=tmp_path / "out", cores=2, **options)
    assert batch.tables["code"].tolist() == ["", ""]
    assert batch["a"] == fitball.calibrate(tables["a"], **{**OPTIONS, "model": model})
    assert batch["b"] == fitball.load_batch(tmp_path / "out", model)["b"]
    assert "cor" in batch["b"].parameters
    # What was fitted is not fitted again.
    monkeypatch.setattr(many, "calibrate", lambda *_: 1 / 0)
    again = fitball.batch(tables, out=tmp_path / "out", cores=1, **options)
    assert again.tables["code"].tolist() == ["", ""]
    # A file that cannot be run is a fault of the command, not of each table.
    file.write_text("def ball(:")
    with pytest.raises(ModelError):
        fitball.batch(tables, out=tmp_path / "out", cores=1, **options)


def test_what_is_no_option_and_no_batch(tmp_path):
    for option, error in (
        ({"no_option": 1}, TypeError),
        ({"noise": "odd"}, ParameterError),
    ):
        with pytest.raises(error):
            fitball.batch(["wang_all"], out=tmp_path / "x", **option)
    with pytest.raises(FolderError) as caught:
        fitball.load_batch(tmp_path)
    assert caught.value.code == "no-batch"


def test_a_fault_of_ours_stops_no_other_table(monkeypatch, tmp_path):
    monkeypatch.setattr(many, "calibrate", lambda *_: 1 / 0)
    batch = fitball.batch(
        {"a": table_of(8)},
        out=tmp_path / "x",
        model="grip-slip",
        progress=False,
        cores=1,
    )
    assert batch.tables["code"].tolist() == ["fault-of-fitball"]
    # What names the package travels to workers.
    assert cloudpickle.loads(cloudpickle.dumps(fitball)) is fitball


def different(names):
    """Names that differ where capitals are taken for small letters."""
    return {name.casefold() for name in names}


def test_tables_have_names_that_every_file_system_takes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for path in (
        "a/one.csv",
        "b/one.csv",
        "b/One.txt",
        "b/two.csv",
        "b/two.xlsx",
        "b/notes.toml",
        "b/con.csv",
        "b/caf\u00e9.csv",
        "b/v1.2: x.csv",
        "out/old/one.csv",
    ):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).touch()
    out = tmp_path / "out"
    tables = tables_by_name(["a", "b/*", "./a/one.csv", "wang_all"], out)
    assert list(tables) == [
        "a-one",
        "b-One_txt",
        "caf\u00e9",
        "con_",
        "b-one_csv",
        "b-two_csv",
        "b-two_xlsx",
        "v1_2_ x",
        "wang_all",
    ]
    assert len(tables) == 9
    assert len(different(tables)) == 9
    assert tables["a-one"].endswith("one.csv")
    assert not any("out" in str(table) for table in tables.values())
    assert list(tables_by_name([f"{tmp_path}/**/two.*"], out)) == ["two_csv", "two_xlsx"]
    sheets = ["book.xlsx#one", "book.xlsx#two", "book.xlsx"]
    assert list(tables_by_name(sheets, tmp_path)) == ["book-one", "book-two", "book"]
    assert list(tables_by_name("**/one.csv", out)) == ["a-one", "b-one"]
    frames = [table_of(3), table_of(4)]
    assert list(tables_by_name(frames, tmp_path)) == ["table-1", "table-2"]
    assert len(different(tables_by_name({"Court": 1, "court": 2}, tmp_path))) == 2
    for odd in ("..", "/", "", " . ", "nul", "a" * 300, "\u00e9" * 90, "x\ny", "a/b", "LPT1"):
        name = safe_name(odd)
        assert name
        assert len(name.encode()) <= 101
        assert not set(name) & set('<>:"/\\|?*.\n')
        assert name == name.strip()
        assert name.casefold() not in ("nul", "lpt1")


@pytest.fixture(scope="module")
def batch_of_courts():
    """Five courts and a broken table, of fits that nobody fitted; verdicts go in turn."""
    frames = [table_of(18, ("clay", "hard"))]
    frames += [table_of(14 + k) for k in range(4)]
    fits = {f"court {k}": fit_by_hand(frame) for k, frame in enumerate(frames)}
    results = [rows.record_of(name, fit, "2026-05-01") for name, fit in fits.items()]
    drops = table_of(9, drop=True).assign(ball=list("aaabbbccc"))
    drops["v_y1"] = np.sqrt(2.0 * 9.80665 * 2.54)
    wiggle = 1.0 + 2e-3 * np.sin(np.arange(9))
    drops["v_y2"] = 0.745 * drops["v_y1"] * wiggle
    fits["drops"] = fit_by_hand(drops)
    results.append(rows.record_of("drops", fits["drops"], "2026-05-01"))
    results.append(rows.record_of_failure("bad", MachineError("out of memory", "memory")))
    return many.batch_of(None, results, None, fits.__getitem__)


def test_balls_that_lie_apart_are_named():
    def lot(slow):
        """Six balls, four drops each, of which the last ball may be slow."""
        drops = table_of(24, drop=True).assign(ball=[name for name in "abcdef" for _ in range(4)])
        drops["v_y1"] = np.sqrt(2.0 * 9.80665 * 2.54)
        wiggle = 1.0 + 2e-3 * np.sin(np.arange(24))
        share = np.where(drops["ball"] == "f", slow, 1.0)
        return fit_by_hand(drops.assign(v_y2=0.745 * drops["v_y1"] * wiggle * share))

    fits = {"good": lot(1.0), "bad": lot(0.9)}
    records = [rows.record_of(name, fit, "2026-05-01") for name, fit in fits.items()]
    batch = many.batch_of(None, records, None, fits.__getitem__)
    assert batch.tables.loc["bad", "outlying"] == "f"
    assert batch.tables["outlying"].isna()["good"]
    assert "f of bad" in note(batch, "outlying-balls")
    assert note(many.batch_of(None, records[:1], None, fits.__getitem__), "outlying-balls") == ""


def note(batch, code):
    """The text of the note of that code, or "" where there is none."""
    return "".join(one.text for one in batch.notes if one.code == code)


def test_a_row_has_labels_verdicts_and_laboratory_tests(batch_of_courts):
    tables = batch_of_courts.tables
    assert tables.loc["court 1", "mu_verdict"] == "given"
    assert np.isnan(tables.loc["court 0", "mu"])
    cor = fit_by_hand(table_of(14)).parameters["cor_10"]
    assert tables.loc["court 1", "cor_10"] == cor.median
    assert cor.median != cor.point
    assert tables.loc["court 0", "mu[clay]_q025"] < tables.loc["court 0", "mu[clay]"]
    drop = tables.loc["drops"]
    bad = tables.loc["bad"]
    assert drop["cor_measured"] == pytest.approx(0.745, abs=1e-3)
    height = drop["rebound_measured [m]"]
    # Through air with a drag coefficient of 0.55: 2 g/V^2 [1/m], fall from 2.54 m, rise.
    braking = 0.55 * 1.2 * np.pi * 0.03302**2 / 0.0576
    fallen = 1.0 - np.exp(-2.54 * braking)
    risen = np.log(1.0 + drop["cor_measured"] ** 2 * fallen) / braking
    assert height == pytest.approx(risen, rel=1e-3)
    assert drop["rebound_measured_q025"] < height < drop["rebound_measured_q975"]
    # 131 cm are below the limits of type 2, which begin at 135.
    assert drop["mean_passes"] < 0.05
    assert drop["mean_verdict"] == "fails"
    assert "135 to 147 cm" in drop["mean_rule"]
    assert drop["another_passes"] < 0.5
    assert bad["code"] == "memory"
    assert bad.drop(["outcome", "code", "reason"]).isna().all()


def test_a_court_of_the_test_has_its_measured_rating():
    angle = np.radians(16)
    v_x = np.full(6, 30.0 * np.cos(angle))
    v_y = np.full(6, 30.0 * np.sin(angle))
    states = fitball.impacts(v_x, v_y)
    truth = {
        "mu": 0.6,
        "e_x": 0.1,
        "offset": 0.002,
        "cor_10": 0.76,
        "cor_slope": -0.012,
    }
    after = fitball.model("grip-slip").rebound(truth, states)
    frame = pd.DataFrame(
        {
            "v_x1": states.v_x1,
            "v_y1": states.v_y1,
            "omega_1": states.omega_1,
            "v_x2": after.v_x2,
            "v_y2": after.v_y2 + 0.05 * np.sin(np.arange(6)),
            "omega_2": after.omega_2,
            "surface": "clay",
        }
    )
    result = rows.record_of("court", fit_by_hand(frame), "2026-05-01")
    row = result.row
    low = row["pace_measured_q025"]
    high = row["pace_measured_q975"]
    group = result.quantities["pace_measured"].group
    assert 2.0 * 1.96 * group.width == pytest.approx(high - low, rel=1e-9)
    categories = ("slow", "medium-slow", "medium", "medium-fast", "fast")
    assert row["pace_measured_category"] in categories
    assert low < row["pace_measured"] < high
    assert row["label:surface"] == "clay"


def test_populations_are_of_what_three_tables_determine(batch_of_courts):
    populations = batch_of_courts.populations
    assert (populations["tables"] >= 3).all()
    assert "mu" in populations.index
    assert "mu[clay]" not in populations.index
    for name, row in populations.iterrows():
        population = batch_of_courts.population(name)
        assert row["tables"] == len(batch_of_courts.of(name))
        assert row["tables"] == len(population.each)
        assert row["mean"] == pytest.approx(np.median(population.centre), rel=1e-12)
        assert row["mean_q025"] < row["mean"] < row["mean_q975"]
        assert row["new_q025"] < row["mean_q025"]
    # In SI; the fits have the same draws.
    of_mu = populations.loc["mu"]
    assert of_mu["mean"] == pytest.approx(batch_of_courts.tables.loc["court 1", "mu"], abs=0.01)
    assert of_mu["relative"]
    assert of_mu["spread"] < 0.05
    for name, code in (
        ("nothing", "unknown-quantity"),
        ("mu[clay]", "too-few-tables"),
    ):
        with pytest.raises(ParameterError) as caught:
            batch_of_courts.population(name)
        assert caught.value.code == code


FRICTIONS = (0.4, 0.44, 0.48, 0.55, 0.95, 1.1, 1.2)


@pytest.fixture(scope="module")
def batch_of_frictions(tmp_path_factory):
    """Tables of which only those with the lower friction let balls slide."""
    rng = np.random.default_rng(7)
    tables = {}
    for k, mu in enumerate(FRICTIONS):
        angle = np.radians(rng.uniform(18.0, 50.0, 10))
        speed = rng.uniform(18.0, 30.0, 10)
        states = fitball.impacts(speed * np.cos(angle), speed * np.sin(angle))
        truth = {"mu": mu, "e_x": 0.18, "offset": 0.0, "cor_10": 0.75, "cor_slope": -0.013}
        after = fitball.model("grip-slip").rebound(truth, states)
        columns = {"v_x1": states.v_x1, "v_y1": states.v_y1, "omega_1": states.omega_1}
        for name, sd in (("v_x2", 0.3), ("v_y2", 0.2), ("omega_2", 6.0)):
            columns[name] = getattr(after, name) + sd * rng.standard_normal(10)
        tables[f"court {k}"] = pd.DataFrame(columns)
    options = {"model": "grip-slip", "max_steps": 300, "cores": 1, "figures": "none"}
    return fitball.batch(tables, out=tmp_path_factory.mktemp("mu"), progress=False, **options)


def test_a_mean_does_not_leave_out_tables_by_their_value(batch_of_frictions):
    tables = batch_of_frictions.tables
    determined = tables["mu_verdict"].isin(["identified", "given", "conditional"])
    # Of all that is known only of the highest is a limit.
    assert 3 <= determined.sum() < 7
    row = batch_of_frictions.populations.loc["mu"]
    assert row["tables"] == 7
    assert row["determine"] == determined.sum()
    assert row["mean_q025"] < np.exp(np.mean(np.log(FRICTIONS))) < row["mean_q975"]
    # A new one may well be as high as two of seven are.
    assert row["new_q975"] > 1.0
    assert row["pareto_k"] < 0.7
    # With the determined ones alone, as if the others had not been measured.
    quantities = [row["mu"] for row in batch_of_frictions.quantities.values()]
    lower = rows.over_tables("mu", [entry for entry in quantities if entry.determined])
    assert np.quantile(lower.centre, 0.975) < row["mean_q975"]


def test_tables_without_a_posterior_are_named(courts, capsys):
    batch = fitball.batch([courts], out="all", cores=1, figures="none", **OPTIONS)
    assert [note.code for note in batch.notes] == ["no-posterior"]
    assert batch.populations.empty
    two = fitball.batch([courts / "court 1.csv"], out="one", cores=1, figures="none", **OPTIONS)
    assert two.notes == ()


def test_the_page_has_every_table_and_its_figure_every_interval(batch_of_courts):
    text = to_text(page.report(batch_of_courts), full=True)
    tables = batch_of_courts.tables
    for name in tables.index:
        assert name in text
    assert "6 of 7 tables" in text
    first_screen = to_text(page.report(batch_of_courts), full=False)
    assert len(first_screen.splitlines()) <= 40
    figure = batch_of_courts.plot("tables")
    panels = [axis for axis in figure.axes if axis.get_title(loc="left") or axis.get_title()]
    assert len(panels) == min(len(batch_of_courts.populations), 6)
    first = batch_of_courts.populations.index[0]
    lines = panels[0].lines
    dots = np.concatenate([line.get_ydata() for line in lines if line.get_marker() == "o"])
    factor = batch_of_courts.of(first)[0].display_unit.factor
    column = next(head for head in tables.columns if head.partition(" [")[0] == first)
    values = tables[column]
    assert sorted(dots) == pytest.approx(sorted(factor * values.dropna()))
    # Tables that know it are strong, and nothing of them is cut off.
    strong = []
    for line in lines:
        if to_rgba(line.get_color()) == to_rgba(MODEL_COLOUR):
            strong.extend(line.get_xdata())
    verdicts = tables[f"{first}_verdict"]
    determined = verdicts.isin(["identified", "given", "conditional"]).to_numpy()
    assert 0 < determined.sum() < values.notna().sum()
    assert sorted(strong) == np.flatnonzero(determined & values.notna()).tolist()
    assert not cut_off(figure)
    # Where models differ they are named.
    mixed = tables.copy()
    mixed.loc["drops", "model"] = "brody"
    of_two_models = Batch(None, mixed, batch_of_courts.populations, batch_of_courts.quantities)
    assert "brody" in to_text(page.report(of_two_models), full=True)
    without_populations = Batch(None, tables, batch_of_courts.populations.iloc[:0], {})
    assert not page.figures(without_populations)
