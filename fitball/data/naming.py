"""Names of columns that are not ours, as a user states them: `--columns "v_1=Vin, theta_1=angle_in [deg]"`."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from fitball.data.dialect.guess import bare, guess_of
from fitball.data.findings import Findings
from fitball.data.frozen import FrozenMapping
from fitball.data.units import unit_of
from fitball.errors import ParameterError, suggestion
from fitball.visible import some

_WITH_UNIT = re.compile(r"(?P<name>.*?\S)\s*\[(?P<unit>[^\[\]]*)\]")


@dataclass(frozen=True)
class Naming:
    """What each of our columns is called in a table (`theirs`, by our name), and in which unit, where that is said
    here (`units`, by our name).
    """

    theirs: Mapping[str, str] = field(default_factory=FrozenMapping)
    units: Mapping[str, str] = field(default_factory=FrozenMapping)

    @property
    def texts(self) -> dict[str, str]:
        """As it was stated: our names, and theirs with their units."""
        return {
            name: f"{their} [{self.units[name]}]" if name in self.units else their
            for name, their in self.theirs.items()
        }

    def ours(self, *names: str) -> str | None:
        """Our name of a column that is called by one of `names`; None where nothing was said of it."""
        wanted = {name.strip().casefold() for name in names}
        return next((ours for ours, their in self.theirs.items() if their.casefold() in wanted), None)

    def unit(self, ours: str, written: str | None, found: Findings) -> str | None:
        """The unit of a column as text, where `written` is that of the header; a fault where the two differ."""
        stated = self.units.get(ours)
        if stated is not None and written is not None and unit_of(stated) != unit_of(written):
            message = f"the header says '[{written}]' and the names that were given '[{stated}]'; expected one unit"
            found.header_fault(message, self.theirs[ours])
        return written if stated is None else stated

    def check_absent(self, present: Collection[str], read: Collection[str], found: Findings) -> None:
        """Add a fault for each name that the header has not, unless our own is `present`; `read` are the header's."""
        here, listed = {name.casefold() for name in read}, some([*read])
        for ours, their in self.theirs.items():
            if their.casefold() not in here and ours not in present:
                found.header_fault(
                    f"there is no column '{their}', which is to be {ours} as asked; columns read: {listed}"
                )


def naming(columns: Mapping[str, str], known: Collection[str]) -> Naming:
    """The naming that texts such as `Vin` or `Vin [mph]`, by our name (one of `known`), state.

    Raises ParameterError for a name that is none of ours, and for one of theirs that is to be two of ours.
    """
    theirs, units = dict[str, str](), dict[str, str]()
    for ours, text in columns.items():
        if ours not in known:
            guess = guess_of(ours)
            near = [name for name in guess.names if name in known] if guess is not None else []
            hint = f"did you mean {' or '.join(near)}?" if near else suggestion(ours, known)
            raise ParameterError(f"columns: '{ours}' is none of fitball's columns ({ours}={text}): {hint}")
        matched = _WITH_UNIT.fullmatch(text.strip())
        their = matched["name"] if matched else text.strip()
        if not their:
            raise ParameterError(f"columns: read no name for {ours}; expected {ours}=NAME or {ours}=NAME [UNIT]")
        if their.casefold() in {other.casefold() for other in theirs.values()}:
            raise ParameterError(f"columns: '{their}' is to be two columns; expected one name for each")
        theirs[ours] = their
        if matched:
            units[ours] = matched["unit"]
    return Naming(FrozenMapping(theirs), FrozenMapping(units))


def with_units(columns: Mapping[str, str], units: Mapping[str, str], known: Collection[str]) -> dict[str, str]:
    """`columns` with the `units` of columns by our name or by theirs. Raises ParameterError for another name."""
    said = naming(columns, known)
    texts = said.texts
    for name, unit in units.items():
        ours = said.ours(name) or next((item for item in known if bare(item) == bare(name)), None)
        if ours is None:
            raise ParameterError(f"units: '{name}' is no column: {suggestion(name, known)}")
        if ours in said.units:
            raise ParameterError(f"units: that of {name} stands in columns too; expected it once")
        texts[ours] = f"{said.theirs.get(ours, name)} [{unit}]"
    return texts
