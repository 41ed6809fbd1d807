"""Threads of linear algebra: one while fitball works, and those of the user before and after."""

import json
import os
import subprocess
import sys

import pytest

from fitball.base.environment import cores

pytest.importorskip("threadpoolctl")

# Fits overlap without being nested: the first to begin is the first to end.
IN_PYTHON = """
import json
import numpy, scipy.linalg
from threadpoolctl import threadpool_info
from fitball.base.environment import threads

def counts():
    return sorted({pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"})

seen = [counts()]
first, second = threads(None), threads(2)
first.__enter__()
seen.append(counts())
second.__enter__()
first.__exit__(None, None, None)
seen.append(counts())
second.__exit__(None, None, None)
seen.append(counts())
try:
    with threads(1):
        raise KeyboardInterrupt
except KeyboardInterrupt:
    seen.append(counts())
print(json.dumps(seen))
"""
ON_COMMAND_LINE = """
import json, sys
from fitball import cli
code = cli.main(["check", "wang_all", "--quiet"])
import numpy, scipy.linalg
from threadpoolctl import threadpool_info
pools = [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]
print(json.dumps([code, sorted(set(pools))]))
"""


def last_line(program):
    """What a program prints last, as JSON, where the user wants two threads of linear algebra."""
    settings = {**os.environ, "OPENBLAS_NUM_THREADS": "2", "MKL_NUM_THREADS": "2"}
    command = [sys.executable, "-c", program]
    run = subprocess.run(
        command, env=settings, capture_output=True, text=True, timeout=600, check=True
    )
    return json.loads(run.stdout.splitlines()[-1])


def test_a_fit_limits_threads_and_gives_them_back():
    before, *inside, after, after_interrupt = last_line(IN_PYTHON)
    # A machine of one core has no second thread to give.
    assert before == [min(2, cores())]
    assert inside == [[1], [1]]
    assert after == after_interrupt == before


def test_the_command_line_starts_with_one_thread():
    assert last_line(ON_COMMAND_LINE) == [0, [1]]
