"""Progress on stderr: one line that rewrites itself on a terminal, a line a check elsewhere."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, TextIO

from fitball.cli.visible_stream import own_stream
from fitball.visible import visible

if TYPE_CHECKING:
    from fitball.inference.sampling.ensembles import Progress


class ProgressLine:
    """Tells what a calibration is doing; silent when `quiet`."""

    def __init__(self, quiet: bool, stream: TextIO | None = None) -> None:
        self.quiet = quiet
        self.stream = own_stream(sys.stderr) if stream is None else stream
        self.rewrites = self.stream.isatty()
        self.begun = time.monotonic()
        self.first_step: int | None = None
        self.sampling_begun = self.begun
        self.width = 0
        self.last = ""

    def __call__(self, stage: str, progress: Progress | None) -> None:
        """Show a stage, or a step of the sampler."""
        if self.quiet:
            return
        if progress is None:
            self._show(f"{stage} ...", lasting=not self.rewrites)
            return
        if self.first_step is None:
            self.first_step, self.sampling_begun = progress.step, time.monotonic()
        self._show(self._sampling(progress), lasting=not self.rewrites)

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
            left = (time.monotonic() - self.sampling_begun) / steps * (progress.next_check - progress.step)
            parts.append(f"{left:.0f} s to the next check")
        return ", ".join(parts)

    def _show(self, text: str, lasting: bool) -> None:
        text = visible(text)
        if self.rewrites:
            self.stream.write("\r" + text.ljust(self.width))
            self.width = len(text)
        elif lasting and text != self.last:
            self.stream.write(text + "\n")
        self.last = text
        self.stream.flush()
