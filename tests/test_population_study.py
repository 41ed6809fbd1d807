"""The study of populations finds what is so: right weights hold, priors left in do not; and what it says of both."""

from __future__ import annotations

import numpy as np
import pytest
from validation import populations as study
from validation.command import main
from validation.harness import run
from validation.populations import INTERIM, PRIORS, coverages, draw_table, draw_truth, judge

from fitball.inference.population.quantity import prior_of, quantity
from fitball.scheduling.engine import engine

SDS = {"mu": 0.35, "cor_10": 0.06}


def measured(truths, rng, _root):
    """Tables that measured their true values once, with posteriors in closed form: values, draws (tables, draws)."""
    values, draws = {}, {}
    for name, sd in SDS.items():
        true = np.array([one.centre[name] + one.spread[name] * rng.standard_normal() for one in truths])
        prior, log = prior_of(quantity(name).parts[0], INTERIM[name]), quantity(name).log
        precision = 1.0 / sd**2 + 1.0 / prior.b**2
        mean = ((true + sd * rng.standard_normal(len(true))) / sd**2 + prior.a / prior.b**2) / precision
        drawn = mean[:, None] + rng.standard_normal((len(true), 60)) / np.sqrt(precision)
        values[name], draws[name] = (np.exp(one) if log else one for one in (true, drawn))
    return values, draws


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Populations of ten tables, begun and gone on with."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "fitted", measured)
        patch.setattr(study, "TABLES", 10)
        folder = tmp_path_factory.mktemp("study")
        populations = study.studies()[0]
        run(populations, 1, 3, folder, engine(1))
        return run(populations, 1, 12, folder, engine(1))


def rates(rows):
    return {(one["quantity"], one["what"], one["priors"]): one for one in coverages(rows)}


def test_intervals_hold_where_priors_are_divided_out_and_not_where_they_are_left_in(made):
    found = rates([row for rows in made for row in rows])
    for name in SDS:
        for what in ("centre", "spread"):
            right = found[name, what, PRIORS[0]]
            assert right["of"] == 12 and right["low"] <= 0.95 <= right["high"]
        assert found[name, "centre", PRIORS[1]]["high"] < 0.95
        given = found[name, "tables given all", PRIORS[0]]
        assert given["of"] == 120 and given["holds"] > 0.9 * 120


def test_levels_hold_where_priors_are_divided_out(tmp_path, monkeypatch):
    """Tables that tell little, so that priors left in are most of what is found."""
    monkeypatch.setitem(SDS, "mu", 0.7)
    monkeypatch.setattr(study, "fitted", measured)
    rows = run(study.studies()[1], 1, 4, tmp_path, engine(1))
    found = rates([row for some in rows for row in some])
    assert found["mu", "levels", PRIORS[0]]["of"] == 12
    assert found["mu", "levels", PRIORS[0]]["holds"] >= 10 > found["mu", "levels", PRIORS[1]]["holds"]
    for what in ("spread between levels", "spread within levels"):
        assert found["mu", what, PRIORS[0]]["holds"] >= 3


def test_the_verdict_asks_for_the_joint_fit_too(made):
    every = [
        [{"quantity": name, "what": what, "priors": priors, "holds": int(priors == PRIORS[0]), "of": 1, "width": 1.0}
         for name in SDS for what in ("centre of levels", "levels") for priors in PRIORS]
    ] * 40  # fmt: skip
    near = {"set": 0, "quantity": "mu", "what": "centre", "apart": 0.1, "width": 1.0}
    told = {"populations": made, "levels": every}
    assert judge({**told, "joint": [[near]]}, 1).content["holds"] is True
    assert judge({**told, "joint": [[{**near, "apart": -0.6}]]}, 1).content["holds"] is False
    content = judge({**told, "joint": [[near]]}, 1).content
    assert all(share < 0.95 for share in content["error_given_all"].values())
    assert (content["populations"], content["tables"], content["on_levels"]) == (12, 120, 40)


def test_a_simulated_table_has_the_values_that_it_says():
    rng = np.random.default_rng(1)
    table, values = draw_table(draw_truth(rng), 400, rng, {"velocity_sd": 1e-3, "spin_sd": 1e-2})
    steep = int(np.argmax(table.impacts.v_y1))
    measured_v = next(item.values for item in table.measurements if item.name == "v_y2")[steep]
    v = table.impacts.v_y1[steep]
    assert measured_v / v == pytest.approx(values["cor_10"] + values["cor_slope"] * (v - 10.0), abs=1e-3)


def test_a_number_of_populations_that_cannot_be_is_refused(capsys):
    assert main(["--population", "--replicates", "0"]) == 2
    assert "replicates = 0" in capsys.readouterr().err
