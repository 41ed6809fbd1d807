"""Progress: one line that rewrites itself on a terminal; in a log, a line a stage, a check, or half a minute."""

from __future__ import annotations

import io
from itertools import pairwise

import pytest

from fitball.cli.terminal import ProgressLine
from fitball.environment import Compiling, tell_nobody, when_compiling
from fitball.inference.sampling.convergence import Convergence
from fitball.inference.sampling.ensembles import Progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


def mixing(ess):
    return Convergence({"mu": ess}, {"mu": ess}, {"mu": 1.02})


def told(stream, seconds_a_block):
    """A calibration of 18,400 steps, in blocks of a hundred, with checks as the sampler makes them."""
    now = [0.0]
    line = ProgressLine(False, stream, lambda: now[0])
    line("loading", None)
    line("point fit", None)
    check, found = 700, None
    for step in range(100, 18_500, 100):
        now[0] += seconds_a_block
        line("sampling", Progress(step, check, found))
        if step == check:
            found = mixing(step / 30.0)
            line("sampling", Progress(step, check, found))
            check = min(check * 2, 18_400)
    for stage in ("diagnosis", "profiles outwards", "profiles outwards", "figures and files"):
        line(stage, None)
    line.finish()
    return stream.getvalue()


@pytest.mark.parametrize(("seconds", "most"), [(0.1, 13), (5.0, 45)])
def test_a_log_has_few_lines_none_twice(seconds, most):
    lines = told(io.StringIO(), seconds).splitlines()
    assert len(set(lines)) == len(lines) <= most
    assert lines[:2] == ["loading ...", "point fit ..."]
    assert lines[-3:] == ["diagnosis ...", "profiles outwards ...", "figures and files ..."]
    # Every check is told.
    for step in (700, 1400, 2800, 5600, 11_200, 18_400):
        assert f"step {step}, smallest effective sample size {step / 30.0:.0f} (target 1000)" in "\n".join(lines)


def test_half_a_minute_of_sampling_gives_a_line():
    lines = told(io.StringIO(), 10.0).splitlines()
    steps = [int(text.split()[2].rstrip(",")) for text in lines if text.startswith("sampling")]
    assert steps[:3] == [100, 400, 700]
    assert max(b - a for a, b in pairwise(steps)) == 300


def test_a_terminal_has_one_line_that_shows_every_step():
    text = told(Terminal(), 0.1)
    assert "\n" not in text and text.endswith("\r")
    assert text.count("\r") > 180 and "step 18300" in text


def test_quiet_says_nothing():
    stream = io.StringIO()
    ProgressLine(True, stream)("loading", None)
    assert not stream.getvalue()


BATCH = Compiling("bounce_batch", "where/kernels/are/kept")


def test_compiling_is_announced_once_with_how_long_and_where():
    stream = io.StringIO()
    line = ProgressLine(False, stream)
    line("point fit", None)
    for _ in range(2):
        line.compile(BATCH)
        line.compile(None)
    stage, said = stream.getvalue().splitlines()
    assert stage == "point fit ..." and "once" in said and "ten to thirty seconds" in said
    assert "kept in where/kernels/are/kept" in said


def test_a_terminal_shows_what_is_compiled_and_then_the_stage_again():
    stream = Terminal()
    line = ProgressLine(False, stream)
    line("point fit", None)
    line.compile(BATCH)
    assert stream.getvalue().endswith("compiling bounce_batch ...")
    line.compile(None)
    assert stream.getvalue().rstrip().endswith("\rpoint fit ...")
    assert stream.getvalue().count("\n") == 1
    line.finish()
    assert stream.getvalue().endswith(" \r")


def test_what_cannot_be_kept_is_said_with_the_way_out():
    stream = io.StringIO()
    ProgressLine(False, stream).compile(Compiling("bounce_batch", None))
    assert "set NUMBA_CACHE_DIR" in stream.getvalue()
    quiet = io.StringIO()
    ProgressLine(True, quiet).compile(BATCH)
    assert not quiet.getvalue()


def test_numba_tells_of_a_kernel_but_not_of_what_it_calls_nor_of_functions_of_others(monkeypatch):
    import numba
    from numba.core.caching import CacheImpl

    from fitball.models.kernels.compiled import compiled

    def below(x):
        return x + 1.0

    def kernel(x):
        return inner(x) * 2.0

    def others(x):
        return x

    # No folder that can be written to, as in a container whose only user owns nothing: it works all the same.
    monkeypatch.setattr(CacheImpl, "_locator_classes", [])
    below.__module__ = kernel.__module__ = "fitball.toy"
    inner, outer = compiled(below), compiled(kernel)
    told = []
    when_compiling(told.append)
    try:
        assert outer(1.0) == 4.0 and numba.njit(others)(1.0) == 1.0
    finally:
        when_compiling(tell_nobody)
    assert told == [Compiling("kernel", None), None]
