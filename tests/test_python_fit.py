"""A fit in Python: one type whether made or read, what it says of itself, and what follows from it."""

from __future__ import annotations

import pickle
import re
from dataclasses import fields, replace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from samples import leave_out_figures

import fitball
from fitball.cli.main import main
from fitball.errors import ParameterError, ResultFolderError
from fitball.inference.prediction.simulate import COURSES, Band
from fitball.report.figures.registry import FIGURES
from fitball.values import same


def save_with_one_figure(fit, folder):
    with pytest.MonkeyPatch.context() as patch:
        leave_out_figures(patch, but=["residuals"])
        return fit.save(folder)


@pytest.fixture(scope="module")
def folder(short_fit, tmp_path_factory):
    """The short fit, saved with a figure."""
    return save_with_one_figure(short_fit, tmp_path_factory.mktemp("python") / "fit")


@pytest.fixture(scope="module")
def impacts_frame():
    """Impacts with a rebound column, in the units of a court, indexed by names."""
    columns = {"v_1": [38.0, 36.5, 35.0], "theta_1": [18.0, 25.0, 40.0], "omega_1": [0.0, 100.0, -50.0]}
    return pd.DataFrame(columns | {"v_x2": [10.9, 9.5, 6.9]}, index=["a", "b", "c"])


UNITS = {"v_1": "mph", "omega_1": "rpm"}


def test_a_fit_read_back_is_the_fit_and_saves_the_same_files(short_fit, folder, tmp_path):
    again = fitball.load_fit(folder)
    assert type(again) is type(short_fit) is fitball.Fit
    assert again == short_fit == short_fit and hash(again) == hash(short_fit) and (short_fit == 1) is False
    for one, other in (
        (again, short_fit),
        (pickle.loads(pickle.dumps(again)), pickle.loads(pickle.dumps(short_fit))),
    ):
        assert one == other and one.report() == other.report() and repr(one) == repr(other)
        assert one.notes == other.notes and one.verdict == other.verdict and one.parameters == other.parameters
        pd.testing.assert_frame_equal(one.summary(), other.summary(), check_exact=True)
    copy = save_with_one_figure(again, tmp_path / "copy")
    names = {path.name for path in folder.iterdir()}
    assert "residuals.png" in names
    assert names == {path.name for path in copy.iterdir()}
    # The page tells of the search and of the reading of the table, which a folder does not keep.
    for name in names - {"report.html"}:
        assert (copy / name).read_bytes() == (folder / name).read_bytes(), name


def test_all_that_a_fit_holds_has_a_name_whether_made_or_read(short_fit, folder):
    again = fitball.load_fit(folder)
    for field in fields(short_fit):
        assert hasattr(short_fit, field.name) and hasattr(again, field.name), field.name
    for name in ("estimates", "posterior", "covariance", "correlation"):
        assert same(getattr(again, name), getattr(short_fit, name)), name
    assert again.diagnostics.ess_bulk == short_fit.diagnostics.ess_bulk
    assert same(again.least_squares, short_fit.least_squares) and same(again.point, short_fit.point)


def test_fits_that_differ_in_a_digit_differ(short_fit):
    values = short_fit.posterior.values.copy()
    values[0, 0, 0, 0] = np.nextafter(values[0, 0, 0, 0], np.inf)
    assert replace(short_fit, posterior=replace(short_fit.posterior, values=values)) != short_fit
    assert replace(short_fit, seed=5) != short_fit


def test_of_a_saved_fit_only_what_is_asked_for_is_read(folder, tmp_path):
    alone = tmp_path / "fit.json"
    alone.write_bytes((folder / "fit.json").read_bytes())
    fit = fitball.load_fit(alone)
    assert "mu" in repr(fit) and "mu" in fit.report() and len(fit.summary()) == 7
    assert "7 impacts with v_x2, v_y2 and omega_2; 7 free parameters" in fit.report()
    assert fit.fitted.draws.shape == (400, 7) and "def rebound" in fit.export("python")[".py"]
    assert len(pickle.dumps(fit)) < 400_000
    for ask in (lambda: fit.posterior, lambda: fit.predict("v=17, theta=18"), fit.plot.corner):
        with pytest.raises(ResultFolderError, match="no such file"):
            ask()


def test_a_fit_shows_itself_in_a_few_lines(short_fit, point_fit):
    for fit in (short_fit, point_fit):
        lines = repr(fit).splitlines()
        assert len(lines) <= 10 and max(map(len, lines)) <= 100
        assert all(item.name in repr(fit) for item in fit.estimates if item.verdict != "fixed")
        page = fit._repr_html_()
        assert all(f"<th>{name}</th>" in page for name in fit.parameters) and len(page) < 6000


def test_names_of_others_are_no_html(short_fit):
    hostile = replace(short_fit, source=replace(short_fit.source, name="<script>x</script>"))
    assert "<script>" not in hostile._repr_html_() and "&lt;script&gt;" in hostile._repr_html_()
    assert "<script>" not in replace(short_fit.table, name="<script>x</script>")._repr_html_()


def test_the_report_says_what_the_summary_holds(short_fit):
    text, table = short_fit.report(), short_fit.summary()
    heads = [line.split("]]")[0] for line in text.splitlines() if line.startswith("[[")]
    first = ["[[Fit", "[[Statistics", "[[Parameters", "[[Correlations", "[[Least squares"]
    assert list(dict.fromkeys(heads)) == [*first, "[[Notes"]
    squares, found = short_fit.least_squares, re.search(r"mu: +([0-9.]+) \+/- ([0-9.]+)", text)
    assert float(found[1]) == pytest.approx(squares.values["mu"], rel=1e-5)
    assert float(found[2]) == pytest.approx(squares.stderr["mu"], rel=1e-2)
    told = re.search(r"^    mu: +([0-9.]+) \+- ([0-9.]+)", text, re.MULTILINE)
    assert float(told[1]) == pytest.approx(table.loc["mu", "median"], abs=5e-4)
    assert float(told[2]) == pytest.approx(table.loc["mu", "sd"], abs=5e-4)
    draws = short_fit.draws()
    assert table.loc["mu", "median"] == pytest.approx(draws["mu"].median(), rel=1e-12)
    pair = re.search(r"C\((\w+), (\w+)\) = ([-+][0-9.]+)", text)
    assert float(pair[3]) == pytest.approx(draws[pair[1]].corr(draws[pair[2]]), abs=6e-4)


def test_predictions_come_in_the_rows_of_the_frame_and_are_those_of_the_verb(
    short_fit, folder, impacts_frame, tmp_path
):
    found = short_fit.predict(impacts_frame, units=UNITS)
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
    texts = short_fit.predict(["v=38 mph, theta=18 deg", "v=20±0.5, theta=30"])
    assert texts.index.tolist() == ["impact 1", "impact 2"] and "v_x2_sd_incident [m/s]" in texts


def test_rows_that_cannot_be_predicted_are_left_out_of_the_frame(short_fit, tmp_path):
    """One without its incident state, one of units; a file may have a name like an impact."""
    frame = pd.DataFrame({"v_1": ["m/s", 17.0, None, 18.0], "theta_1": ["deg", 20.0, 25.0, 30.0]})
    found = short_fit.predict(frame)
    assert found.index.tolist() == [1, 3] and "row 3: ignored" in " ".join(found.attrs["notes"])
    place = tmp_path / "run=3.csv"
    frame.to_csv(place, index=False)
    assert (short_fit.predict(str(place)).to_numpy() == found.to_numpy()).all()


def test_what_is_no_impact_is_refused(short_fit):
    with pytest.raises(ParameterError, match="read impacts of type int"):
        short_fit.predict(3)
    with pytest.raises(ParameterError, match="seed = -1"):
        short_fit.predict("v=17, theta=18", seed=-1)
    with pytest.raises(ParameterError, match="read no impacts"):
        short_fit.predict(fitball.impacts([], []))
    with pytest.raises(ParameterError, match="units: read 'mph', expected a dict, each value a text"):
        short_fit.predict({"v_1": [17.0], "theta_1": [18.0]}, units="mph")


def test_a_point_fit_has_no_draws(point_fit):
    for ask in (point_fit.draws, point_fit.to_inferencedata, point_fit.plot.corner):
        with pytest.raises(ResultFolderError, match="point_only=True"):
            ask()
    assert point_fit.posterior is None and "median" in point_fit.summary()


def test_a_fit_cannot_be_changed_and_says_what_it_lacks(short_fit):
    with pytest.raises(TypeError, match="item assignment"):
        short_fit.parameters["mu"] = 1
    with pytest.raises(AttributeError, match=r"a fit has no 'mu': see fit.parameters\['mu'\]"):
        _ = short_fit.mu
    # A property that fails is not a property that is missing.
    broken = replace(short_fit)
    broken.__dict__["parameters"] = {"mu": 1}
    with pytest.raises(AttributeError, match="'int' object has no attribute 'verdict'"):
        _ = broken.free_names
    with pytest.raises(ParameterError, match=r"fit\.plot\.residuals\(\) takes no arguments: .*\.axes"):
        short_fit.plot.residuals(ax=None)


def test_draws_and_text_have_the_values_at_levels():
    rng = np.random.default_rng(3)
    speeds, hard = np.tile(np.linspace(4.0, 12.0, 8), 2), np.repeat([False, True], 8)
    rebound = np.where(hard, 0.72, 0.78) * speeds + 0.05 * rng.standard_normal(16)
    table = pd.DataFrame({"v_y1": speeds, "v_y2": rebound, "surface": np.where(hard, "hard", "clay")})
    fit = fitball.calibrate(table, "grip-slip", pool={"cor_10": "surface"}, max_steps=200, cores=1)
    levels = ["cor_10[clay]", "cor_10[hard]"]
    np.testing.assert_allclose(fit.draws()[levels].median(), fit.summary().loc[levels, "median"], rtol=1e-12)
    for text in (repr(fit), fit._repr_html_()):
        assert all(name in text for name in levels) and "_place" not in text
    assert "cor_10_place[hard]" in fit.report() and "cor_10[hard]" in fit.report()


def test_figures_by_name_show_themselves_and_leave_nothing_open(short_fit, folder):
    assert dir(short_fit.plot) == sorted(FIGURES) and set(short_fit.plot) <= set(FIGURES)
    figure = short_fit.plot.residuals()
    assert len(figure.axes) >= 3 and figure._repr_png_().startswith(b"\x89PNG")
    assert fitball.plot(folder, "residuals").get_suptitle() == figure.get_suptitle()
    with pytest.raises(ParameterError, match="did you mean 'residuals'"):
        short_fit.plot("residual")
    with pytest.raises(AttributeError, match="did you mean 'corner'"):
        _ = short_fit.plot.corners
    assert plt.get_fignums() == []
    assert all(name in repr(short_fit.plot) for name in FIGURES)


def test_exports_are_those_of_the_verb(short_fit, folder, tmp_path, capsys):
    texts = fitball.export(folder, "lookup", range="v=15..20 m/s:2, theta=20..40 deg:2, spin=0..100:2")
    assert set(texts) == {".csv", ".json"}
    assert main(["export", str(folder), "--to", "latex", "--out", "-"]) == 0
    assert short_fit.export("latex")[".tex"] == capsys.readouterr().out
    (place,) = short_fit.export("c", tmp_path / "ball.h", prefix="clay_")
    assert "clay_rebound(" in place.read_text(encoding="utf-8")
    with pytest.raises(ResultFolderError, match="use overwrite=True"):
        short_fit.export("c", place)
    for words, said in ((("jsn",), "did you mean 'json'"), (("netcdf",), "to_inferencedata")):
        with pytest.raises(ParameterError, match=said):
            short_fit.export(*words)
    with pytest.raises(ParameterError, match=r"prefix .* c, csharp and javascript, not of json"):
        short_fit.export("json", prefix="x")
    with pytest.raises(ParameterError, match="unknown option 'prefx'"):
        short_fit.export("c", prefx="x")


@pytest.mark.parametrize(
    ("to", "named", "said"),
    [
        ("lookup", {"range": 5}, "range = 5: expected a text"),
        ("engine", {"engine_inertia": "0.4"}, "engine_inertia = '0.4': expected a number"),
        ("golden", {"inputs_only": "yes"}, "inputs_only = 'yes': expected True or False"),
        (5, {}, "to: read 5, expected a text"),
    ],
)
def test_a_wrong_export_is_refused(short_fit, to, named, said):
    with pytest.raises(ParameterError, match=said):
        short_fit.export(to, **named)


def test_a_course_through_time(folder, point_fit):
    course = fitball.simulate("v=17, theta=18, spin=100", fit=point_fit)
    frame = course.to_frame()
    assert frame["time [s]"].is_monotonic_increasing and len(frame) == 401
    rebound = course.summary()["rebound"]
    told = point_fit.fitted.rebound(fitball.impacts(17 * np.cos(np.radians(18)), 17 * np.sin(np.radians(18)), 100.0))
    assert rebound["v_x2"] == pytest.approx(told.v_x2[0, 0], rel=1e-9)
    assert "contact time" in course.report() and len(course.plot().axes) >= 4 and plt.get_fignums() == []
    levels = np.arange(5.0)
    band = Band(
        {name: np.tile(levels[:, None], 401) for name in COURSES}, levels, {}, {"slide": 1.0}, draws=9, failed=0
    )
    told = replace(course, simulations=(replace(course.simulations[0], band=band),))
    # As all files name them.
    names = ["q025", "q16", "median", "q84", "q975"]
    assert told.to_frame()[[f"v_x_{name} [m/s]" for name in names]].iloc[0].tolist() == levels.tolist()
    assert told.summary()["posterior"]["contact_time"] == dict(zip(names, levels, strict=True))
    for wrong in ({"fit": folder, "model": "two-mass"}, {"fit": point_fit, "values": {"mu": 1.0}}):
        with pytest.raises(ParameterError, match="has its own model"):
            fitball.simulate("v=17, theta=18", **wrong)
    with pytest.raises(ParameterError, match="takes one impact"):
        fitball.simulate(fitball.impacts([1.0, 2.0], 3.0))
