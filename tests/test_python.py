"""The Python interface: data frames in and out, one type of fit, messages that speak Python, nothing left behind."""

from __future__ import annotations

import ast
import json
import pickle
import re
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from arviz_stats.base.array import array_stats
from scipy.stats import norm

import fitball
from fitball.cli.main import main
from fitball.errors import FitballError, ParameterError, ResultFolderError
from fitball.inference.comparison.psis_loo import leave_one_out
from fitball.inference.effort import Effort
from fitball.report.figures.names import FIGURES
from fitball.values import same
from fitball.wording import on_command_line, option, speaking_to_command_line, spoken

ROOT = Path(__file__).resolve().parent.parent
MPH = 0.44704


@pytest.fixture(scope="module")
def made():
    """A short fit, in memory."""
    return fitball.calibrate("wang_zero_spin.csv", model="grip-slip", seed=4, cores=1, max_steps=100)


@pytest.fixture(scope="module")
def folder(made, tmp_path_factory):
    """The same, saved."""
    return made.save(tmp_path_factory.mktemp("python") / "fit")


@pytest.fixture(scope="module")
def impacts_frame():
    """Impacts with a rebound column, in the units of a court, indexed by names."""
    columns = {"v_1": [38.0, 36.5, 35.0], "theta_1": [18.0, 25.0, 40.0], "omega_1": [0.0, 100.0, -50.0]}
    return pd.DataFrame(columns | {"v_x2": [10.9, 9.5, 6.9]}, index=["a", "b", "c"])


UNITS = {"v_1": "mph", "omega_1": "rpm"}


# ---------------------------------------------------------------------------------------------- tables


def test_a_data_frame_reads_as_the_file_that_holds_it(tmp_path):
    columns = {
        "v_1": [38.0, 36.5],
        "theta_1": [18, 25],
        "v_x2": [10.9, 9.5],
        "v_y2": [4.1, 5.0],
        "surface": ["a", "b"],
    }
    place = tmp_path / "DataFrame.csv"
    heads = {"v_1": "v_1 [mph]"}
    pd.DataFrame(columns).rename(columns=heads).to_csv(place, index=False)
    from_file = fitball.load_table(place)
    for given in (columns, pd.DataFrame(columns)):
        table = fitball.load_table(given, units={"v_1": "mph"})
        assert table.impacts == from_file.impacts and table.labels == from_file.labels
        assert same(table.measurements, from_file.measurements) and table.units == from_file.units
    np.testing.assert_allclose(np.hypot(table.impacts.v_x1, table.impacts.v_y1), np.array([38.0, 36.5]) * MPH)
    assert fitball.load_table(pd.DataFrame(columns | {"id": ["x", "y"]}), units={"v_1": "mph"}).ids == ("x", "y")
    assert fitball.load_table(place, units={"v_x2": "mph"}).measurement("v_x2").values[0] == pytest.approx(10.9 * MPH)


@pytest.mark.parametrize("name", ["wang_all", "wang_topspin"])
def test_a_table_as_a_data_frame_reads_back(name):
    table = fitball.load_table(name)
    again = fitball.load_table(table.to_frame(), name=name)
    assert again.impacts == table.impacts and again.ids == table.ids and again.labels == table.labels
    assert [item.name for item in again.measurements] == [item.name for item in table.measurements]
    for one, other in zip(again.measurements, table.measurements, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
    assert table == fitball.load_table(name) != again and hash(table) != hash(again)
    assert len(repr(table)) < 200 and table.name in table._repr_html_()


def test_what_is_wrong_with_a_data_frame_is_told_by_row_and_column():
    frame = pd.DataFrame({"v_y1 [m/s]": [4.0, -6.0], "v_y2": [3.2, 4.7]})
    with pytest.raises(FitballError, match=r"DataFrame: 1 fault\n  - row 2, column 'v_y1': read -6"):
        fitball.load_table(frame)
    with pytest.raises(FitballError, match="the header says"):
        fitball.load_table(frame, units={"v_y1": "mph"})
    with pytest.raises(ParameterError, match="make no table"):
        fitball.load_table({"v_y1": [4.0, 6.0], "v_y2": [3.2]})


def test_a_fit_to_a_data_frame_is_the_fit_to_its_file():
    table = fitball.load_table("wang_zero_spin")
    scene = fitball.load_scene("wang_zero_spin")
    asked = {"model": "brody", "point_only": True, "cores": 1, "scene": scene}
    one = fitball.calibrate(table.to_frame(), **asked)
    other = fitball.calibrate("wang_zero_spin", **asked)
    assert one.point.values == other.point.values
    assert one.table.name == "DataFrame" and one != other


def test_tables_of_all_kinds_are_fitted_together(tmp_path):
    frame = fitball.load_table("wang_topspin").to_frame()
    tables = ["wang_zero_spin", fitball.load_table(frame, name="mine")]
    fit = fitball.calibrate(tables, model="brody", point_only=True, cores=1)
    assert sorted(set(fit.table.labels["table"])) == ["mine", "wang_zero_spin"] and len(fit.table) == 14
    fit.save(tmp_path / "f")
    assert fitball.load_fit(tmp_path / "f") == fit


# ---------------------------------------------------------------------------------------------- a fit


def test_a_fit_read_back_is_the_fit_and_saves_the_same_files(made, folder, tmp_path):
    again = fitball.load_fit(folder)
    assert type(again) is type(made) is fitball.Fit
    assert again == made == made and hash(again) == hash(made) and (made == 1) is False
    for one, other in ((again, made), (pickle.loads(pickle.dumps(again)), pickle.loads(pickle.dumps(made)))):
        assert one == other and one.report() == other.report() and repr(one) == repr(other)
        assert one.notes == other.notes and one.verdict == other.verdict and one.parameters == other.parameters
        pd.testing.assert_frame_equal(one.summary(), other.summary(), check_exact=True)
    copy = again.save(tmp_path / "copy")
    names = {path.name for path in folder.iterdir()}
    assert names == {path.name for path in copy.iterdir()}
    # The page tells of the search and of the reading of the table, which a folder does not keep.
    for name in names - {"report.html"}:
        assert (copy / name).read_bytes() == (folder / name).read_bytes(), name


def test_all_that_a_fit_holds_has_a_name_whether_made_or_read(made, folder):
    again = fitball.load_fit(folder)
    for field in fields(made.result):
        assert hasattr(made, field.name) and hasattr(again, field.name), field.name
    for name in ("estimates", "posterior", "covariance", "correlation"):
        assert same(getattr(again, name), getattr(made, name)), name
    assert again.diagnostics.ess_bulk == made.diagnostics.ess_bulk
    assert again.least_squares.values == made.least_squares.values and again.least_squares.starts == 0


def test_fits_that_differ_in_a_digit_differ(made):
    values = made.posterior.values.copy()
    values[0, 0, 0, 0] = np.nextafter(values[0, 0, 0, 0], np.inf)
    assert fitball.Fit(replace(made.result, posterior=replace(made.posterior, values=values))) != made
    assert fitball.Fit(replace(made.result, seed=5)) != made


def test_of_a_saved_fit_only_what_is_asked_for_is_read(folder, tmp_path):
    alone = tmp_path / "fit.json"
    alone.write_bytes((folder / "fit.json").read_bytes())
    fit = fitball.load_fit(alone)
    assert "mu" in repr(fit) and "mu" in fit.report() and len(fit.summary()) == 7
    assert fit.fitted.draws.shape == (400, 7) and "def rebound" in fit.export("python")[".py"]
    assert len(pickle.dumps(fit)) < 400_000
    for ask in (lambda: fit.posterior, lambda: fit.predict("v=17, theta=18"), fit.to_inferencedata, fit.plot.corner):
        with pytest.raises(ResultFolderError, match="there is no such file"):
            ask()


def test_a_fit_is_small(made):
    """Two hundred of them fit into a notebook: draws, and little else."""
    assert len(pickle.dumps(made)) < 1.3 * made.posterior.values.nbytes * (1 + 1 / 7) + 300_000


def test_a_fit_shows_itself_in_a_few_lines(made, point_fit):
    for fit in (made, point_fit):
        lines = repr(fit).splitlines()
        assert len(lines) <= 10 and max(map(len, lines)) <= 100
        assert all(item.name in repr(fit) for item in fit.estimates if item.verdict != "fixed")
        page = fit._repr_html_()
        assert all(f"<th>{name}</th>" in page for name in fit.parameters) and len(page) < 6000


def test_names_of_others_are_no_html(made):
    table = replace(made.table, name="<script>x</script>")
    hostile = fitball.Fit(replace(made.result, problem=replace(made.problem, table=table)))
    assert "<script>" not in hostile._repr_html_() and "&lt;script&gt;" in hostile._repr_html_()
    assert "<script>" not in table._repr_html_()


def test_the_report_says_what_the_summary_holds(made):
    text, table = made.report(), made.summary()
    heads = [line.split("]]")[0] for line in text.splitlines() if line.startswith("[[")]
    assert heads == ["[[Fit", "[[Statistics", "[[Parameters", "[[Correlations", "[[Notes"]
    told = re.search(r"^    mu: +([0-9.]+) \+- ([0-9.]+)", text, re.MULTILINE)
    assert float(told[1]) == pytest.approx(table.loc["mu", "median"], abs=5e-4)
    assert float(told[2]) == pytest.approx(table.loc["mu", "sd"], abs=5e-4)
    draws = made.draws()
    assert table.loc["mu", "median"] == pytest.approx(draws["mu"].median(), rel=1e-12)
    pair = re.search(r"C\((\w+), (\w+)\) = ([-+][0-9.]+)", text)
    assert float(pair[3]) == pytest.approx(draws[pair[1]].corr(draws[pair[2]]), abs=6e-4)


# ---------------------------------------------------------------------------------------------- what follows


def test_predictions_come_in_the_rows_of_the_frame_and_are_those_of_the_verb(made, folder, impacts_frame, tmp_path):
    found = made.predict(impacts_frame, units=UNITS)
    assert list(impacts_frame.join(found).index) == ["a", "b", "c"]
    assert found["v_x2_measured [m/s]"].tolist() == impacts_frame["v_x2"].tolist()
    place = tmp_path / "new.csv"
    heads = {name: f"{name} [{unit}]" for name, unit in UNITS.items()}
    impacts_frame.rename(columns=heads).to_csv(place, index_label="id")
    out = tmp_path / "out.csv"
    assert main(["predict", str(folder), str(place), "--out", str(out), "--quiet"]) == 0
    of_verb = pd.read_csv(out, index_col="id", keep_default_na=False, na_values=[""])
    for name, column in found.items():
        if pd.api.types.is_numeric_dtype(column):
            np.testing.assert_allclose(of_verb[name], column, rtol=1e-12, err_msg=name)
        else:
            assert of_verb[name].astype(object).fillna("").tolist() == column.tolist(), name
    assert any("did not converge" in note for note in found.attrs["notes"])
    # A data frame without names keeps its numbers.
    numbered = fitball.predict(folder, impacts_frame.reset_index(drop=True), units=UNITS)
    assert numbered.index.tolist() == [0, 1, 2]
    texts = made.predict(["v=38 mph, theta=18 deg", "v=20±0.5, theta=30"])
    assert texts.index.tolist() == ["impact 1", "impact 2"] and "v_x2_sd_incident [m/s]" in texts


def test_what_is_no_impact_is_refused(made):
    with pytest.raises(ParameterError, match="read impacts of type int"):
        made.predict(3)
    with pytest.raises(ParameterError, match="seed = -1"):
        made.predict("v=17, theta=18", seed=-1)


def test_inference_data_says_what_the_densities_are(made):
    tree = made.to_inferencedata(draws=50)
    problem = made.problem
    draws = {name: tree["posterior"][name].to_numpy() for name in problem.free_names}
    assert tree["posterior"].sizes == {"chain": 4, "draw": 50}
    told = tree["log_likelihood"]["impact_log_likelihood"].to_numpy()
    for chain, draw in ((0, 3), (3, 49)):
        values = {name: float(column[chain, draw]) for name, column in draws.items()}
        rebound = problem.model.rebound({name: values[name] for name in problem.model_names}, problem.impacts)
        by_hand = sum(
            norm.logpdf(item.values, getattr(rebound, item.name), values[item_sd])
            for item, item_sd in zip(
                problem.table.measurements, ("velocity_sd", "velocity_sd", "spin_sd"), strict=True
            )
        )
        np.testing.assert_allclose(told[chain, draw], by_hand, rtol=1e-10)
    whole = made.to_inferencedata()
    made_up = whole["posterior_predictive"]["v_x2"]
    band = made.predictive.observables[0]
    low, high = made_up.quantile([0.025, 0.975], dim=("chain", "draw")).to_numpy()
    np.testing.assert_allclose(low, band.data_q025, atol=0.15)
    np.testing.assert_allclose(high, band.data_q975, atol=0.15)
    assert made_up.attrs["units"] == "m/s" and list(made_up["impact"].to_numpy()) == list(problem.table.ids)
    assert whole.identical(made.to_inferencedata())
    for draws in (0, 10**6):
        with pytest.raises(ParameterError, match="of each chain"):
            made.to_inferencedata(draws=draws)


def test_arviz_takes_it(grip_slip_fit):
    """Its statistics of four chains are near ours of all walkers, its leave-one-out score near that of `compare`."""
    tree = grip_slip_fit.to_inferencedata()
    problem, posterior = grip_slip_fit.problem, grip_slip_fit.posterior
    table = grip_slip_fit.summary()
    for name in problem.free_names:
        chains = tree["posterior"][name].to_numpy()
        assert float(array_stats.rhat(chains, chain_axis=0, draw_axis=1)) < 1.03
        assert float(array_stats.ess(chains, chain_axis=0, draw_axis=1)) > 400
        # A thousand effective draws know a mean to 0.03 sd.
        mean = posterior.draws[:, posterior.names.index(name)].mean()
        assert chains.mean() == pytest.approx(mean, abs=0.15 * table.loc[name, "sd"])
    told = tree["log_likelihood"]["impact_log_likelihood"].to_numpy()
    settings = Effort(cores=1).settings(problem)
    columns = [item.name for item in problem.observables]
    ours = leave_one_out(problem, grip_slip_fit.result, posterior, columns, settings, exact=False)
    sure = ours.pareto_k < 0.6
    assert np.count_nonzero(sure) > 15
    elpd = [array_stats.loo(told[..., k], chain_axis=0, draw_axis=1)[0] for k in np.flatnonzero(sure)]
    np.testing.assert_allclose(elpd, ours.elpd[sure], atol=0.15)


def test_a_point_fit_has_no_draws(point_fit):
    for ask in (point_fit.draws, point_fit.to_inferencedata, point_fit.plot.corner):
        with pytest.raises(ResultFolderError, match="point_only=True"):
            ask()
    assert point_fit.posterior is None and "median" in point_fit.summary()


def test_figures_by_name_show_themselves_and_leave_nothing_open(made, folder):
    assert dir(made.plot) == sorted(FIGURES) and set(made.plot) <= set(FIGURES)
    figure = made.plot.residuals()
    assert len(figure.axes) >= 3 and figure._repr_png_().startswith(b"\x89PNG")
    assert fitball.plot(folder, "residuals").get_suptitle() == figure.get_suptitle()
    with pytest.raises(ParameterError, match="did you mean 'residuals'"):
        made.plot("residual")
    with pytest.raises(AttributeError, match="did you mean 'corner'"):
        _ = made.plot.corners
    assert plt.get_fignums() == []
    assert all(name in repr(made.plot) for name in FIGURES)


def test_exports_are_those_of_the_verb(made, folder, tmp_path, capsys):
    texts = fitball.export(folder, "lookup", range="v=15..20 m/s:2, theta=20..40 deg:2, spin=0..100:2")
    assert set(texts) == {".csv", ".json"}
    assert main(["export", str(folder), "--to", "latex", "--out", "-"]) == 0
    assert made.export("latex")[".tex"] == capsys.readouterr().out
    (place,) = made.export("c", tmp_path / "ball.h", prefix="clay_")
    assert "clay_rebound(" in place.read_text(encoding="utf-8")
    with pytest.raises(ResultFolderError, match="allow it with overwrite=True"):
        made.export("c", place)
    for words, said in ((("jsn",), "did you mean 'json'"), (("netcdf",), "to_inferencedata")):
        with pytest.raises(ParameterError, match=said):
            made.export(*words)
    with pytest.raises(ParameterError, match="prefix belongs to the format c, javascript and csharp, not to json"):
        made.export("json", prefix="x")
    with pytest.raises(ParameterError, match="unknown option 'prefx'"):
        made.export("c", prefx="x")


def test_a_course_through_time(folder, point_fit):
    course = fitball.simulate("v=17, theta=18, spin=100", fit=point_fit)
    frame = course.to_frame()
    assert frame["time [s]"].is_monotonic_increasing and len(frame) == 401
    rebound = course.summary()["rebound"]
    told = point_fit.fitted.rebound(fitball.impacts(17 * np.cos(np.radians(18)), 17 * np.sin(np.radians(18)), 100.0))
    assert rebound["v_x2"] == pytest.approx(told.v_x2[0, 0], rel=1e-9)
    assert "contact time" in course.report() and len(course.plot().axes) >= 4 and plt.get_fignums() == []
    for wrong in ({"fit": folder, "model": "two-mass"}, {"fit": point_fit, "values": {"mu": 1.0}}):
        with pytest.raises(ParameterError, match="brings its own model"):
            fitball.simulate("v=17, theta=18", **wrong)
    with pytest.raises(ParameterError, match="follows one impact"):
        fitball.simulate(fitball.impacts([1.0, 2.0], 3.0))


def test_a_check_tells_every_fault(tmp_path, capsys):
    place = tmp_path / "bad.csv"
    place.write_text("v_y1,v_y2\n4,3\n-5,4\n6,x\n", encoding="utf-8")
    found = fitball.check(place)
    assert not found and [fault["row"] for fault in found.faults] == [2, 3]
    assert main(["datasets", "check", str(place), "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["faults"] == found.faults
    assert found.to_frame()["column"].tolist() == ["v_y1", "v_y2"] and "row 3 (line 4)" in repr(found)
    good = fitball.check("wang_all")
    assert good.ok and good.table is not None and "no fault" in repr(good)


def test_models_are_compared_as_by_the_verb(tmp_path, capsys):
    words = ["--models", "brody,grip-slip", "--quick", "--max-steps", "100", "--cores", "1", "--quiet"]
    assert main(["compare", "wang_zero_spin", *words, "--out", str(tmp_path / "verb")]) == 1
    found = fitball.compare("wang_zero_spin", ["brody", "grip-slip"], quick=True, max_steps=100, cores=1)
    saved = found.save(tmp_path / "python")
    assert capsys.readouterr().err == ""
    ways = (tmp_path / "verb", saved)
    assert {path.name for path in ways[0].iterdir()} == {path.name for path in ways[1].iterdir()}
    for name in ("compare.csv", "compare.png"):
        assert (ways[0] / name).read_bytes() == (ways[1] / name).read_bytes(), name
    assert found.summary().index.tolist()[:2] == list(found.names) and set(found.names) == {"brody", "grip-slip"}
    assert isinstance(found["brody"], fitball.Fit) and len(repr(found).splitlines()) == 4
    assert len(found.plot().axes) > 0 and plt.get_fignums() == [] and found == found
    with pytest.raises(ResultFolderError, match="overwrite=True"):
        found.save(saved)


# ---------------------------------------------------------------------------------------------- words


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"priors": {"mu": (0.6, 0.1)}}, r"'normal\(0.6, 0.1\)'}; if they are bounds, {'mu': 'uniform\(0.1, 0.6\)'}"),
        ({"priors": {"mu": 0.6}}, r"priors: mu = 0.6: expected a text, such as {'mu': 'normal\(0.55, 0.05\)'}"),
        ({"priors": "mu=normal(0, 1)"}, "priors: read .*, expected a dict"),
        ({"fix": {"mu": "0.6"}}, "fix: mu = '0.6': expected a number in SI"),
        ({"fix": {"mu": True}}, "fix: mu = True"),
        ({"closures": ["total"]}, "closures: read .*, expected a dict, such as {'cor'"),
        ({"pool": {"mu": 3}}, "pool: mu = 3: expected a text"),
        ({"noise": 3}, "noise: read 3"),
        ({"model": 3}, "model: read 3"),
        ({"pool": {"mu": "colour"}}, r"pool={'mu': 'colour'}"),
        ({"offsets": "colour"}, "offsets='colour'"),
        ({"seed": -1}, "seed = -1"),
    ],
)
def test_a_mistake_in_python_is_told_in_python(asked, said):
    with pytest.raises(FitballError, match=said) as caught:
        fitball.calibrate("wang_zero_spin.csv", **({"model": "brody", "cores": 1} | asked))
    assert "--" not in str(caught.value)


@pytest.mark.parametrize("data", [3, [], [3], None])
def test_what_is_no_table_is_refused(data):
    with pytest.raises((FitballError, TypeError), match=r"read (a table|an empty list)|os\.PathLike"):
        fitball.calibrate(data)


def test_messages_speak_to_who_listens(made, folder, capsys):
    with pytest.raises(ResultFolderError, match=r"use overwrite=True to replace it, or name another folder"):
        made.save(folder)
    assert main(["calibrate", "wang_zero_spin", "--model", "brody", "--point-only", "--out", str(folder)]) == 2
    assert "--overwrite to replace it, or --out" in capsys.readouterr().err
    assert not on_command_line()
    assert (option("as_read"), option("flip", "a", "b"), spoken("c", "p")) == ("as_read=True", "flip=['a', 'b']", "p")
    with speaking_to_command_line():
        assert (option("as_read"), option("flip", "a", "b"), spoken("c", "p")) == ("--as-read", "--flip a,b", "c")


def _is_wording(node):
    return isinstance(node, ast.Call) and getattr(node.func, "id", "") == "spoken"


def test_flags_stand_in_no_message_but_by_the_wording():
    """Options by their flags: in the command line, in studies, which have no other face, and in the one module."""
    flag = re.compile(r"(?<![\w-])--[a-z]{2}")
    for file in sorted((ROOT / "fitball").rglob("*.py")):
        parts = file.relative_to(ROOT / "fitball").parts
        if parts[0] in ("cli", "studies", "wording.py"):
            continue
        tree = ast.parse(file.read_text(encoding="utf-8"))
        documented = {
            id(node.body[0].value)
            for node in ast.walk(tree)
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None
        }
        worded = {id(item) for node in ast.walk(tree) if _is_wording(node) for item in ast.walk(node.args[0])}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documented | worded:
                # What a generated program or page says of its own options is no message of ours.
                assert not flag.search(node.value) or parts[0] in ("exports", "export"), (file, node.value)


def test_types_of_all_public_names_are_known_to_a_checker():
    tree = ast.parse((ROOT / "fitball" / "__init__.py").read_text(encoding="utf-8"))
    guarded = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {alias.name for node in guarded.body for alias in node.names}
    assert seen | {"__version__"} == set(fitball.__all__)
    assert (ROOT / "fitball" / "py.typed").exists()


# ---------------------------------------------------------------------------------------------- progress


def test_progress_is_silent_where_nobody_looks_on(capsys):
    asked = {"model": "brody", "cores": 1, "max_steps": 100}
    fitball.calibrate("wang_zero_spin", **asked)
    assert "".join(capsys.readouterr()) == ""
    told = []
    fitball.calibrate("wang_zero_spin", **asked, progress=lambda stage, progress: told.append((stage, progress)))
    stages = [stage for stage, _ in told]
    assert "sampling" in stages and stages[-1] == "assumptions"
    assert max(progress.step for _, progress in told if progress is not None) == 100
    fitball.calibrate("wang_zero_spin", **asked, progress=True)
    out, err = capsys.readouterr()
    assert out == "" and "sampling: step 100" in err


def test_an_interrupt_ends_a_loop_over_tables():
    def impatient(stage, progress):
        if progress is not None:
            raise KeyboardInterrupt

    seen = []

    def loop():
        for name in ("wang_zero_spin", "wang_topspin"):
            seen.append(name)
            with suppress(Exception):
                fitball.calibrate(name, model="brody", cores=1, max_steps=100, progress=impatient)

    with pytest.raises(KeyboardInterrupt):
        loop()
    assert seen == ["wang_zero_spin"]
