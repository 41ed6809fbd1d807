"""Simulation-based calibration: of a posterior known in closed form, and of the house's own fits on a small scale."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from toy_experiment import Toy
from validation.command import Counter, main
from validation.sbc import run as sbc_run
from validation.sbc.figure import rank_figure
from validation.sbc.replicate import BounceExperiment, Ranked, ranks_among, run_replicate
from validation.sbc.run import run_replicates
from validation.sbc.summary import summarise, summary_json, summary_rows

from fitball.cli.terminal import ProgressLine
from fitball.errors import ResultFolderError
from fitball.inference.likelihood.posterior import densities
from fitball.scheduling.engine import engine


def findings(toy, count=200, seed=1):
    return summarise({"toy": (toy.names, [run_replicate(toy, seed, k) for k in range(count)])})


def test_the_rank_is_the_number_of_draws_below():
    draws = np.array([[1.0, 5.0], [2.0, 6.0], [3.0, 7.0]])
    assert ranks_among(np.array([2.5, 4.0]), draws) == [2, 0]


def test_an_exact_posterior_passes():
    (found,) = findings(Toy())
    assert found.complaints == ()
    assert [item.name for item in found.quantities] == ["mean", "log_likelihood"]
    for item in found.quantities:
        for part in item.coverages:
            assert part.low <= part.nominal <= part.high
    assert summary_json((found,), 1)["holds"]


@pytest.mark.parametrize("told", [0.5, 3.0])
def test_a_wrong_sigma_fails(told):
    (found,) = findings(Toy(told))
    mean, score = found.quantities
    # A fit that believes in too little noise is too sure of the mean. One that believes in far too much returns the
    # prior, which covers: the likelihood tells.
    if told < 1.0:
        assert mean.coverages[1].high < 0.8
        assert not mean.holds
    assert not score.holds
    assert found.complaints


def test_a_posterior_blind_to_the_data_is_caught_by_the_likelihood_alone():
    (found,) = findings(Toy(blind=True))
    assert found.quantities[0].holds
    assert not found.quantities[1].holds


def test_too_few_and_unconverged_replicates_prove_nothing():
    toy = Toy()
    ranked = [run_replicate(toy, 1, k) for k in range(40)]
    assert "prove nothing" in summarise({"t": (toy.names, ranked[:19])})[0].complaints[0]
    spoilt = [replace(item, converged=k > 2) for k, item in enumerate(ranked)]
    (found,) = summarise({"t": (toy.names, spoilt)})
    assert found.unconverged == 3
    assert "3 of 40 replicates did not converge" in found.complaints[0]
    # They are ranked all the same.
    assert found.quantities[0].ranks.size == 40
    failed = [*ranked[3:], *[Ranked({}, False, 0, 0.0, float("nan"), "no start")] * 3]
    (found,) = summarise({"t": (toy.names, failed)})
    assert (found.failed, found.quantities[0].ranks.size) == (3, 37)
    assert len(found.complaints) == 1


def test_an_interrupted_run_goes_on_to_the_same_bytes(tmp_path):
    whole, cut = tmp_path / "whole.csv", tmp_path / "cut.csv"
    run_replicates(Toy(), 3, 9, whole, engine(1))
    with pytest.raises(KeyboardInterrupt):
        run_replicates(Toy(fails_at=5), 3, 9, cut, engine(1))
    assert cut.read_bytes() == whole.read_bytes()[: cut.stat().st_size]
    # A line that was being written when the power failed.
    cut.write_bytes(cut.read_bytes()[:-7])
    seen = []
    ranked = run_replicates(Toy(), 3, 9, cut, engine(1), seen.append)
    assert seen == [4, 5, 6, 7, 8, 9]
    assert cut.read_bytes() == whole.read_bytes()
    assert ranked == [run_replicate(Toy(), 3, k) for k in range(9)]
    assert run_replicates(Toy(), 3, 2, whole, engine(1)) == ranked[:2]
    other = tmp_path / "other.csv"
    run_replicates(Toy(), 4, 9, other, engine(1))
    assert other.read_bytes().splitlines()[2:] != whole.read_bytes().splitlines()[2:]


def test_ranks_of_another_run_and_damaged_ones_are_refused(tmp_path):
    place = tmp_path / "ranks.csv"
    run_replicates(Toy(), 3, 2, place, engine(1))
    for toy, seed in ((Toy(0.5), 3), (Toy(), 4)):
        with pytest.raises(ResultFolderError, match="ranks of another run"):
            run_replicates(toy, seed, 4, place, engine(1))
    lines = place.read_text(encoding="utf-8").splitlines(keepends=True)
    for broken in (lines[3].replace("1,", "7,", 1), "1,x,2,1,1,5.0,1.0,\n", "1,2\n"):
        place.write_text("".join([*lines[:3], broken]), encoding="utf-8")
        with pytest.raises(ResultFolderError, match="line 4 is damaged"):
            run_replicates(Toy(), 3, 2, place, engine(1))


def test_the_truth_is_drawn_from_all_that_is_known_before_the_table():
    """Against importance sampling: prior draws weighted with the reference density over the prior."""
    experiment = BounceExperiment("wang_all.csv", "two-mass")
    problem = experiment.problem
    truths = np.array([experiment.truth(np.random.default_rng([5, k])) for k in range(120)])
    assert np.all(densities(problem, truths, measured=False).possible)
    rng = np.random.default_rng(6)
    values = problem.prior.draw(rng, 40_000)
    coordinates = problem.to_coordinates(values)
    known = densities(problem, values, measured=False)
    weight = np.where(known.possible, np.exp(known.scene), 0.0)
    weight /= weight.sum()
    made, wanted = problem.to_coordinates(truths), weight @ coordinates
    sd = np.sqrt(weight @ (coordinates - wanted) ** 2)
    assert np.all(np.abs(made.mean(axis=0) - wanted) < 3.5 * sd / np.sqrt(len(truths)))
    # The scene's contact time is part of it: without it the truths' times would scatter by more than half.
    times = problem.rebound(truths).contact_time.mean(axis=1)
    assert times.mean() == pytest.approx(5e-3, abs=3.5 * 0.5e-3 / np.sqrt(len(truths)))
    assert times.std() < 0.65e-3


def test_simulated_tables_scatter_as_the_noise_says():
    experiment = BounceExperiment("wang_all.csv", "grip-slip")
    values = experiment.truth(np.random.default_rng(1))
    rebound = experiment.problem.rebound(values[None, :])
    named = dict(zip(experiment.problem.free_names, values, strict=True))
    made = [experiment.simulated(values, np.random.default_rng(k)) for k in range(40)]
    observables = [observable for problem in made for observable in problem.observables]
    z = np.concatenate([(item.observed - item.predict(rebound)[0]) / named[item.noise] for item in observables])
    assert abs(z.mean()) < 3.5 / np.sqrt(z.size)
    assert z.std() == pytest.approx(1.0, abs=3.5 / np.sqrt(2 * z.size))
    wrong = BounceExperiment("wang_all.csv", "grip-slip", 0.5)
    told = {item.name: item.fixed for item in wrong.simulated(values, np.random.default_rng(0)).parameters}
    assert told["v_x_sd"] == pytest.approx(0.5 * named["v_x_sd"])
    assert "v_x_sd" not in wrong.names


def test_the_command_end_to_end(tmp_path, capsys):
    command = ["--models", "grip-slip", "--replicates", "2", "--cores", "1", "--out", str(tmp_path / "v")]
    assert main(command) == 1
    out, err = capsys.readouterr()
    assert "2 replicates prove nothing" in out
    assert "grip-slip: 2 of 2 replicates" in err
    names = ["ranks_grip-slip.csv", "ranks_grip-slip.png", "summary.csv", "summary.json"]
    assert sorted(item.name for item in (tmp_path / "v").iterdir()) == names
    assert sum(item.stat().st_size for item in (tmp_path / "v").iterdir()) < 500_000
    before = (tmp_path / "v" / "ranks_grip-slip.csv").read_bytes()
    assert main([*command, "--quiet", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["models"]["grip-slip"]["unconverged"] == 0
    assert (tmp_path / "v" / "ranks_grip-slip.csv").read_bytes() == before


def test_the_commands_verdict_and_exit_codes(tmp_path, capsys, monkeypatch):
    import validation.sbc.replicate as sbc

    for told, code in ((1.0, 0), (0.5, 1)):
        monkeypatch.setattr(sbc, "BounceExperiment", lambda _table, _model, _wrong, told=told: Toy(told))
        assert (
            main(["--models", "toy", "--replicates", "60", "--cores", "1", "--out", str(tmp_path / str(told))])
            == code
        )
    out = capsys.readouterr().out
    assert "The truth ranks uniformly" in out
    assert "Validation FAILED" in out

    def stop(*_args):
        raise KeyboardInterrupt

    monkeypatch.setattr(sbc_run, "run_replicate", stop)
    assert main(["--models", "toy", "--cores", "1", "--out", str(tmp_path / "c")]) == 130
    assert "the same command goes on" in capsys.readouterr().err
    for words, said in (
        (["--replicates", "0"], "replicates = 0"),
        (["--cores", "0"], "cores = 0"),
        (["--wrong-sigma", "-1"], "wrong_sigma = -1"),
        (["--models", ","], "at least one name"),
    ):
        assert main(words) == 2
        assert said in capsys.readouterr().err


def test_the_figure_shows_every_quantity():
    (found,) = findings(Toy(0.5), 60)
    figure = rank_figure(found)
    titles = [axis.get_title() for axis in figure.axes if axis.get_visible()]
    assert len(titles) == 4
    assert titles[0] == "mean: NOT uniform"
    assert len(summary_rows((found,))) == 2


def test_the_time_left_is_told_from_what_this_run_made():
    now = [0.0]
    stream = io.StringIO()
    counter = Counter(ProgressLine(False, stream, lambda: now[0]), "x", 60, "tables")
    for done in (20, 21, 59, 60):
        counter(done)
        now[0] += 40.0
    assert stream.getvalue().splitlines() == [
        "x: 20 of 60 tables",
        "x: 21 of 60 tables, about 26 min left",
        "x: 59 of 60 tables, about 2 s left",
        "x: 60 of 60 tables",
    ]
