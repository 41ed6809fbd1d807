"""The one door to processes: what goes through it is the same on one core, on two, and on a Dask cluster."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from door_tasks import blamed, dies_at_first, elsewhere, folder_elsewhere, slow_to_fast
from samples import HANG, drop_table, problem_of
from toy_experiment import Toy
from validation.harness import run

import fitball
from fitball.errors import FitError, ParameterError
from fitball.inference.identifiability.profile import profiles
from fitball.inference.point.point_fit import maximum_posterior, starting_points
from fitball.report.form.files import json_text
from fitball.scheduling import local
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


def said_of(item, how):
    return item[2], how


@pytest.mark.parametrize("cores", [1, 2])
def test_who_kills_its_process_is_told_from_the_others_which_are_made_once_each(tmp_path, cores):
    items = [(tmp_path / str(k), 0, what) for k, what in enumerate(("", "abort", "", "killed", ""))]
    made = list(engine(cores).unordered(elsewhere, items, lost=said_of))
    lost = {("abort", "signal SIGABRT"), ("killed", "signal SIGKILL")}
    assert sorted(map(str, made)) == sorted(map(str, [*lost, *["elsewhere"] * 3]))
    # The process that asks made none of them, and what a task itself raises is raised.
    with pytest.raises(FitError, match="no such ball"):
        list(engine(cores).unordered(elsewhere, [(tmp_path / "fails", 0, "fails")] * 2, lost=said_of))


def test_one_that_dies_only_beside_others_is_made_when_it_is_alone(tmp_path):
    """As where memory runs out: the system kills one of several that each would do alone."""
    items = [(tmp_path / "crowded", tmp_path), (tmp_path / "other", None)]
    assert sorted(engine(2).unordered(dies_at_first, items, lost=said_of)) == ["crowded", "other"]


def test_a_process_that_may_have_ended_meanwhile_is_given_no_task(monkeypatch):
    """Loky would start another behind it, and would not notice its death: who asked would wait for ever."""

    def process():
        ((_number, process, _told),) = engine(1).unordered(slow_to_fast, [9], lost=said_of)
        return process

    monkeypatch.setattr(local, "_waiting", [])
    first = process()
    assert process() == first
    local._waiting[:] = [(pool, since - local.WARM) for pool, since in local._waiting]
    assert process() != first
    while local._waiting:
        local._waiting.pop()[0].shutdown(kill_workers=True)


CODE = """
from pathlib import Path
from door_tasks import busy
from fitball.scheduling.engine import engine
def said(item, how): raise AssertionError(how)
list(engine({cores}).unordered(busy, [Path({place!r})] * 3, here={here}, lost={lost}))
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks at processes as Linux shows them")
@pytest.mark.parametrize(("cores", "here", "lost"), [(2, "None", "said"), (3, "lambda _place: busy.wait", "None")])
def test_workers_end_with_a_parent_that_was_killed(tmp_path, start, cores, here, lost):
    """None is left to write beside whoever asks next."""
    code = CODE.format(cores=cores, place=str(tmp_path), here=here, lost=lost)
    parent = start("-c", code.replace("busy.wait", "__import__('time').sleep(1e9)"), cwd=Path(__file__).parent)
    begun = time.monotonic()
    while len(list(tmp_path.iterdir())) < 2:
        assert parent.poll() is None and time.monotonic() - begun < HANG
        time.sleep(0.02)
    workers = [int(place.name) for place in tmp_path.iterdir()]
    assert parent.pid not in workers
    parent.kill()
    parent.wait(HANG)
    while any(map(runs, workers)):
        assert time.monotonic() - begun < HANG, "workers outlive their parent"
        time.sleep(0.02)


def runs(process):
    """Whether a process is there that is no zombie."""
    try:
        return Path(f"/proc/{process}/stat").read_text("utf-8").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


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


def test_whom_a_cluster_blames_for_a_death_is_made_alone_before_it_is_lost(cluster, tmp_path):
    """Dask blames every task that was at a worker when it died."""
    items = [(tmp_path / name, name == "killer") for name in ("innocent", "killer", "other")]
    made = list(engine(scheduler=cluster).unordered(blamed, items, lost=lambda item, _how: f"lost {item[0].name}"))
    assert sorted(made) == ["innocent", "lost killer", "other"]


@pytest.fixture
def certificates(tmp_path):
    """A certificate that it signs itself, which is all that scheduler, worker and client trust."""
    cert, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    making = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    named = ["-days", "2", "-subj", "/CN=fitball", "-keyout", key, "-out", cert]
    subprocess.run([*making, *named], check=True, capture_output=True)
    files, who = {"cert": str(cert), "key": str(key)}, ("client", "scheduler", "worker")
    own = {f"distributed.comm.tls.{one}.{what}": place for one in who for what, place in files.items()}
    return {"distributed.comm.tls.ca-file": str(cert), **own}


@pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl to make certificates with")
def test_a_cluster_is_reached_by_tls_with_the_certificates_that_dask_was_told_of(certificates, tmp_path):
    dask, distributed = pytest.importorskip("dask"), pytest.importorskip("distributed")
    with dask.config.set(certificates):
        security = distributed.Security(require_encryption=True)
        with distributed.LocalCluster(
            1, processes=False, threads_per_worker=1, dashboard_address=None, security=security, protocol="tls://"
        ) as made:
            address = made.scheduler_address
            assert address.startswith("tls://")
            assert list(engine(scheduler=address).unordered(abs, [-3, 4])) in ([3, 4], [4, 3])
            for missing in ({}, {"distributed.comm.tls.ca-file": str(tmp_path / "none.pem")}):
                told = {**dict.fromkeys(certificates), **missing}
                with dask.config.set(told), pytest.raises(ParameterError, match="TLS__CLIENT__CERT"):
                    list(engine(scheduler=address).unordered(abs, [1]))


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
        run(Toy().study, 3, 6, tmp_path / name, workers)
    one, two, many = ((tmp_path / name / "ranks_toy.jsonl").read_bytes() for name in engines)
    assert one == two == many


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
