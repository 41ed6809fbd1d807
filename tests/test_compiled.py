"""What a cold start compiles: each kernel once, without ways in that nobody takes."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np

import fitball
from fitball.models.kernels import bounce, derivative, dual, phases, vertical
from fitball.models.kernels.compiled import compiled, inner
from fitball.values import Impacts


@inner
def part(x: float, count: int, careful: bool) -> float:
    return x * count if careful else x


@compiled
def whole(x: float, count: int) -> float:
    careful = False
    for _ in range(3):
        x = part(x, 2, careful) + part(x, count, True) + part(x, 3, x > 1.0)
        careful = x > 2.0
    return x


def test_constants_are_compiled_for_no_more_than_others():
    # 1 + 2 + 1; twice that, twice, thrice; and again.
    assert whole(1.0, 2) == 4.0 * 7.0 * 7.0
    assert len(part.overloads) <= 1 == len(whole.signatures)


def test_a_kernel_for_kernels_is_python_to_python():
    kernels = (dual.exp, vertical.zero_force_release)
    # Other tests of this process may have compiled what calls them.
    before = [list(kernel.signatures) for kernel in kernels]
    assert whole(0.5, 2) > 0.0 and part(1.5, 2, True) == 3.0
    assert dual.exp(1.0) == math.exp(1.0) and vertical.zero_force_release(0.5)[0] > 0.0
    assert [list(kernel.signatures) for kernel in kernels] == before


def test_every_kind_of_array_is_served_by_one_kernel(wang_impacts, draw_priors):
    chosen = fitball.model("two-mass")
    values = draw_priors(chosen, np.random.default_rng(1), 2)
    columns = [np.array(column) for column in (wang_impacts.v_x1, wang_impacts.v_y1, wang_impacts.omega_1)]
    strided = [np.repeat(column, 2)[::2] for column in columns]
    for impacts in (wang_impacts, Impacts(*columns), Impacts(*strided), Impacts(*columns, np.full(21, 0.7))):
        chosen.evaluate(chosen.parameter_names, values, impacts)
        chosen.jacobian(chosen.parameter_names, values, impacts)
    assert len(bounce.bounce_batch.signatures) == len(derivative.jacobian_batch.signatures) == 1
    # What these call was not needed, or was compiled here.
    for kernel in (bounce.bounce, phases.two_mass_contact, phases.search):
        assert len(kernel.overloads) <= 1, kernel.py_func.__name__


def test_what_only_kernels_call_is_linked_and_has_no_machine_code_of_its_own():
    space = {"__name__": __name__, "inner": inner, "compiled": compiled}
    exec("@inner\ndef third(x):\n    return x / 3.0\n\n@compiled\ndef ninth(x):\n    return third(third(x))\n", space)
    assert space["ninth"](18.0) == 2.0
    (apart,), (entry,) = space["third"].overloads.values(), space["ninth"].overloads.values()
    assert apart.library.get_pointer_to_function(apart.fndesc.llvm_func_name) == 0
    assert entry.library.get_pointer_to_function(entry.fndesc.llvm_func_name) != 0


TOGETHER = """
import numpy as np
from dataclasses import replace
from fitball.inference.calibrate import compile_ahead
from fitball.environment import when_compiling
from fitball.models.two_mass import KERNELS, to_be_compiled
from fitball.bench.problems import posed
told = []
when_compiling(lambda compiling: told.append(compiling.kernel) if compiling else None)
print(len(to_be_compiled()))
problem = replace(posed("wang_zero_spin"), threads=2)
compile_ahead(problem)
chosen = problem.model
values = np.array([[spec.typical for spec in chosen.parameters]])
chosen.jacobian(chosen.parameter_names, values, problem.impacts)
print(len(told) > 0, sum(len(kernel.signatures) for kernel in KERNELS.values()))
"""


def test_processes_compile_what_a_fit_calls(tmp_path):
    """Each its share; the process that fits reads from disk what the others compiled."""
    told = [
        subprocess.run(
            [sys.executable, "-c", TOGETHER], capture_output=True, text=True, check=True,
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        ).stdout.split()
        for _ in range(2)
    ]  # fmt: skip
    assert told == [["3", "True", "3"], ["0", "False", "3"]]
    # No kernel that two compiled is kept: the files of one would stand in the index of the other.
    kept = {file.name.partition("-")[0].partition(".")[2] for file in tmp_path.rglob("*.nbc")}
    assert kept == {"bounce_each", "bounce_batch", "jacobian_batch"}
