"""One damaged input, one command, and whether the command ended as it must."""

from __future__ import annotations

import contextlib
import io
import shlex
import shutil
import signal
import traceback
import warnings
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

# More than this nobody reads; a terminal that scrolls for minutes hides what matters.
MOST_CHARACTERS = 20_000
# Whatever takes longer reads something that never ends [s].
HANG = 600


@dataclass(frozen=True)
class Target:
    """One kind of input to damage.

    `build` writes a valid input into an empty folder. `mutate` damages a copy of that folder and returns what it did;
    for an option's text, which lies in no file, it returns the damaged text. `commands` are command lines of
    `fitball`, of which each case takes one at random; in their words `{folder}` stands for the copy and `{text}` for
    what `mutate` returned. `exits` are the exit codes that may come: 1 is a check that failed. `few` is the number
    of cases that the suite tries.
    """

    name: str
    build: Callable[[Path], None]
    mutate: Callable[[Path, np.random.Generator], str]
    commands: tuple[tuple[str, ...], ...]
    exits: tuple[int, ...] = (0, 2)
    few: int = 20


@dataclass(frozen=True)
class Case:
    """A command line on a damaged input; `damage` says what `mutate` did."""

    damage: str
    words: tuple[str, ...]


@dataclass(frozen=True)
class Ending:
    """How a command ended: its exit code (None after an exception), what it printed, warnings of libraries, `error`
    the traceback.
    """

    code: int | None
    out: str
    err: str
    warned: tuple[str, ...] = ()
    error: str = ""


def make_case(target, valid, place, index):
    """Case `index`, its files in the new folder `place`, made from those in `valid`. The same index gives the same
    case, whichever cases ran before.
    """
    rng = np.random.default_rng([1, zlib.crc32(target.name.encode()), index])
    shutil.copytree(valid, place)
    damage = target.mutate(place, rng)
    command = target.commands[rng.integers(len(target.commands))]
    return Case(damage, tuple(word.replace("{folder}", str(place)).replace("{text}", damage) for word in command))


def run_case(case, main):
    """Run the command as a user's terminal would see it: streams are UTF-8 and as strict as Python makes them."""
    streams = [io.TextIOWrapper(io.BytesIO(), "utf-8", errors) for errors in ("strict", "backslashreplace")]
    error, code = "", None
    with (
        contextlib.redirect_stdout(streams[0]),
        contextlib.redirect_stderr(streams[1]),
        warnings.catch_warnings(record=True) as caught,
    ):
        warnings.simplefilter("always")
        try:
            with _no_hang():
                code = main(case.words)
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        except Exception:
            error = traceback.format_exc()
    out, err = (_text(stream) for stream in streams)
    warned = tuple(f"{item.filename}:{item.lineno}: {item.category.__name__}: {item.message}" for item in caught)
    return Ending(code, out, err, warned, error)


@contextlib.contextmanager
def _no_hang():
    def stop(_signal, _frame):
        raise TimeoutError("it hangs")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(HANG)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def _text(stream):
    stream.flush()
    return stream.detach().getvalue().decode()


def complaints(target, case, ending):
    """What is wrong with how a case ended; nothing when it ended well."""
    faults = []
    if ending.error:
        faults.append(f"exception: {ending.error.strip().splitlines()[-1][:300]}")
    elif ending.code not in target.exits:
        faults.append(f"exit {ending.code}")
    if ending.warned:
        faults.append(f"a warning of a library: {ending.warned[0][-300:]}")
    if ending.code == 2 and not ending.err.strip() and not ending.out.strip():
        faults.append("exit 2 without a word")
    # Data for programs is as long as the data.
    shown = ending.err if "--json" in case.words else ending.out + ending.err
    if len(shown) > MOST_CHARACTERS:
        faults.append(f"{len(shown)} characters of text")
    wild = sorted({character for character in ending.out + ending.err if _controls(character)})
    if wild:
        faults.append(f"control characters on the terminal: {', '.join(f'U+{ord(item):04X}' for item in wild[:5])}")
    return faults


def _controls(character):
    return (character < " " and character not in "\n\t\r") or "\x7f" <= character <= "\x9f"


def findings(target, valid, folder, main, cases):
    """Run cases 0 to `cases` - 1 below `folder`; say of those that broke the rule what was damaged, the command and
    the end of the traceback, in ASCII alone: a command may hold anything. Their files stay.
    """
    broken = []
    for index in range(cases):
        place = folder / str(index)
        case = make_case(target, valid, place, index)
        ending = run_case(case, main)
        said = complaints(target, case, ending)
        if said:
            command = ascii(shlex.join(["fitball", *case.words])[:400])
            head = f"{target.name} {index} ({case.damage[:80]!a}): {'; '.join(map(ascii, said))}"
            broken.append("\n  ".join([head, command, *ending.error.strip().splitlines()[-6:]]))
        else:
            shutil.rmtree(place)
    return broken
