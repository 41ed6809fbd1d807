"""Progress on stderr: one line that rewrites itself on a terminal; elsewhere lines, few enough for a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, TextIO

from fitball.cli.visible_stream import own_stream
from fitball.visible import visible

if TYPE_CHECKING:
    from fitball.inference.sampling.convergence import Convergence
    from fitball.inference.sampling.ensembles import Progress

# Time between two lines about the same stage where lines stay [s].
PATIENCE = 30.0


class ProgressLine:
    """Tells what a calibration is doing; silent when `quiet`. `clock` gives a time [s]."""

    def __init__(
        self, quiet: bool, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.quiet = quiet
        self.stream = own_stream(sys.stderr) if stream is None else stream
        self.rewrites = self.stream.isatty()
        self.clock = clock
        self.first_step: int | None = None
        self.sampling_begun = clock()
        self.convergence: Convergence | None = None
        self.width = 0
        self.stage = ""
        self.written = clock()

    def __call__(self, stage: str, progress: Progress | None) -> None:
        """Show a stage, or a step of the sampler."""
        if self.quiet:
            return
        if progress is None:
            self._show(f"{stage} ...", stage)
            return
        if self.first_step is None:
            self.first_step, self.sampling_begun = progress.step, self.clock()
        checked = progress.convergence is not self.convergence
        self.convergence = progress.convergence
        self._show(self._sampling(progress), stage, due=checked)

    def finish(self) -> None:
        """Leave the line."""
        if self.rewrites and self.width:
            self.stream.write("\r" + " " * self.width + "\r")
            self.stream.flush()

    def _sampling(self, progress: Progress) -> str:
        parts = [f"sampling: step {progress.step}"]
        convergence = progress.convergence
        if convergence is not None:
            parts.append(f"min effective sample size {convergence.min_ess:.0f} (wanted 1000)")
            parts.append(f"max R-hat {convergence.max_r_hat:.3f} (wanted below 1.01)")
        steps = progress.step - (self.first_step or 0)
        if steps > 0 and progress.step < progress.next_check:
            left = (self.clock() - self.sampling_begun) / steps * (progress.next_check - progress.step)
            parts.append(f"{left:.0f} s to the next check")
        return ", ".join(parts)

    def _show(self, text: str, stage: str, due: bool = False) -> None:
        """Show a text about a stage; where lines stay only if it is `due`, the stage is another one than before, or a
        while has passed.
        """
        text = visible(text)
        if self.rewrites:
            self.stream.write("\r" + text.ljust(self.width))
            self.width = len(text)
        elif due or stage != self.stage or self.clock() - self.written >= PATIENCE:
            self.stream.write(text + "\n")
            self.written = self.clock()
        self.stage = stage
        self.stream.flush()
