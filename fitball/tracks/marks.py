"""Whether the angles of marks mean something else than stated: they may grow the other way, or look
the same more often in a turn, as those of boxes and ellipses about a mark do.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fitball.tracks.flight import Impact
from fitball.tracks.session import Session
from fitball.tracks.spins import FEWEST_ANGLES, log_evidence, pairs_of

# By so much the log likelihood of all angles must rise if they are turned round.
_LEAST_GAIN = 5.0
# By so much it must rise with another fold: a few angles are on a line of a higher one by chance,
# with gains of up to 11 in 1,700 simulated films of one impact; right ones gain 17 and more.
_LEAST_GAIN_FOLD = 12.0
# By so much it must rise if angles are turned round, beside another fold.
_LEAST_GAIN_TURNED = 3.0
# How many times more often than stated a mark may look the same: that of a box four times.
_MULTIPLES = (1, 2, 3, 4)
# Spins of an impact are plausible from this probability of all pairs together on,
_PLAUSIBLE = 0.5
# in this share of the impacts without sure spins, if another reading is right.
_SHARE_PLAUSIBLE = 0.75
# No spin of an impact is plausible below this probability of all pairs.
_IMPLAUSIBLE = 0.05
# Doubts take errors of angles that are so many times larger than those of the session, and such a
# share of outliers at least, since few impacts hardly show their own.
_LARGER_ERRORS = 2.0
_MORE_OUTLIERS = 0.2


class Reading(NamedTuple):
    """How angles are read: `turned` round or as stated, and how many times the stated fold theirs
    is.
    """

    turned: bool
    multiple: int


class MarkDoubts(NamedTuple):
    """The impacts of a session without sure spins, by reason: several pairs of spins are plausible
    (`ambiguous`), or none is (`implausible`). With another `reading` of the angles, if there is
    one, all are implausible as they were read.
    """

    ambiguous: Sequence[Impact]
    implausible: Sequence[Impact]
    reading: Reading | None


def doubts_of_marks(session: Session) -> MarkDoubts:
    """The impacts of a session whose marks do not determine the spins, and the reading of the
    angles, if any, by which bounces are far more plausible.
    """
    marked = [impact for impact in session.good if _is_marked(impact)]
    unsure = [impact for impact in marked if not impact.sure_pair]
    if not unsure:
        return MarkDoubts([], [], None)
    reading = _better_reading(marked, unsure, session)
    if reading is not None:
        return MarkDoubts([], unsure, reading)
    listed_unsure = [impact for impact in unsure if impact.pairs]
    implausible = [impact for impact in listed_unsure if _is_implausible(impact, session)]
    ambiguous = [impact for impact in listed_unsure if impact not in implausible]
    return MarkDoubts(ambiguous, implausible, None)


def _is_marked(impact: Impact) -> bool:
    """Whether an impact has angles enough on both sides to show spins."""
    return min(int(use.sum()) for use in impact.turning()) >= FEWEST_ANGLES


def _better_reading(
    marked: Sequence[Impact],
    unsure: Sequence[Impact],
    session: Session,
) -> Reading | None:
    """The reading of angles by which all `marked` impacts are far more plausible than as stated,
    and those with `unsure` spins are plausible; None where there is none.
    """
    best = None
    stated = _log_evidence(marked, Reading(False, 1), session)
    least = stated + _LEAST_GAIN
    for multiple in _MULTIPLES:
        as_stated, turned = (Reading(way, multiple) for way in (False, True))
        evidence = _log_evidence(marked, as_stated, session)
        evidence_turned = _log_evidence(marked, turned, session)
        reading = as_stated
        if evidence_turned > evidence + _LEAST_GAIN_TURNED:
            evidence = evidence_turned
            reading = turned
        needed = max(least, stated + _LEAST_GAIN_FOLD * (multiple > 1))
        if evidence > needed and _makes_plausible(unsure, reading, session):
            best = reading
            least = evidence
    return best


def _log_evidence(impacts: Sequence[Impact], reading: Reading, session: Session) -> float:
    """Log likelihood of the angles of impacts if they are read so. An angle that is known up to a
    turn over a fold says that much less.
    """
    log = 0.0
    for impact in impacts:
        other = _read_as(impact, reading)
        angles = sum(int(use.sum()) for use in other.turning())
        log += log_evidence(other, session.assumed, *_large_errors(session))
        log -= angles * np.log(reading.multiple)
    return float(log)


def _makes_plausible(impacts: Sequence[Impact], reading: Reading, session: Session) -> bool:
    """Whether a reading of angles makes the spins of most impacts plausible."""
    plausible = 0
    for impact in impacts:
        other = _read_as(impact, reading)
        other.pairs = pairs_of(other, session.assumed, *_large_errors(session))
        plausible += _probability(other) > _PLAUSIBLE
    return plausible >= _SHARE_PLAUSIBLE * len(impacts)


def _read_as(impact: Impact, reading: Reading) -> Impact:
    """A copy of an impact whose angles are read another way."""
    other = copy(impact)
    if reading.turned:
        other.phi = -impact.phi
    other.track = replace(impact.track, fold=reading.multiple * impact.track.fold)
    return other


def _is_implausible(impact: Impact, session: Session) -> bool:
    """Whether no spin of an impact is plausible as angles are read."""
    other = copy(impact)
    other.pairs = pairs_of(other, session.assumed, *_large_errors(session))
    return _probability(other) < _IMPLAUSIBLE


def _large_errors(session: Session) -> tuple[float, float]:
    """Noise [rad] and share of outliers of the angles of a session that its impacts may have."""
    noise = _LARGER_ERRORS * session.angle_noise
    return noise, max(session.angle_outliers, _MORE_OUTLIERS)


def _probability(impact: Impact) -> float:
    """The probability that one of the pairs of spins that the marks allow is that of the ball."""
    return float(sum(pair.probability for pair in impact.pairs))
