"""The one door to processes: what goes through it is the same on one core, on two, and on a Dask cluster."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from door_tasks import elsewhere, folder_elsewhere, slow_to_fast
from samples import drop_table, problem_of
from toy_experiment import Toy
from validation.sbc.run import run_replicates

import fitball
from fitball.errors import FitError, ParameterError
from fitball.inference.identifiability.profile import profiles
from fitball.inference.point.maximum_posterior import maximum_posterior
from fitball.inference.point.starts import starting_points
from fitball.report.form.json_text import json_text
from fitball.scheduling.engine import engine, in_order
from fitball.wording import speaking_to_command_line


def test_this_process_works_too_and_what_is_made_comes_in_order():
    with speaking_to_command_line():
        made = list(in_order(engine(2), slow_to_fast, range(8)))
    assert [number for number, _process, _told in made] == list(range(8))
    processes = {process for _number, process, _told in made}
    assert os.getpid() in processes
    assert len(processes) <= 2
    # Another process speaks to whom this one does.
    assert all(told for _number, _process, told in made)
    assert made[0][1] == os.getpid(), "the longest task must not wait for a process to start"


def test_a_process_that_is_killed_or_fails_ends_all_with_a_word(tmp_path):
    for what, error, said in (("fails", FitError, "no such ball"), ("killed", ParameterError, "killed")):
        with pytest.raises(error, match=said):
            list(engine(2).unordered(elsewhere, [(tmp_path / what, os.getpid(), what)] * 2))
    # The next who ask are served.
    again = engine(2).unordered(elsewhere, [(tmp_path / "begun", os.getpid(), "")] * 2)
    assert sorted(again) == ["elsewhere", "here"]


def test_other_processes_name_files_from_the_folder_of_who_asks(cluster, tmp_path, monkeypatch):
    for name, workers in (("one", engine(2)), ("two", engine(2)), ("three", engine(scheduler=cluster))):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        made = dict(workers.unordered(folder_elsewhere, [(tmp_path / name / "begun", os.getpid())] * 2))
        assert made["elsewhere"] == str(tmp_path / name)


def test_a_cluster_that_loses_a_worker_says_so(cluster, monkeypatch):
    pytest.importorskip("dask").config.set({"distributed.scheduler.allowed-failures": 0})
    with pytest.raises(ParameterError, match="killed"):
        list(engine(scheduler=cluster).unordered(elsewhere, [(Path(os.devnull), 0, "killed")]))


def compared(table, **how):
    found = fitball.compare(table, ["brody", "two-mass+cor=mean"], quick=True, max_steps=100, **how)
    content = found.json()
    for item in (content, *content["models"]):
        item["seconds"] = 0.0
    return json_text(content), [score.fit.posterior.draws.tobytes() for score in found.result.models]


def test_compare_is_the_same_on_one_core_two_and_a_cluster(cluster):
    table = drop_table(np.random.default_rng(1), count=4)
    one = compared(table, cores=1)
    assert compared(table, cores=2) == one
    assert compared(table, scheduler=cluster) == one


def test_validation_is_the_same_on_one_core_two_and_a_cluster(cluster, tmp_path):
    engines = {"one": engine(1), "two": engine(2), "cluster": engine(scheduler=cluster)}
    for name, workers in engines.items():
        run_replicates(Toy(), 3, 6, tmp_path / name, workers)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes() == (tmp_path / "cluster").read_bytes()


def test_profiles_are_the_same_on_one_core_two_a_cluster_and_together(cluster):
    problem = problem_of("wang_zero_spin.csv", "grip-slip")
    optima = maximum_posterior(problem, starting_points(problem, np.random.default_rng(1), 2)).optima

    def found(workers):
        made = profiles(problem, optima, engine=workers)
        assert set(made.by_name) == set(problem.free_names)
        return [(one.name, one.values.tobytes(), one.drop.tobytes()) for one in made.by_name.values()]

    together = found(None)
    for workers in (engine(1), engine(2), engine(scheduler=cluster)):
        assert found(workers) == together


@pytest.mark.parametrize("cores", [0, -1])
def test_no_core_is_refused(cores):
    with pytest.raises(ParameterError, match="at least 1"):
        engine(cores)
