"""Files, figures' numbers and pages of a fit."""

from __future__ import annotations

import json
import math
import re
import shutil
import tomllib
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import jsonschema
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from samples import save_without_figures

import fitball
from fitball.data.balances import scene_balances
from fitball.data.scene import load_scene
from fitball.errors import ResultFolderError
from fitball.inference.problem.pooling import Levels
from fitball.inference.results.evidence import Answer
from fitball.inference.results.results import RunStatus, Verdict
from fitball.report.fit.document import fit_document, render
from fitball.report.fit.folder import prepare_folder, render_json, write_all
from fitball.report.fit.judged import brief_verdict, next_line, remarks
from fitball.report.fit.methods import methods_text
from fitball.report.fit.rows import balance_table, prediction_table, thesis_rows
from fitball.report.form.document import on_terminal
from fitball.report.form.numbers import HANDY, THESIS, Scale, decimals, fixed, significant
from fitball.report.saved.fit_file import fit_text
from fitball.wording import Screen, speaking_to_command_line


@pytest.fixture(scope="module")
def fit(grip_slip_fit):
    return grip_slip_fit


@pytest.fixture(scope="module")
def two_mass():
    """The default model, quickly: too few steps to converge, all there is to show."""
    return fitball.calibrate("wang_zero_spin.csv", seed=4, cores=2, max_steps=200)


@pytest.fixture(scope="module")
def two_mass_folder(two_mass, tmp_path_factory):
    """Its result folder, without figures."""
    return save_without_figures(two_mass, tmp_path_factory.mktemp("two-mass") / "fit")


@pytest.fixture(scope="module")
def folder(grip_slip_folder):
    return grip_slip_folder


def test_fit_json_follows_its_schema(fit, two_mass, point_fit):
    schema = json.loads((files("fitball.report") / "fit.schema.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    for item in (fit, two_mass, point_fit):
        jsonschema.validate(json.loads(fit_text(item)), schema)
    broken = json.loads(fit_text(fit))
    broken["parameters"]["mu"]["verdict"] = "certain"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(broken, schema)


def test_golden_impacts_hold_to_the_last_digit(two_mass, two_mass_folder):
    saved = fitball.load_fit(two_mass_folder)
    golden = saved.golden
    assert len(golden.impacts) >= 10
    model = fitball.model(two_mass.problem.model.name)
    parameters = {name: golden.parameters[name] for name in model.parameter_names}
    found = model.rebound(parameters, golden.impacts)
    for name in ("v_x2", "v_y2", "omega_2", "contact_time"):
        assert getattr(found, name).tobytes() == getattr(golden.rebound, name).tobytes()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{", "not readable as JSON"),
        ("[]", "read kind None, expected 'fitball fit'"),
        ('{"kind": "fitball fit", "schema_version": 99}', "schema_version 99"),
        ('{"kind": "fitball fit", "schema_version": 1}', "run calibrate again"),
        ('{"kind": "fitball fit", "schema_version": 8}', "damaged"),
        ('{"kind": "fitball fit", "schema_version": 7}', "reads version 8: run calibrate again, or use"),
    ],
)
def test_a_file_that_is_no_fit_is_refused(tmp_path, content, said):
    place = tmp_path / "fit.json"
    place.write_text(content, encoding="utf-8")
    with pytest.raises(ResultFolderError, match=re.escape(said)):
        fitball.load_fit(place)
    with pytest.raises(ResultFolderError, match="no such file"):
        fitball.load_fit(tmp_path / "elsewhere.json")


def test_folder_is_refused_or_replaced(fit, folder, tmp_path):
    with pytest.raises(ResultFolderError, match="overwrite=True"):
        prepare_folder(folder, overwrite=False, resume=False)
    prepare_folder(folder, overwrite=False, resume=True)
    place = shutil.copytree(folder, tmp_path / "older")
    (place / "mine.txt").touch()
    # Whatever the new result has not must not stand beside it.
    prepare_folder(place, overwrite=True, resume=False)
    assert [item.name for item in place.iterdir()] == ["mine.txt"]
    # Where no result lies files of such names are somebody's own.
    (place / "summary.csv").touch()
    prepare_folder(place, overwrite=True, resume=False)
    assert (place / "summary.csv").exists()
    file = tmp_path / "file"
    file.write_text("x", encoding="utf-8")
    with pytest.raises(ResultFolderError, match="is a file"):
        prepare_folder(file, overwrite=False, resume=False)
    with pytest.raises(ResultFolderError, match="cannot be created"):
        prepare_folder(file / "below", overwrite=False, resume=False)


def test_an_interrupted_writing_leaves_no_fit_json(fit, folder, tmp_path, monkeypatch, without_figures):
    place = shutil.copytree(folder, tmp_path / "whole")
    assert (place / "fit.json").exists()

    def stop(*_arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("fitball.report.fit.folder.page", stop)
    with pytest.raises(KeyboardInterrupt):
        write_all(fit, place)
    assert not (place / "fit.json").exists()
    assert not [item for item in place.iterdir() if "partial" in item.name]


def test_tables_can_be_read_by_others(fit, folder):
    summary = pd.read_csv(folder / "summary.csv").set_index("parameter")
    assert summary.loc["mu", "median"] == fit.parameters["mu"].median
    predictions = pd.read_csv(folder / "predictions.csv")
    assert len(predictions) == 3 * 21
    inside = (predictions.measured > predictions.data_q025) & (predictions.measured < predictions.data_q975)
    assert 0.85 < inside.mean() <= 1.0
    regimes = pd.read_csv(folder / "regimes.csv")
    np.testing.assert_allclose(regimes.groupby("id").probability.sum(), 1.0, atol=1e-4)
    with xr.open_datatree(folder / "posterior.nc", engine="h5netcdf") as tree:
        kept = fit.posterior.values
        assert tree["posterior"]["mu"].shape == (kept.shape[0] * kept.shape[2], kept.shape[1])
        np.testing.assert_array_equal(
            tree["posterior"]["mu"].values[0], kept[0, :, 0, fit.posterior.names.index("mu")]
        )
        assert set(tree.children) == {"posterior", "sample_stats", "prior", "observed_data"}
    repeat = tomllib.loads((folder / "run.toml").read_text(encoding="utf-8"))
    assert repeat["fitball"]["seed"] == 4
    assert repeat["priors"]["mu"] == "normal(0.55, 0.05)"
    assert repeat["table"]["sha256"] == fit.problem.table.digest


def test_what_a_person_reads_is_si_times_its_unit():
    """One of each displayed unit, in SI, written out from its definition."""
    one = {
        "kN/m": 1000.0, "%": 0.01, "mm": 1e-3, "mm/(m/s)": 1e-3, "1e-3 s/m": 1e-3, "ms": 1e-3, "g": 1e-3,
        "deg": math.pi / 180.0, "lb/in": 4.4482216152605 / 0.0254, "lb in/rad": 4.4482216152605 * 0.0254,
        "in": 0.0254, "in/(m/s)": 0.0254, "lb": 0.45359237, "s": 1.0, "cm^2/rad": 1e-4,
    }  # fmt: skip
    scale = Scale("mm", 1e3)
    assert scale.interval(0.0012, 0.0034, 1) == "[1.2, 3.4]" and scale.measured(0.00123, 2) == "1.2 mm"
    assert scale.plus_minus(0.0012, 0.00034) == "1.20 +- 0.34" and scale.fixed(None, 1) == "-"
    for scales in (HANDY, THESIS):
        for name, scale in scales.items():
            assert scale.factor * one[scale.unit] == pytest.approx(1.0, rel=1e-15), name


def test_the_offset_line_is_quoted_at_zero_too(two_mass):
    rows = {row.name: row for row in thesis_rows(two_mass)}
    values = two_mass.point.values
    expected = (values["eps_10"] - 10.0 * values["eps_slope"]) / 0.0254
    assert float(rows["C2"].point) == pytest.approx(expected, abs=0.006)
    assert float(rows["C1 = eps_slope"].point) == pytest.approx(values["eps_slope"] / 0.0254, rel=0.05)


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        (0.55449, 0.0234, "0.554"),
        (19210.0, 4200.0, "19000"),
        (-0.01272, 0.0032, "-0.0127"),
        (3.14159, 0.96, "3.1"),
        (1234.5, 355.0, "1200"),
        (-0.0001, 0.5, "0.0"),
    ],
)
def test_rounding_follows_the_particle_data_group(value, sd, text):
    assert fixed(value, decimals(sd)) == text


@pytest.mark.parametrize(("value", "text"), [(-0.0, "0"), (0.0, "0"), (-0.00083, "-0.00083"), (None, "-")])
def test_a_zero_has_no_sign(value, text):
    assert significant(value, 2) == text


def test_no_number_is_longer_than_it_deserves(fit, two_mass, tmp_path):
    for item in (fit, two_mass):
        text = render(item, tmp_path)
        assert not re.search(r"\d\.\d{6,}", text)
        for name in item.parameters:
            assert name in text
    assert json.loads(render_json(fit, tmp_path))["parameters"]["mu"]["verdict"] == "identified"


def test_rows_say_what_the_estimates_say(two_mass):
    sections = {section.name: section.parts for section in fit_document(two_mass).sections}
    found = [str(text) for name in ("determined", "not-determined") for part in sections[name] for text in part.texts]
    for item in (*two_mass.estimates, *two_mass.derived.values()):
        assert item.reason and any(text.startswith(item.name) and item.reason in text for text in found), item.name
    row = prediction_table(two_mass)[0]
    assert [head.split(" ")[0] for head in row][3:-1] == ["v_x2", "v_y2", "omega_2"]
    measured = float(row["v_x2 [m/s]"].split(" | ")[0])
    assert measured == pytest.approx(two_mass.problem.table.measurement("v_x2").values[0], abs=0.06)


def test_balances_are_shown_with_what_their_uncertainty_supports():
    table, scene = fitball.load_table("wang_zero_spin.csv"), load_scene("wang_zero_spin.csv")
    shown, meanings = balance_table(scene_balances(table, scene))
    heads = tuple(shown.rows[0])
    assert heads == ("impact", "mu_bar", "e_x", "offset [mm]", "cor", "energy_lost [J]", "energy_fraction")
    # By hand from Table 1 of Jafri (2004): (15.62 - 11.09) / (4.81 + 4.22) and 4.22 / 4.81.
    assert shown.rows[1][1] == "0.502 +- 0.031"
    assert shown.rows[1][4] == "0.88 +- 0.05"
    assert len(meanings) == 6


# --- the first screen, the methods text


def screen_of(fit, full=False, width=100):
    with speaking_to_command_line():
        return on_terminal(fit_document(fit, folder=Path("fits/here")), Screen(width, False, full))


def test_the_first_screen_has_the_answer_in_forty_lines(two_mass, fit):
    for item in (two_mass, fit):
        first = screen_of(item)
        assert first.count("\n") + 1 <= 40
        assert item.adequacy.sentence[:30] in first and "report.html" in first and "--full" in first
        for name, estimate in item.parameters.items():
            rows = [line for line in first.splitlines() if line.startswith(f"{name} ")]
            if estimate.verdict is not Verdict.GIVEN:
                assert any(row.endswith(estimate.verdict) for row in rows), name
            elif estimate.given == ("contact_time",):
                assert any(row.endswith("by contact time") for row in rows), name
            else:
                moved = max(float(found) for row in rows for found in re.findall(r"moves ([0-9.]+) sd$", row))
                assert moved >= 0.95 * item.assumptions.parameters[name].shift, name
        spans = [*item.assumptions.parameters.values(), *item.assumptions.court_pace.values()]
        assert f"(with {max(spans, key=lambda span: span.shift).by})" in " ".join(first.split())
        assert screen_of(item, full=True).count("\n") > 2 * first.count("\n")
        narrow = screen_of(item, width=80).splitlines()
        assert len(narrow) <= 40 and max(map(len, narrow)) <= 80


def test_a_verdict_says_whether_the_median_moves_or_an_end_of_the_interval(two_mass):
    """A value whose median stays is not given because of a move of 0.22 sd."""
    mu, span = replace(two_mass.parameters["mu"], verdict=Verdict.GIVEN), two_mass.assumptions.parameters["mu"]
    own = span.own
    for shift, reached, words in (
        (0.22, 2.2, "end moves 2.2 sd"),
        (2.6, 4.0, "moves 2.6 sd"),
        (1.3, 1.1, "moves 1.3 sd"),
    ):
        moved = replace(span, shift=shift, q025=own.q025, q975=own.q975 + reached * own.sd)
        found = replace(two_mass.assumptions, parameters={"mu": moved}, constants=())
        assert brief_verdict(replace(two_mass, assumptions=found), mu) == words


def test_no_impacts_are_proposed_for_the_tails_of_a_noise(two_mass):
    """The degrees of freedom of a Student t are never two-sided where there is no outlier."""
    known = {name: replace(item, verdict=Verdict.IDENTIFIED) for name, item in two_mass.parameters.items()}
    tails = replace(known["mu"], name="degrees_of_freedom", verdict=Verdict.ONE_SIDED)
    for more, found in (
        ({}, False),
        ({"degrees_of_freedom": tails}, False),
        ({"mu": replace(tails, name="mu")}, True),
    ):
        lines = next_line(replace(two_mass, parameters=known | more, derived={}, assumptions=None))
        assert any("impacts that determine" in line for line in lines) == found


def test_medians_over_the_variants_are_those_of_the_assumptions_lowest_first(two_mass):
    given = re.sub(r"\s+", " ", screen_of(two_mass))
    spans = two_mass.assumptions.parameters
    widest = max(spans, key=lambda name: spans[name].shift)
    for name in {widest, "mu"}:
        ends = re.search(rf"\bof {name} goes from (-?[0-9.]*[0-9]) to (-?[0-9.]*[0-9])(.*)", given)
        factor = HANDY[name].factor if name in HANDY else 1.0
        low, high = spans[name].low * factor, spans[name].high * factor
        assert low < high
        assert [float(end) for end in ends.groups()[:2]] == pytest.approx([low, high], rel=0.05), name
        assert (
            ends[3].lstrip().removeprefix("x ").startswith(HANDY[name].unit) if name in HANDY else ends[3][:1] in " ."
        )


def test_what_is_wrong_is_on_the_first_screen_with_what_to_do(two_mass):
    unsure = screen_of(replace(two_mass, status=RunStatus.NOT_CONVERGED))
    assert "Warning: NOT CONVERGED" in unsure and "--max-steps" in unsure
    wrong = screen_of(replace(two_mass, adequacy=replace(two_mass.adequacy, answer=Answer.FAILS)))
    assert "Warning: Check" in wrong and "fitball compare" in wrong


def test_the_methods_text_has_the_numbers_of_the_fit(two_mass, point_fit):
    text, sampler = methods_text(two_mass), two_mass.diagnostics
    mu, found = two_mass.parameters["mu"], two_mass.assumptions
    for words in (
        f"{len(two_mass.problem.table)} impacts", f"{sampler.ensembles} independent ensembles",
        f"R-hat of at most {sampler.max_r_hat:.3f}", f"Of {len(two_mass.adequacy.checks)} residual tests",
        f"{len(found.alternatives)} model variants", f"{len(found.as_good)} fit equally well",
        f"mu = {mu.median:.3f} [{mu.q025:.3f}, {mu.q975:.3f}]", f"seed {two_mass.seed}",
    ):  # fmt: skip
        assert words in text
    assert "no posterior was sampled" in methods_text(point_fit) and "ensembles" not in methods_text(point_fit)


def test_the_most_useful_next_measurement_is_named(two_mass):
    found = two_mass.assumptions
    span = max((*found.parameters.values(), *found.court_pace.values()), key=lambda span: span.shift)
    instead = next(item.instead_of for item in found.as_good if item.name == span.by)
    assert f"{instead} and {span.by}" in next_line(two_mass)[0]
    mu = replace(two_mass.parameters["mu"], verdict=Verdict.PRIOR_DOMINATED)
    unknown = replace(two_mass, parameters={**two_mass.parameters, "mu": mu})
    assert "determine mu" in next_line(unknown)[0] and "plan" in next_line(unknown)[0]
    wrong = replace(two_mass, adequacy=replace(two_mass.adequacy, answer=Answer.FAILS))
    assert next_line(wrong) == []


ADVICE = {
    "outlier": "student-t", "tails": "student-t", "group": "offsets", "uneven": "separate",
    "linked": "incident",
}  # fmt: skip


@pytest.mark.parametrize("kind", ["trend", *ADVICE])
def test_what_was_found_leads_to_its_own_advice(two_mass, kind):
    check = replace(two_mass.adequacy.checks[0], kind=kind, over="surface", words="mu differs", found=True)
    seen = replace(two_mass.adequacy, checks=(check,), moved={}, answer=Answer.EXCEPT)
    given = remarks(replace(two_mass, adequacy=seen))
    assert len(given) == (kind in ADVICE) and ADVICE.get(kind, "") in " ".join(given)


@pytest.mark.parametrize(("stated", "ratio", "said"), [(True, 1.5, True), (False, 1.5, False), (True, 0.5, False)])
def test_residuals_beyond_a_stated_noise_lead_to_what_it_may_lack(two_mass, stated, ratio, said):
    check = replace(two_mass.adequacy.noise[0], found=True, stated=stated, ratio=ratio)
    seen = replace(two_mass.adequacy, checks=(), moved={}, answer=Answer.EXCEPT, noise=(check,))
    given = " ".join(remarks(replace(two_mass, adequacy=seen)))
    assert ("a 95 % accuracy is about two" in given and "v_1_sd" in given) is said


def test_a_misfit_names_no_place_of_a_level(two_mass):
    level = Levels("mu", "surface", ("clay", "hard"), True, (0.0, 5.0))
    moved = {"mu": 2.0, "e_x": 3.0, "mu_place[clay]": 4.0}
    seen = replace(two_mass.adequacy, checks=(), moved=moved, answer=Answer.EXCEPT)
    parameters = {**two_mass.parameters, **dict.fromkeys(level.hidden, two_mass.parameters["mu"])}
    hidden = {name: replace(item, name=name) for name, item in parameters.items()}
    fit = replace(two_mass, adequacy=seen, parameters=hidden, fitted=replace(two_mass.fitted, levels=(level,)))
    assert "shift e_x by 3 sd. " in remarks(fit)[0]
