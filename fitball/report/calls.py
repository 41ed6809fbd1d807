"""Commands of hints as calls of Python, for those who read them in a notebook."""

from __future__ import annotations

import html
import re
import shlex
from collections.abc import Sequence

from fitball.report.own_folder import FIT

# A command in HTML: its verb, and what follows.
_COMMAND = re.compile(r"<code>fitball (calibrate|check|compare|plan) (.*?)</code>")
# Options that take pairs, each a name with its value, and numbers among these.
_PAIRS = ("columns", "fix", "prior", "pool", "derive")
_NUMBERS = ("fix",)
# A comma before the name of the next pair: those within a prior stay.
_NEXT_PAIR = re.compile(r",(?=[^,()]*=)")


def with_calls(text: str) -> str:
    """HTML with the calls of Python in place of commands."""
    return _COMMAND.sub(lambda found: _as_code(found[1], html.unescape(found[2])), text)


def _as_code(verb: str, words: str) -> str:
    """A command as code in HTML."""
    return f"<code>{html.escape(call_of(verb, shlex.split(words)), quote=False)}</code>"


def call_of(verb: str, words: Sequence[str]) -> str:
    """The call of a verb with the words of a command: sources, and options after `--`."""
    sources = list[str]()
    options: dict[str, list[str]] = {}
    for word in words:
        if word.startswith("--"):
            options[word.removeprefix("--").replace("-", "_")] = []
        elif options:
            options[[*options][-1]].append(word)
        else:
            sources.append(word)
    chosen = [f"{name}={_value(name, ' '.join(values))}" for name, values in options.items()]
    if sources == [FIT]:
        return f"fit.{verb}({', '.join(chosen)})"
    read = repr(sources[0]) if len(sources) == 1 else repr(sources)
    return f"fitball.{verb}({', '.join([read, *chosen])})"


def _value(name: str, text: str) -> str:
    """The value of an option as Python has it; of one without a text True."""
    if not text:
        return "True"
    if name not in _PAIRS:
        return repr(text)
    pairs = [pair.partition("=")[::2] for pair in _NEXT_PAIR.split(text)]
    shown = [f"{key!r}: {value if name in _NUMBERS else repr(value)}" for key, value in pairs]
    return f"{{{', '.join(shown)}}}"
