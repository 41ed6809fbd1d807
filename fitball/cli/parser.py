"""The parser of every verb: whole names of options only, and a suggestion for each one it does not know."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from fitball.errors import suggestion
from fitball.visible import one_line


class Parser(argparse.ArgumentParser):
    """As argparse's, with mistakes told in the words of fitball, exit code 2.

    Abbreviations are refused: `--over` would be `--overwrite` today and something else after the next version.
    """

    def __init__(self, *positional: Any, **named: Any) -> None:
        super().__init__(*positional, **{"allow_abbrev": False, **named})
        # As argparse has it, but for ranges and units behind the number: `--spin -300:300`.
        self._negative_number_matcher = re.compile(r"^-\.?\d")

    # The signature of argparse is wider than what it ever passes.
    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> tuple[Any, list[str]]:  # type: ignore[override]
        """As argparse's, but a word it does not know is an error of the verb that it stands behind."""
        words = list(sys.argv[1:] if args is None else args)
        self._refuse_unknown(words)
        parsed, rest = super().parse_known_args(words, namespace)
        if rest:
            self._refuse(rest[0])
        return parsed, []

    def error(self, message: str) -> NoReturn:
        """Tell a mistake of the command line, and where to read on."""
        self.exit(2, f"fitball: {one_line(message)}\nsee {self.prog} --help\n")

    def _refuse_unknown(self, words: Sequence[str]) -> None:
        """Name the first unknown option, or verb, before argparse misses what stands behind it."""
        verbs = next((a for a in self._actions if isinstance(a, argparse._SubParsersAction)), None)
        for word in words:
            if word == "--":
                return
            if verbs is not None and not word.startswith("-"):
                if word not in verbs.choices:
                    kind = str(verbs.metavar).lower()
                    self.error(f"unknown {kind} '{word}': {suggestion(word, verbs.choices)}")
                return
            if word.startswith("--") and word.partition("=")[0] not in self._option_string_actions:
                self._refuse(word)

    def _refuse(self, word: str) -> NoReturn:
        verb = self.prog.partition(" ")[2]
        if not word.startswith("-") or word == "-":
            self.error(f"read '{word}', one word more than {verb or self.prog} takes")
        name = word.partition("=")[0]
        if not verb:
            self.error(f"unknown option '{name}' before a verb; options of a verb stand behind it")
        options = [option for option in self._option_string_actions if option.startswith("--")]
        begun = [option for option in options if option.startswith(name)]
        hint = f"did you mean {' or '.join(map(repr, begun))}?" if begun else suggestion(name, options)
        self.error(f"unknown option '{name}' of {verb}: {hint}")
