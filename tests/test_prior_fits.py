"""Fits with beta and gamma priors, of a scene and of the command line, through every verb."""

import json

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from support.density import REBOUND, table_of

import fitball
from fitball import cli

# Narrow enough to move the values: restitution is near 0.77 and friction near 0.56 in the table.
COR = (400, 140)
MU = (400, 1.5e-3)
BETA = "beta({}, {})".format(*COR)
GAMMA = "gamma({}, {})".format(*MU)
SCENE = f'[model]\nname = "grip-slip"\n[prior]\nmu = "{GAMMA}"\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Of a table with two scenes, one with a gamma prior, and two fits: one has beside that a beta
    prior by option, the other neither.
    """
    folder = tmp_path_factory.mktemp("priors")
    table = table_of(REBOUND)
    pd.DataFrame(dict(table.values)).to_csv(folder / "balls.csv", index=False)
    (folder / "gamma.toml").write_text(SCENE, encoding="utf-8")
    (folder / "plain.toml").write_text(SCENE.partition("[prior]")[0], encoding="utf-8")
    common = ["calibrate", str(folder / "balls.csv"), "--figures", "none", "--quiet"]
    for name, more in (("gamma", ["--prior", f"cor_10={BETA}"]), ("plain", [])):
        where = ["--scene", str(folder / f"{name}.toml"), "--out", str(folder / name)]
        assert cli.main([*common, *where, *more]) == 0
    return folder


@pytest.fixture(scope="module")
def fit(folder):
    return fitball.load_fit(folder / "gamma")


def test_the_posterior_is_that_of_default_priors_weighted_anew(folder, fit):
    plain = fitball.load_fit(folder / "plain").draws.values
    log = np.log(plain["mu"] / 0.6)
    weight = stats.beta(*COR).pdf(plain["cor_10"]) * stats.gamma(MU[0], scale=MU[1]).pdf(
        plain["mu"]
    )
    weight /= stats.norm(0.75, 0.15).pdf(plain["cor_10"])
    # A lognormal density with respect to the value.
    weight /= stats.norm(0.0, 0.4).pdf(log) / plain["mu"]
    weight /= weight.sum()
    assert 1.0 / np.sum(weight**2) > 100.0
    for name in ("cor_10", "mu", "e_x"):
        mean = weight @ plain[name]
        sd = np.sqrt(weight @ (plain[name] - mean) ** 2)
        assert fit.draws.values[name].mean() == pytest.approx(mean, abs=0.35 * sd), name
        assert fit.draws.values[name].std() == pytest.approx(sd, rel=0.3), name
    # It is not where the default priors have it.
    apart = fit.draws.values["cor_10"].mean() - plain["cor_10"].mean()
    assert abs(apart) > 0.35 * plain["cor_10"].std()


def test_record_and_summary_have_both_priors(folder, fit):
    record = json.loads((folder / "gamma" / "fit.json").read_text(encoding="utf-8"))
    assert record["run"]["known"]["cor_10"] == BETA
    assert record["run"]["known"]["mu"] == GAMMA
    summary = fit.summary
    assert (summary.loc["cor_10", "prior"], summary.loc["mu", "prior"]) == (BETA, GAMMA)


def test_the_report_has_both_priors(folder):
    page = (folder / "gamma" / "report.html").read_text(encoding="utf-8")
    assert BETA in page
    assert GAMMA in page


def test_the_corner_plot_draws_them(fit):
    assert fit.plot("corner").get_axes()


def test_export_to_json_has_values_and_priors(folder, capsys):
    assert cli.main(["export", str(folder / "gamma"), "--to", "json"]) == 0
    text = capsys.readouterr().out
    assert BETA in text
    assert GAMMA in text


def test_compare_takes_them(folder):
    made = fitball.compare(
        folder / "balls.csv",
        models=["grip-slip", "brody"],
        prior={"cor_10": BETA, "mu": GAMMA},
    )
    assert made.frames["models"]["model"].tolist().count("grip-slip") == 1


def test_plan_goes_on_from_them(fit):
    grid = {"speed": "15..25:2", "angle": "20..50:2", "spin": "0..100:2"}
    made = fitball.plan(fit, target="cor_10", sensor={}, count=1, **grid)
    (now,) = made.frames["targets"]["now"]
    low, high = np.quantile(fit.draws.values["cor_10"], [0.16, 0.84])
    assert now == pytest.approx(0.5 * (high - low), rel=0.1)
