"""Names of columns by the words that they are made of: quantity, direction, end of the bounce.

A name says our column where each of its words is in the lexicon. Names of data sets and runs, which
programs write about those of columns, are left out.
"""

from __future__ import annotations

import re
from functools import lru_cache

from fitball.base.columns import HEIGHTS
from fitball.base.units import symbol_of

# A longer cell is no name of ours, and patterns take time with the square of the length.
MOST_CHARACTERS = 100
# Letters of the longest word that a name is cut into.
_MOST_LETTERS = 20
# Words of names by what they mean: quantity, direction, end of the bounce, deviation, nothing.
_LEXICON = {
    "quantity": {
        "v": "v vel velo velocity velocities speed speeds geschwindigkeit geschw tempo vitesse "
        "velocidad velocità velocita",
        "theta": "theta angle angles ang alpha winkel ángulo angulo angolo",
        "omega": "omega spin spins w rot rotation drall drehzahl winkelgeschwindigkeit",
        "contact_time": "contacttime tcontact contactduration kontaktzeit tc",
        "height": "h height heights hoehe höhe hauteur altura altezza",
    },
    "direction": {
        "x": "x horizontal hor horiz tangential tan parallel",
        "y": "y z vertical vert normal perpendicular perp",
        "z": "lateral sideways sideway seitlich",
    },
    "end": {
        "1": "1 in inc incident incoming incidence inbound impact before pre prior initial init "
        "start approach pitch pitched landing i vor vorher avant drop dropped fall ein "
        "chute caída caida caduta antes prima einfall einfalls auftreff aufprall",
        "2": "2 out outgoing outbound reb rebound rebounding exit after post final end f r bounce "
        "bounced nach nachher aus après apres rücksprung ruecksprung "
        "rückprall rueckprall absprung rebond rebote rimbalzo después despues dopo abprall "
        "ausfalls",
    },
    "sd": {
        "_sd": "sd std stdev sigma err error errors uncertainty unc fehler unsicherheit erreur "
        "incertitude"
    },
    "filler": {
        "": "ball of the mean avg average measured launch de du la le del di der des "
        "balle balles pelota palla"
    },
}
_WORDS = {
    word: (kind, meaning)
    for kind, meanings in _LEXICON.items()
    for meaning, words in meanings.items()
    for word in words.split()
}
# Words that alone, as the name of a column, mean a height.
_OF_A_DROP = {"drop", "fall", "rebound", "bounce"}
# The name of a data set before that of a column: `Latest: Time (s)`, of Logger Pro.
_DATA_SET = re.compile(r"[^:\[\](){}]+:\s*(?P<name>\S.*)")
# What programs call a run of measurements, with its number.
_RUN_NAME = (
    r"\(?(?:run|series|set|data set|messung|versuch|lauf|essai)\s*(?:#|no\.?|nr\.?)?\s*\d{1,4}\)?"
)
# A run behind or before the name of a column: `Time (s) Run #1`, of Capstone.
_BEFORE_RUN = re.compile(rf"(?P<name>.*[^\s,;])[\s,;]+{_RUN_NAME}", re.IGNORECASE)
_BEHIND_RUN = re.compile(rf"{_RUN_NAME}[\s,;]+(?P<name>\S.*)", re.IGNORECASE)
# A unit in brackets, wherever it stands in a cell.
_BRACKETED = re.compile(r"\s*[\[(]([^\[\](){}]*)[\])]")


def bare_name(name: str) -> str:
    """A name without case, blanks, underscores and the like; Greek letters and indices in Latin."""
    for letter, word in {"θ": "theta", "ϑ": "theta", "ω": "omega", "σ": "sd"}.items():
        name = name.casefold().replace(letter, word)
    return re.sub(r"[\s_.\-]+", "", name.translate(str.maketrans("₁₂ₓᵧ", "12xy")))


def without_data_set(cell: str) -> str:
    """A header cell without the name of a data set before a colon, or of a run behind it."""
    if len(cell) > MOST_CHARACTERS:
        return cell
    for pattern in (_DATA_SET, _BEFORE_RUN, _BEHIND_RUN):
        if match := pattern.fullmatch(cell.strip()):
            cell = match["name"]
    return cell


def without_unit(cell: str) -> tuple[str, str]:
    """A header cell without the unit in brackets, wherever that stands, and the unit."""
    for bracketed in _BRACKETED.finditer(cell):
        if symbol_of(bracketed[1]) and not bracketed[1].strip().isdecimal():
            around = f"{cell[: bracketed.start()]} {cell[bracketed.end() :]}"
            return " ".join(around.split()), bracketed[1]
    return " ".join(cell.split()), ""


def end_of(name: str) -> str | None:
    """The end of the bounce that a name speaks of: "1" incident, "2" rebound; None where it says
    neither, or both.
    """
    ends = {value for kind, value in _meanings(name) if kind == "end"}
    if not ends:
        ends = set(re.findall(r"(?<![0-9])[12](?![0-9])", name))
    return ends.pop() if len(ends) == 1 else None


def guess_of(name: str) -> tuple[str, ...]:
    """Names of ours that `name` may mean: one where it says which, both ends where it says the
    quantity only, none where it is no name of an impact's quantity.
    """
    meanings = [meaning for meaning in _meanings(without_data_set(name)) if meaning[0] != "filler"]
    kinds = dict(meanings)
    usual = "height" if bare_name(name) in _OF_A_DROP else ""
    quantity = kinds.get("quantity", usual)
    says_twice = len(kinds) < len(meanings)
    if not quantity or says_twice or ("direction" in kinds and quantity != "v"):
        return ()
    sd = kinds.get("sd", "")
    if quantity == "contact_time":
        return (quantity + sd,)
    ends = kinds.get("end", "12")
    if quantity == "height":
        return tuple(HEIGHTS[int(end) - 1] + sd for end in ends)
    direction = kinds.get("direction", "")
    return tuple(f"{quantity}_{direction}{end}{sd}" for end in ends)


def is_unit(word: str) -> bool:
    """Whether a word of a name is a unit, and no word of ours."""
    return len(word) > 1 and bare_name(word) not in _WORDS and symbol_of(word) is not None


def _meanings(name: str) -> list[tuple[str, str]]:
    """The meanings of the words of a name, units left out; none if it has other words."""
    return [_WORDS[word] for word in words_in(name)]


def words_in(name: str) -> list[str]:
    """The words of a name, units left out; none if it has other words."""
    if len(name) > MOST_CHARACTERS:
        return []
    text = bare_name("".join(word for word in name.split() if not is_unit(word)))
    return _words_of(text) or []


@lru_cache(10_000)
def _words_of(text: str) -> list[str] | None:
    """The text as words, the longest first; None where no way of cutting it leaves nothing over."""
    if not text:
        return []
    for size in range(min(len(text), _MOST_LETTERS), 0, -1):
        word = text[:size]
        if word in _WORDS:
            rest = _words_of(text[size:])
            if rest is not None:
                return [word, *rest]
    return None
