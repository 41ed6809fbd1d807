"""Whether a table has the columns that an impact needs, before any number is looked at."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

from fitball.data.columns import NUMBERS, REBOUND, SD_SUFFIX, Header
from fitball.data.dialect.guess import guess_of
from fitball.data.findings import Findings
from fitball.data.redundancy import independent
from fitball.observables import OBSERVABLES
from fitball.visible import some
from fitball.wording import spoken

_INCIDENT_FORMS = "v_x1 and v_y1, or v_1 and theta_1, or v_y1 alone for a drop test"
_INCIDENT_GAPS = {
    ("v_x1",): "column v_y1 is missing; expected the speed towards the court beside v_x1",
    ("v_1",): "column theta_1 is missing; expected the angle beside v_1 (for a drop test rename v_1 to v_y1)",
    ("theta_1",): "column v_1 is missing; expected the speed beside theta_1",
    (): f"no incident velocity; expected {_INCIDENT_FORMS}",
}
_NO_INCIDENT_MOTION = (
    "a rebound along the court without its incident motion; expected a column v_x1 "
    "(write zeros if the ball was dropped; a rebound speed straight up is v_y2)"
)


def knows_incident(names: Iterable[str]) -> bool:
    """Whether the columns determine the incident velocity (v_y1 alone does: a drop test)."""
    return independent(names, "1") in (("v_x1", "v_y1"), ("v_1", "theta_1"), ("v_y1",))


def check_columns(present: Collection[str], header: Header, found: Findings, rebound: bool = True) -> None:
    """Add a fault for every column that is not `present`, and a notice for what is assumed or ignored.

    Without `rebound` a table of incident columns alone is complete.
    """
    read = some([*header.numbers, *header.texts])
    incident = independent(present, "1")
    missing = []
    if len(incident) < 2 and incident != ("v_y1",):
        missing.append(f"{_INCIDENT_GAPS[incident]} (columns read: {read})")
    elif not knows_incident(present):
        missing.append(f"{' and '.join(incident)} do not make an incident velocity; expected {_INCIDENT_FORMS}")
    elif incident == ("v_y1",):
        for name in [name for name, item in OBSERVABLES.items() if item.along and name in present]:
            found.header_fault(_NO_INCIDENT_MOTION, name)
    if rebound and not any(name in present for name in REBOUND):
        missing.append(f"no rebound column; expected at least one of {', '.join(REBOUND)} (columns read: {read})")
    if missing:
        missing[0] += _what_is_meant(header.extras, present)
    for message in missing:
        found.header_fault(message)
    _check_sds(present, found)
    if "omega_2" in present and "omega_1" not in present:
        found.notice("no column omega_1: incident spin taken as 0", "omega_1")
    if header.extras:
        kept = some([_with_guess(name, present) for name in header.extras])
        found.notice(f"columns kept and not used: {kept}", *header.extras)


def _guessed(name: str, present: Collection[str]) -> tuple[str, ...]:
    """Columns of ours, not there yet, that an extra column may be."""
    guess = guess_of(name)
    return () if guess is None else tuple(item for item in guess.names if item in NUMBERS and item not in present)


def _with_guess(name: str, present: Collection[str]) -> str:
    """An extra column, and how to use it where its name says what it probably is."""
    meant = _guessed(name, present)
    if not meant:
        return name
    return f"{name} (if it is {' or '.join(meant)}: {_named({meant[0]: name})})"


def _named(columns: Mapping[str, str]) -> str:
    """How a caller says names of columns."""
    return spoken(
        f'--columns "{", ".join(f"{ours}={name}" for ours, name in columns.items())}"', f"columns={columns}"
    )


def _what_is_meant(extras: Collection[str], present: Collection[str]) -> str:
    """How to name the extra columns that may be what is missing; empty where none may."""
    sure: dict[str, str] = {}
    said = []
    for name in extras:
        meant = _guessed(name, present)
        if len(meant) == 1 and meant[0] not in sure:
            sure[meant[0]] = name
        elif len(meant) > 1:
            said.append(
                f"; '{name}' may be {' or '.join(meant)}: say which with {spoken('--columns', 'columns={...}')}"
            )
    if sure:
        said.insert(0, f"; if these are meant pass {_named(sure)}")
    if extras and not said:
        said.append(f"; if they have other names here, say which: {_named({'v_1': 'NAME', 'theta_1': 'NAME [deg]'})}")
    return "".join(said)


def _check_sds(present: Collection[str], found: Findings) -> None:
    """Add a fault for every sd without its column, and for the sd of a speed without that of its angle."""
    names = set(present)
    for name in present:
        base = name.removesuffix(SD_SUFFIX)
        if base not in names:
            message = f"a standard deviation of '{base}', but there is no column '{base}'; add it or delete this one"
            found.header_fault(message, name)
    if independent({name for name in names if not name.endswith(SD_SUFFIX)}, "1") == ("v_1", "theta_1"):
        stated = names & {"v_1_sd", "theta_1_sd"}
        if len(stated) == 1:
            missing = ({"v_1_sd", "theta_1_sd"} - stated).pop()
            message = f"column '{missing}' is missing; the incident components need the sd of both speed and angle"
            found.header_fault(message, stated.pop())
