"""The study of what fits say of themselves: its counting, its files, and a table of two scenarios."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest
from validation.command import main
from validation.harness import Rate
from validation.scenarios import DESIGNS, FAULTS, SCENARIOS, TRUTH, foreign_text
from validation.trust import REFUSED, finding, findings, replicate, text, wanted

from fitball.inference.results.evidence import Answer
from fitball.inference.results.results import Verdict


def told(answer=Answer.DESCRIBES, verdict=Verdict.IDENTIFIED, truth=0.5, pinned=None):
    """One table of one parameter."""
    said = {"verdict": str(verdict), "low": 0.4, "high": 0.6, "truth": truth, "pinned": pinned}
    return {"answer": str(answer), "p": 0.3, "said": {"mu": said}, "converged": True, "failed": ""}


@pytest.mark.parametrize(("count", "of"), [(0, 20), (3, 60), (20, 20)])
def test_a_rate_has_the_interval_of_clopper_and_pearson(count, of):
    expected = binomtest(count, of).proportion_ci(0.95, "exact")
    assert (Rate(count, of).low, Rate(count, of).high) == pytest.approx((expected.low, expected.high))


def test_right_fits_meet_no_complaint_and_wrong_ones_do():
    right = [told(truth=0.5 if k % 20 else 0.7) for k in range(60)]
    assert finding("wang", "", "yes", right).complaints == ()
    assert "objected to" in finding("wang", "", "yes", [told(Answer.EXCEPT)] * 12 + right).complaints[0]
    assert "not described" in finding("wang", "", "yes", [told(Answer.FAILS)] * 9 + right).complaints[-1]
    assert "0 % [0, 6] of the 95 % intervals" in finding("wang", "", "yes", [told(truth=0.7)] * 60).complaints[0]
    # Nobody promised coverage, or no objection, where the model did not make the table.
    assert finding("brody", "", "no", [told(Answer.FAILS, truth=0.7)] * 60).complaints == ()
    blind = [told(verdict=Verdict.PRIOR_DOMINATED, pinned=True)] * 20 + [told(pinned=True)] * 20
    found = finding("wang", "", "yes", blind)
    assert found.blind == Rate(20, 40)
    assert "pinned parameters are called prior-dominated" in found.complaints[0]
    # What is conditional is not relied on.
    assert finding("wang", "", "yes", [told(verdict=Verdict.CONDITIONAL, truth=0.7)] * 60).relied == Rate(0, 0)


def test_scenarios_are_put_together_by_who_made_their_tables():
    found = findings({"wang": [told()] * 3, "drop": [told()], "negated": [told(Answer.FAILS)] * 2})
    assert [(one.name, one.tables, one.objected.count) for one in found] == [
        ("wang", 3, 0), ("drop", 1, 0), ("negated", 2, 2), ("all made by the model", 4, 0),
        ("all not made by it", 2, 2),
    ]  # fmt: skip
    said = text(found)
    assert (
        "| not made by it, negated: both spins of the other sign | 2 | 0 | 0 | 2 | 0 | 0 | 100 % [16, 100] |" in said
    )
    assert "| all made by the model | identified | 4 | 100 % [40, 100] | - |" in said


@pytest.mark.parametrize("name", [name for name, scenario in SCENARIOS.items() if scenario.fault is None])
def test_a_scenario_makes_the_tables_that_it_says(name):
    scenario = SCENARIOS[name]
    rng = np.random.default_rng(1)
    values = scenario.truth(rng)
    problem = scenario.simulated(values, np.random.default_rng(2))
    assert problem.free_names == scenario.problem.free_names
    assert len(problem.impacts) == scenario.design.rows
    assert all(np.all(np.isfinite(item.observed)) for item in problem.observables)
    plain = replace(scenario, spoil=None, maker=None).simulated(values, np.random.default_rng(2))
    same = all(
        np.array_equal(one.observed, other.observed)
        for one, other in zip(problem.observables, plain.observables, strict=True)
    )
    assert same is scenario.by_model
    # A longer table is of the same design: each range is covered, and none left.
    longer = scenario.simulated(values, np.random.default_rng(2), times=5)
    assert len(longer.impacts) == 5 * scenario.design.rows
    for name_of in ("v_x1", "v_y1", "omega_1"):
        one, other = (getattr(item.impacts, name_of) for item in (problem, longer))
        assert np.ptp(other) >= np.ptp(one) - 1e-9
        assert np.ptp(other) <= 1.5 * np.ptp(one) + 1e-9


def test_tables_of_other_code_are_wrong_by_as_much_as_is_said():
    """Each fault as a share of what the same draws make without it: half a fault is half as large."""
    for name, fault in FAULTS.items():
        made = {size: rows_of(foreign_text(name, size, np.random.default_rng(7))) for size in (0.0, *fault.sizes)}
        if name == "copies":
            assert len(made[1.0]) == 60 and len(np.unique(made[1.0], axis=0)) == 12
        elif name != "clean":
            gaps = {size: np.abs(made[size] - made[0.0])[:, 3:].max() for size in fault.sizes}
            assert 0.0 < gaps[0.5] < gaps[1.0]
            assert np.array_equal(made[0.5][:, :3], made[1.0][:, :3])
    assert {one.fault for one in SCENARIOS.values()} == {None, *FAULTS}


def rows_of(text):
    return np.array([[float(cell) for cell in line.split(",")[:6]] for line in text.splitlines()[1:]])


def test_faults_that_are_missed_and_good_tables_that_are_not_described_are_complained_of():
    good, bad = [told()] * 20, [told(Answer.EXCEPT)] * 20
    unread = [{**told(), "answer": REFUSED, "said": {}}] * 20
    assert not finding("bias-grip-slip", "", "other code", bad, wanted=True).complaints
    assert not finding("copies-grip-slip", "", "other code", unread, wanted=True).complaints
    assert finding("copies-grip-slip", "", "other code", unread, wanted=True).objected == Rate(20, 20)
    assert "only 0 %" in finding("bias-grip-slip", "", "other code", good, wanted=True).complaints[0]
    assert "good tables" in finding("clean-grip-slip", "", "other code", bad, wanted=False).complaints[0]
    assert not finding("clean-grip-slip", "", "other code", good, wanted=False).complaints
    assert [wanted(SCENARIOS[name]) for name in ("clean-two-mass", "bias-two-mass", "bias-50-two-mass", "wang")] == [
        False, True, None, None,
    ]  # fmt: skip


def test_a_table_of_copies_is_refused_and_a_bias_found():
    for name, answer in (("copies-grip-slip", REFUSED), ("bias-grip-slip", "does not describe")):
        for number in range(2):
            (said,) = replicate(name, 3, number)
            assert (said["answer"], said["said"]) == (answer, {})


def test_the_broad_design_has_both_kinds_of_contact_under_the_one_truth():
    scenario = SCENARIOS["control"]
    row = np.array([[TRUTH[name] for name in scenario.problem.free_names]])
    kinds = np.unique(scenario.problem.rebound(row).regime[0])
    assert len(kinds) >= 2
    assert all(design.rows <= 40 for design in DESIGNS.values())


def test_a_replicate_says_of_each_parameter_what_it_found_and_what_is_true():
    (row,) = replicate("drop", 3, 1)
    assert row["failed"] == "" and {*row["said"]} == {"cor_10", "cor_slope", "velocity_sd"}
    assert json.loads(json.dumps(row)) == row
    for said in row["said"].values():
        assert said["low"] < said["high"] and said["truth"] is not None and said["pinned"] in (True, False, None)
        assert said["verdict"] in [*Verdict]


def test_the_command_writes_rates_and_confusions(tmp_path, capsys):
    words = ["--trust", "--scenarios", "drop", "--replicates", "1", "--cores", "1", "--quiet", "--out", str(tmp_path)]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "## Does the model describe the table?" in out
    assert (tmp_path / "trust.md").read_text(encoding="utf-8") in out
    content = json.loads((tmp_path / "trust.json").read_text(encoding="utf-8"))
    assert content["scenarios"]["drop"]["tables"] == 1
    assert (tmp_path / "confusions.csv").read_text(encoding="utf-8").startswith("scenario,verdict,parameters")
    assert (tmp_path / "rates.csv").read_text(encoding="utf-8").startswith("scenario,made_by_the_model,tables")
    assert main(["--trust", "--scenarios", "wnag"]) == 2
    assert "wang" in capsys.readouterr().err
