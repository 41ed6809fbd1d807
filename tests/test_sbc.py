"""Simulation-based calibration: of a posterior known in closed form, and of the house's own fits on a small scale."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from toy_experiment import Toy
from validation import ranks
from validation.command import Counter, main
from validation.harness import run
from validation.ranks import Bounces, complaints, judge, quantities, rank_figure, ranks_among

from fitball.cli.terminal import ProgressLine
from fitball.errors import ResultFolderError
from fitball.inference.likelihood.posterior import densities
from fitball.scheduling.engine import engine


def made(toy, count=200, seed=1):
    """Records of the toy's replicates."""
    return [row for k in range(count) for row in toy.replicate(seed, k)]


def found_of(rows):
    """The quantities and what is complained of."""
    found = quantities({"toy": rows})
    return found, complaints(rows, found)


def test_the_rank_is_the_number_of_draws_below():
    draws = np.array([[1.0, 5.0], [2.0, 6.0], [3.0, 7.0]])
    assert ranks_among(np.array([2.5, 4.0]), draws) == [2, 0]


def test_an_exact_posterior_passes():
    rows = made(Toy())
    found, complained = found_of(rows)
    assert complained == []
    assert [item.name for item in found] == ["mean", "log_likelihood"]
    for item in found:
        for nominal, part in item.coverages.items():
            assert part.low <= nominal <= part.high
    assert judge({"toy": rows}, 1).content["holds"]


@pytest.mark.parametrize("told", [0.5, 3.0])
def test_a_wrong_sigma_fails(told):
    (mean, score), complained = found_of(made(Toy(told)))
    # A fit that believes in too little noise is too sure of the mean. One that believes in far too much returns the
    # prior, which covers: the likelihood tells.
    if told < 1.0:
        assert mean.coverages[0.8].high < 0.8
        assert not mean.holds
    assert not score.holds
    assert complained


def test_a_posterior_blind_to_the_data_is_caught_by_the_likelihood_alone():
    (mean, score), _complained = found_of(made(Toy(blind=True)))
    assert mean.holds and not score.holds


def test_a_slant_that_no_bin_shows_is_seen_by_the_empirical_distribution():
    slanted = (200 * ((np.arange(300) + 0.5) / 300) ** 1.35).astype(int).tolist()
    (found,) = quantities({"toy": [{"ranks": {"mean": rank}, "converged": True, "failed": ""} for rank in slanted]})
    assert found.chi_square_p > 0.01 > found.ecdf_p
    assert not found.holds


def test_too_few_and_unconverged_replicates_prove_nothing():
    ranked = made(Toy(), 40)
    assert "prove nothing" in found_of(ranked[:19])[1][0]
    found, complained = found_of([{**row, "converged": k > 2} for k, row in enumerate(ranked)])
    assert "3 of 40 replicates did not converge" in complained[0]
    # They are ranked all the same.
    assert found[0].ranks.size == 40
    found, complained = found_of([*ranked[3:], *[{"ranks": {}, "converged": False, "failed": "no start"}] * 3])
    assert found[0].ranks.size == 37
    assert len(complained) == 1 and "3 had no fit" in complained[0]


def test_an_interrupted_run_goes_on_to_the_same_bytes(tmp_path):
    def place(name):
        return tmp_path / name / "ranks_toy.jsonl"

    whole = run(Toy().study, 3, 9, tmp_path / "whole", engine(1))
    with pytest.raises(KeyboardInterrupt):
        run(Toy(fails_at=5).study, 3, 9, tmp_path / "cut", engine(1))
    assert place("whole").read_bytes().startswith(place("cut").read_bytes())
    # A line that was being written when the power failed.
    place("cut").write_bytes(place("cut").read_bytes()[:-7])
    seen = []
    assert run(Toy().study, 3, 9, tmp_path / "cut", engine(1), seen.append) == whole
    assert seen == [4, 5, 6, 7, 8, 9]
    assert place("cut").read_bytes() == place("whole").read_bytes()
    assert whole == [Toy().replicate(3, k) for k in range(9)]
    assert run(Toy().study, 3, 2, tmp_path / "whole", engine(1)) == whole[:2]
    assert run(Toy().study, 4, 9, tmp_path / "other", engine(1)) != whole


def test_replicates_of_another_run_and_damaged_ones_are_refused(tmp_path):
    run(Toy().study, 3, 2, tmp_path, engine(1))
    for toy, seed in ((Toy(0.5), 3), (Toy(), 4)):
        with pytest.raises(ResultFolderError, match="replicates of another run"):
            run(toy.study, seed, 4, tmp_path, engine(1))
    place = tmp_path / "ranks_toy.jsonl"
    lines = place.read_text(encoding="utf-8").splitlines(keepends=True)
    for broken in (lines[2].replace("}", "", 1), "[1, 2]\n", "{}\n", "\n"):
        place.write_text("".join([*lines[:2], broken]), encoding="utf-8")
        with pytest.raises(ResultFolderError, match="line 3 is damaged"):
            run(Toy().study, 3, 2, tmp_path, engine(1))
    place.write_bytes(b"\xff")
    with pytest.raises(ResultFolderError, match="cannot be read"):
        run(Toy().study, 3, 2, tmp_path, engine(1))


def test_the_truth_is_drawn_from_all_that_is_known_before_the_table():
    """Against importance sampling: prior draws weighted with the reference density over the prior."""
    experiment = Bounces("wang_all.csv", "two-mass")
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
    experiment = Bounces("wang_all.csv", "grip-slip")
    values = experiment.truth(np.random.default_rng(1))
    rebound = experiment.problem.rebound(values[None, :])
    named = dict(zip(experiment.problem.free_names, values, strict=True))
    made = [experiment.simulated(values, np.random.default_rng(k)) for k in range(40)]
    observables = [observable for problem in made for observable in problem.observables]
    z = np.concatenate([(item.observed - item.predict(rebound)[0]) / named[item.noise] for item in observables])
    assert abs(z.mean()) < 3.5 / np.sqrt(z.size)
    assert z.std() == pytest.approx(1.0, abs=3.5 / np.sqrt(2 * z.size))
    wrong = Bounces("wang_all.csv", "grip-slip", 0.5)
    told = {item.name: item.fixed for item in wrong.simulated(values, np.random.default_rng(0)).parameters}
    assert told["v_x_sd"] == pytest.approx(0.5 * named["v_x_sd"])
    assert "v_x_sd" not in wrong.names


def test_the_command_end_to_end(tmp_path, capsys):
    command = ["--models", "grip-slip", "--replicates", "2", "--cores", "1", "--out", str(tmp_path / "v")]
    assert main(command) == 1
    out, err = capsys.readouterr()
    assert "2 replicates prove nothing" in out
    assert "grip-slip: 2 of 2 replicates" in err
    names = ["ranks_grip-slip.jsonl", "ranks_grip-slip.png", "summary.csv", "summary.json"]
    assert sorted(item.name for item in (tmp_path / "v").iterdir()) == names
    assert sum(item.stat().st_size for item in (tmp_path / "v").iterdir()) < 500_000
    before = (tmp_path / "v" / "ranks_grip-slip.jsonl").read_bytes()
    assert main([*command, "--quiet", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["models"]["grip-slip"]["unconverged"] == 0
    assert (tmp_path / "v" / "ranks_grip-slip.jsonl").read_bytes() == before


def test_the_commands_verdict_and_exit_codes(tmp_path, capsys, monkeypatch):
    for told, code in ((1.0, 0), (0.5, 1)):
        monkeypatch.setattr(ranks, "Bounces", lambda _table, _model, _wrong, told=told: Toy(told))
        assert (
            main(["--models", "toy", "--replicates", "60", "--cores", "1", "--out", str(tmp_path / str(told))])
            == code
        )
    out = capsys.readouterr().out
    assert "The truth ranks uniformly" in out
    assert "Validation FAILED" in out

    monkeypatch.setattr(ranks, "Bounces", lambda *_given: Toy(fails_at=0))
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
    found = quantities({"toy": made(Toy(0.5), 60)})
    figure = rank_figure("toy", found)
    titles = [axis.get_title() for axis in figure.axes if axis.get_visible()]
    assert len(titles) == 4
    assert titles[0] == "mean: NOT uniform"


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
