"""Whether a model describes a table, as frozen values."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Answer(StrEnum):
    """Does the model describe the table?"""

    DESCRIBES = "describes"
    EXCEPT = "describes except"
    FAILS = "does not describe"
    UNTOLD = "cannot be told"


@dataclass(frozen=True)
class Adequacy:
    """The answer, and in a sentence what it is based on."""

    answer: Answer
    sentence: str
