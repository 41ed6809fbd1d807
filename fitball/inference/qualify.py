"""From what a table tells of a parameter within a model to what may be said of it: a model that fails identifies
nothing, and a value that moves with an assumption is known only given that assumption, and where assumptions
could not be examined the verdict says so.
"""

from __future__ import annotations

from collections.abc import Sequence

from fitball.inference.identifiability.posterior_verdict import Judgement
from fitball.inference.results.adequacy import Adequacy
from fitball.inference.results.assumptions import Assumptions
from fitball.inference.results.results import Verdict


def qualified(
    name: str,
    judged: Judgement,
    adequacy: Adequacy | None,
    assumptions: Assumptions | None,
    parts: Sequence[str] = (),
) -> tuple[Verdict, tuple[str, ...]]:
    """The verdict on one parameter, or on a quantity that follows from the parameters called `parts`, and the
    assumptions it is given; None for what was not looked at.
    """
    if judged.verdict is not Verdict.IDENTIFIED:
        return judged.verdict, ()
    if adequacy is not None and any(adequacy.conditional(one) for one in (name, *parts)):
        return Verdict.CONDITIONAL, ()
    given = (*judged.given, *rests_on(name, adequacy, assumptions))
    if given or assumptions is None or assumptions.examined:
        return (Verdict.GIVEN if given else Verdict.IDENTIFIED), given
    return Verdict.UNEXAMINED, ()


def rests_on(name: str, adequacy: Adequacy | None, assumptions: Assumptions | None) -> tuple[str, ...]:
    """The choices that the value of a parameter is given."""
    known = [found.given.get(name, ()) for found in (adequacy, assumptions) if found is not None]
    return tuple(dict.fromkeys(choice for choices in known for choice in choices))
