"""The study of populations finds what is so: right weights hold, priors left in do not; and what it says of both."""

from __future__ import annotations

import numpy as np
import pytest
from validation.command import main
from validation.population import coverage, findings, levels
from validation.population.findings import coverages, findings_json, level_coverages
from validation.population.tables import INTERIM, QUANTITIES, draw_table, draw_truth

from fitball.inference.population.quantity import prior_of, quantity
from fitball.scheduling.engine import engine

SDS = {"mu": 0.35, "cor_10": 0.06}
# Twenty populations on levels of which every interval holds.
ON_LEVELS = [{name: 3.0 if "levels" in name else 1.0 for name in levels.columns()}] * 20


def measured(rng, name, true):
    """Draws (tables, draws) of tables that measured the `true` values once, with posteriors in closed form."""
    prior, sd = prior_of(quantity(name).parts[0], INTERIM[name]), SDS[name]
    precision = 1.0 / sd**2 + 1.0 / prior.b**2
    mean = ((true + sd * rng.standard_normal(len(true))) / sd**2 + prior.a / prior.b**2) / precision
    drawn = mean[:, None] + rng.standard_normal((len(true), 60)) / np.sqrt(precision)
    return np.exp(drawn) if quantity(name).log else drawn


def normal_tables(seed, number):
    """A population of ten tables without fits."""
    rng = np.random.default_rng([seed, number])
    truth = draw_truth(rng)
    values, draws = {}, {}
    for name in SDS:
        true = truth.centre[name] + truth.spread[name] * rng.standard_normal(10)
        values[name] = np.exp(true) if quantity(name).log else true
        draws[name] = measured(rng, name, true)
    return coverage.Fitted(truth, values, draws)


def normal_levels(seed, number):
    """A population of three levels of four tables without fits."""
    rng = np.random.default_rng([seed, number, 1])
    truth, within = draw_truth(rng), draw_truth(rng).spread
    truths, draws = {}, {}
    for name in SDS:
        values = truth.centre[name] + truth.spread[name] * rng.standard_normal(3)
        true = np.repeat(values, 4) + within[name] * rng.standard_normal(12)
        one = {"centre": truth.centre[name], "between": truth.spread[name], "within": within[name]}
        truths[name] = {what: np.array([value]) for what, value in one.items()} | {"levels": values}
        draws[name] = measured(rng, name, true)
    return truths, draws


def test_levels_hold_where_priors_are_divided_out(tmp_path, monkeypatch):
    """Tables that tell little, so that priors left in are most of what is found."""
    monkeypatch.setitem(SDS, "mu", 0.7)
    for module in (levels, findings):
        monkeypatch.setattr(module, "QUANTITIES", ("mu",))
    monkeypatch.setattr(levels, "fitted_levels", normal_levels)
    found = level_coverages(levels.run_levels(1, 3, tmp_path / "levels.csv", engine(1)))
    held = {(one.what, one.control): one.count for one in found}
    assert [one.of for one in found] == [3, 3, 3, 9] * 2
    assert held["levels", False] >= 7 > held["levels", True]
    assert all(held[what, False] >= 2 for what in ("spread between levels", "spread within levels"))


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """Twelve populations of ten tables, begun and gone on with."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coverage, "fitted_tables", normal_tables)
        patch.setattr(coverage, "TABLES", 10)
        patch.setattr("validation.population.findings.TABLES", 10)
        path = tmp_path_factory.mktemp("study") / "populations.csv"
        coverage.run_populations(1, 3, path, engine(1))
        return coverage.run_populations(1, 12, path, engine(1))


def test_intervals_hold_where_priors_are_divided_out_and_not_where_they_are_left_in(rows):
    found = {(one.quantity, one.what, one.control): one for one in coverages(rows)}
    for name in QUANTITIES:
        assert found[name, "centre", False].holds and found[name, "spread", False].holds
        assert not found[name, "centre", True].holds
        assert found[name, "tables given all", False].count > 0.9 * 120


def test_the_verdict_asks_for_the_joint_fit_too(rows):
    near = {"set": 0, "quantity": "mu"}
    for what in ("centre", "spread"):
        near |= {f"joint_{what}": 1.0, f"joint_{what}_low": 0.8, f"joint_{what}_high": 1.2}
        near |= {what: 1.01, f"{what}_low": 0.8, f"{what}_high": 1.2}
    assert findings_json(rows, [near], ON_LEVELS, 1)["holds"] is True
    assert findings_json(rows, [near | {"centre": 1.06, "spread": 1.06}], ON_LEVELS, 1)["holds"] is False
    assert findings_json(rows, [near], ON_LEVELS, 1)["joint"][0]["apart"] == pytest.approx(0.098)
    assert all(share < 0.95 for share in findings_json(rows, [near], ON_LEVELS, 1)["error_given_all"].values())


def test_a_simulated_table_has_the_values_that_it_says():
    rng = np.random.default_rng(1)
    table, values = draw_table(draw_truth(rng), 400, rng, {"velocity_sd": 1e-3, "spin_sd": 1e-2})
    (steep,) = np.where([row == max(table.impacts.v_y1) for row in table.impacts.v_y1])
    measured = next(item.values for item in table.measurements if item.name == "v_y2")[steep]
    v = table.impacts.v_y1[steep]
    assert measured / v == pytest.approx(values["cor_10"] + values["cor_slope"] * (v - 10.0), abs=1e-3)


def test_a_number_of_populations_that_cannot_be_is_refused(capsys):
    assert main(["--population", "--replicates", "0"]) == 2
    assert "replicates = 0" in capsys.readouterr().err
