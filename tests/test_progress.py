"""Progress: one line that rewrites itself on a terminal; in a log, a line a stage, a check, or half a minute."""

from __future__ import annotations

import io
from itertools import pairwise

import pytest

from fitball.cli.progress import ProgressLine
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
        assert f"sampling: step {step}, min effective sample size {step / 30.0:.0f} (wanted 1000)" in "\n".join(lines)


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
