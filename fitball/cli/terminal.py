"""The terminal as all verbs write to it: progress on stderr, one line that rewrites itself on a terminal, elsewhere
few enough for a log; text from files cannot steer it, and a stream that is closed or full is no reason to fail.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, TextIO, cast

from fitball.environment import Compiling, tell_nobody, when_compiling
from fitball.visible import visible
from fitball.wording import Screen, screen

if TYPE_CHECKING:
    from fitball.inference.sampling.convergence import Convergence
    from fitball.inference.sampling.ensembles import Progress


class Stream:
    """A text stream that makes control characters visible, and what its encoding lacks, unless it is `plain`; all
    else is that stream's. What the system says of it bears its `name`; of `remarks`, such as progress, what cannot be
    written is lost: there is no place left to say so, and the work goes on without them.
    """

    def __init__(self, stream: TextIO, name: str = "", remarks: bool = False, plain: bool = False) -> None:
        self.stream, self.name, self.remarks, self.plain = stream, name, remarks, plain
        self.broken: OSError | None = None

    def write(self, text: str) -> int:
        """Write `text`. Raises OSError."""
        encoding = getattr(self.stream, "encoding", None) or "utf-8"
        shown = text if self.plain else visible(text)
        shown = shown.encode(encoding, "backslashreplace").decode(encoding)
        with self._named():
            self.stream.write(shown)
        return len(text)

    def flush(self) -> None:
        """Let what was written leave. Raises OSError, also for what was lost before: argparse does not look."""
        if self.broken is not None:
            raise self.broken
        with self._named():
            self.stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    @contextlib.contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            _give_up(self.stream)
            if not self.remarks:
                self.broken = type(error)(error.errno, error.strerror, self.name)
                raise self.broken from None


def _give_up(stream: TextIO) -> None:
    """Let what a broken stream still holds go nowhere: Python would try once more when it ends, and complain."""
    with contextlib.suppress(OSError, AttributeError):
        number = stream.fileno()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, number)
        os.close(nowhere)


@contextlib.contextmanager
def visible_streams() -> Iterator[None]:
    """Everything printed meanwhile, by whomever, is made visible."""
    _open_closed_streams()
    out, err = cast(TextIO, Stream(sys.stdout, "standard output")), cast(TextIO, Stream(sys.stderr, remarks=True))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        yield


def _open_closed_streams() -> None:
    """Open what the caller closed (`>&-`) on the null device: Python has no stream then, and the next file that is
    opened would take its number, and with it what other programs and libraries print.
    """
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            # The system gives the lowest number that is free, which is the stream's; workers are to have it too.
            stream = open(os.devnull, "r" if name == "stdin" else "w", encoding="utf-8")  # noqa: PTH123, SIM115
            os.set_inheritable(stream.fileno(), True)
            setattr(sys, name, stream)


def own_stream(stream: TextIO) -> TextIO:
    """The stream below, for a program's own line that rewrites itself."""
    return cast(TextIO, Stream(stream.stream, remarks=True, plain=True)) if isinstance(stream, Stream) else stream


def screen_of(args: argparse.Namespace) -> Screen:
    """The screen that a verb's report is shown on: the terminal's width where there is one, its colours unless
    NO_COLOR (no-color.org) or TERM=dumb says that it is to have none; what comes first unless `--full` is given.
    """
    here = sys.stdout.isatty()
    plain = bool(os.environ.get("NO_COLOR")) or os.environ.get("TERM", "dumb") == "dumb"
    width = min(max(shutil.get_terminal_size((WIDEST, 24)).columns, NARROWEST), WIDEST) if here else WIDEST
    return Screen(width, here and not plain, getattr(args, "full", True))


# Letters a line: more are hard to read, fewer leave no room for a name and a number.
NARROWEST, WIDEST = 40, 100


def show(report: str) -> None:
    """Print a report that `on_terminal` laid out: it is visible already, and may have colours."""
    out = sys.stdout
    if screen().colour and isinstance(out, Stream):
        out = cast(TextIO, Stream(out.stream, out.name, plain=True))
    print(report, file=out)


# Measured on an idle core of 2023; the second sentence says where.
COMPILING = "compiling the kernels of the bounce: once for this version of fitball, ten to thirty seconds; {kept}"
KEPT = "kept in {folder}"
NOT_KEPT = (
    "not kept, since neither the folder of fitball nor that of your cache can be written to: set NUMBA_CACHE_DIR"
)
# Time between two lines about the same stage where lines stay [s].
PATIENCE = 30.0


class ProgressLine:
    """Prints the stage of a calibration, and when kernels are compiled for it; silent when `quiet`. `clock` gives a
    time [s].
    """

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
        self.text = ""
        self.announced = False

    def compile(self, compiling: Compiling | None) -> None:
        """Say once that kernels are compiled, how long that lasts and where they are kept; then show which."""
        if self.quiet:
            return
        shown = self.text
        if compiling is None:
            self._rewrite(shown)
            return
        if not self.announced:
            self.announced = True
            kept = NOT_KEPT if compiling.folder is None else KEPT.format(folder=compiling.folder)
            self._rewrite("")
            self.stream.write(visible(COMPILING.format(kept=kept)) + "\n")
        self._rewrite(f"compiling {compiling.kernel} ...")
        self.text = shown

    def _rewrite(self, text: str) -> None:
        """Let the line of a terminal read `text`; elsewhere nothing is rewritten."""
        if self.rewrites:
            self.stream.write("\r" + text.ljust(self.width) + ("" if text else "\r"))
            self.width, self.text = len(text), text
        self.stream.flush()

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

    def count(self, stage: str, words: str, due: bool = False) -> None:
        """Show how far a stage is, in words."""
        if not self.quiet:
            self._show(words, stage, due)

    def finish(self) -> None:
        """Leave the line."""
        self._rewrite("")

    def _sampling(self, progress: Progress) -> str:
        from fitball.api.reading import sampling_words

        words, steps = sampling_words(progress), progress.step - (self.first_step or 0)
        if steps <= 0 or progress.step >= progress.next_check:
            return words
        left = (self.clock() - self.sampling_begun) / steps * (progress.next_check - progress.step)
        return f"{words}, {left:.0f} s to the next check"

    def _show(self, text: str, stage: str, due: bool = False) -> None:
        """Show a text about a stage; where lines stay only if it is `due`, the stage is another one than before, or a
        while has passed.
        """
        text = visible(text)
        if self.rewrites:
            self._rewrite(text)
        elif due or stage != self.stage or self.clock() - self.written >= PATIENCE:
            self.stream.write(text + "\n")
            self.written = self.clock()
        self.stage = stage
        self.stream.flush()


def time_left(seconds: float, done: int, rest: int) -> str:
    """How long the `rest` takes, as people say it, if those `done` took so many seconds; "" while it is unknown."""
    if done <= 0 or rest <= 0:
        return ""
    left = seconds / done * rest
    if left < 90.0:
        return f", about {left:.0f} s left"
    return f", about {left / 60.0:.0f} min left" if left < 5400.0 else f", about {left / 3600.0:.1f} h left"


@contextlib.contextmanager
def told_of_compiling(args: argparse.Namespace) -> Iterator[None]:
    """Give a verb its `args.progress`, which says when it compiles too, unless it is to be quiet."""
    args.progress = line = ProgressLine(getattr(args, "quiet", False))
    when_compiling(line.compile)
    try:
        yield
    finally:
        line.finish()
        when_compiling(tell_nobody)
