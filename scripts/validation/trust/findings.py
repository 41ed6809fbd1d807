"""How often is what fits say of themselves true? Rates with binomial errors, and the table of confusions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from fitball.inference.results.adequacy import FALSE_EXCEPT, FALSE_FAILS, Answer
from fitball.inference.results.results import Verdict
from validation.shared.rate import Rate
from validation.trust.replicate import REFUSED, Said, Told
from validation.trust.scenarios import SCENARIOS, Scenario

# Verdicts that stand for an interval to be relied on, within the model or given what is named.
RELIED_ON = (Verdict.IDENTIFIED, Verdict.GIVEN, Verdict.UNEXAMINED)
# The share of 95 % intervals that may hold, and of pinned parameters that may be called prior-dominated.
HOLD = (0.92, 0.98)
MOST_BLIND = 0.05
# The share of tables with a fault that may be taken for good: three of twenty.
MISSED = 0.15


@dataclass(frozen=True)
class Confusion:
    """Of parameters with one `verdict`: how many `of` all, how often the 95 % interval `holds` the truth, and how
    often the likelihood `pinned` it after all.
    """

    verdict: Verdict
    of: Rate
    holds: Rate
    pinned: Rate


@dataclass(frozen=True)
class Finding:
    """One scenario: tables by answer, tables with any objection and with the worst, and the confusions of its
    parameters; `blind` of the pinned ones are called prior-dominated. `wanted` says whether tables that no model made
    are to be objected to; None where nobody can say.
    """

    name: str
    words: str
    made: bool
    tables: int
    unconverged: int
    failed: int
    answers: Mapping[Answer, Rate]
    objected: Rate
    refused: Rate
    relied: Rate
    blind: Rate
    confusions: tuple[Confusion, ...]
    wanted: bool | None = None

    @property
    def complaints(self) -> tuple[str, ...]:
        """What speaks against the program, in words; of tables that the model did not make, only what is said of
        those that are good, or are wrong by as much as has to be found.
        """
        if self.wanted and not self.objected.agrees(1.0 - MISSED, 1.0):
            return (f"{self.name}: only {_share(self.objected)} of the tables are objected to",)
        if self.wanted is False and not self.objected.agrees(0.0, FALSE_EXCEPT):
            return (f"{self.name}: {_share(self.objected)} of good tables are objected to",)
        if not self.made:
            return ()
        faults = []
        for rate, limit, what in (
            (self.objected, FALSE_EXCEPT, "objected to"), (self.refused, FALSE_FAILS, "called not described"),
        ):  # fmt: skip
            if not rate.agrees(0.0, limit):
                faults.append(f"{self.name}: {_share(rate)} of tables that the model made are {what}")
        if not self.relied.agrees(*HOLD):
            faults.append(f"{self.name}: 95 % intervals of identified parameters hold in {_share(self.relied)}")
        if not self.blind.agrees(0.0, MOST_BLIND):
            faults.append(f"{self.name}: {_share(self.blind)} of pinned parameters are called prior-dominated")
        return tuple(faults)


def finding(name: str, words: str, made: bool, told: Sequence[Told], wanted: bool | None = None) -> Finding:
    """What the tables of one scenario, or of several together, add up to."""
    fitted = [one for one in told if not one.failed]
    said = [parameter for one in fitted for parameter in one.parameters.values()]
    answers = {answer: Rate(sum(one.answer == answer for one in fitted), len(fitted)) for answer in Answer}
    unread = sum(one.answer == REFUSED for one in fitted)
    objections = answers[Answer.EXCEPT].count + answers[Answer.FAILS].count + unread
    pinned = [one for one in said if one.pinned]
    return Finding(
        name=name,
        words=words,
        made=made,
        tables=len(told),
        unconverged=sum(not one.converged for one in fitted),
        failed=len(told) - len(fitted),
        answers=answers,
        objected=Rate(objections, len(fitted)),
        refused=answers[Answer.FAILS],
        relied=_holding(one for one in said if one.verdict in RELIED_ON),
        blind=Rate(sum(one.verdict is Verdict.PRIOR_DOMINATED for one in pinned), len(pinned)),
        confusions=tuple(_confusion(verdict, said) for verdict in Verdict if any(s.verdict is verdict for s in said)),
        wanted=wanted,
    )


def findings(told: Mapping[str, Sequence[Told]]) -> tuple[Finding, ...]:
    """Findings of each scenario, and of all together that the model made or did not make."""
    each = [
        finding(name, SCENARIOS[name].words, SCENARIOS[name].made, some, wanted(SCENARIOS[name]))
        for name, some in told.items()
    ]
    own = {name: some for name, some in told.items() if SCENARIOS[name].fault is None}
    for made, name in ((True, "all made by the model"), (False, "all not made by it")):
        some = [one for key, many in own.items() if SCENARIOS[key].made is made for one in many]
        if some:
            each.append(finding(name, name, made, some))
    return tuple(each)


def wanted(scenario: Scenario) -> bool | None:
    """Whether such tables are to be objected to; smaller faults than the usual ones show how small they may be."""
    if scenario.fault is None:
        return None
    return False if scenario.fault == "clean" else True if scenario.size >= 1.0 else None


def _holding(said: Iterable[Said]) -> Rate:
    known = [one.holds for one in said if one.holds is not None]
    return Rate(sum(known), len(known))


def _confusion(verdict: Verdict, said: Sequence[Said]) -> Confusion:
    mine = [one for one in said if one.verdict is verdict]
    judged = [one.pinned for one in mine if one.pinned is not None]
    return Confusion(verdict, Rate(len(mine), len(said)), _holding(mine), Rate(sum(judged), len(judged)))


def _share(rate: Rate) -> str:
    value = rate.value
    return "-" if value is None else f"{100 * value:.0f} % [{100 * rate.low:.0f}, {100 * rate.high:.0f}]"


def _numbers(rate: Rate) -> dict[str, object]:
    return {"count": rate.count, "of": rate.of, "share": rate.value, "low": rate.low, "high": rate.high}


def rate_rows(found: Sequence[Finding]) -> list[dict[str, object]]:
    """One row a scenario."""
    rows: list[dict[str, object]] = []
    for one in found:
        row: dict[str, object] = {
            "scenario": one.name, "made_by_the_model": _maker(one), "tables": one.tables,
            "not_converged": one.unconverged, "without_fit": one.failed,
        }  # fmt: skip
        row |= {str(answer).replace(" ", "_"): rate.count for answer, rate in one.answers.items()}
        for what, rate in (
            ("objected", one.objected), ("not_described", one.refused), ("identified_holds", one.relied),
            ("pinned_called_prior_dominated", one.blind),
        ):  # fmt: skip
            known = rate.value is not None
            row |= {what: round(rate.value or 0.0, 4) if known else "", f"{what}_of": rate.of,
                    f"{what}_low": round(rate.low, 4) if known else "",
                    f"{what}_high": round(rate.high, 4) if known else ""}  # fmt: skip
        row |= {
            "refused": one.tables - one.failed - sum(rate.count for rate in one.answers.values()),
            "words": one.words,
        }
        rows.append(row)
    return rows


def findings_json(found: Sequence[Finding], seed: int) -> dict[str, object]:
    """Everything, for machines."""
    return {
        "holds": not any(one.complaints for one in found),
        "seed": seed,
        "stated": {"objected": FALSE_EXCEPT, "not described": FALSE_FAILS, "hold": HOLD, "blind": MOST_BLIND},
        "scenarios": {
            one.name: {
                "words": one.words, "made": one.made, "tables": one.tables, "not_converged": one.unconverged,
                "without_fit": one.failed,
                "answers": {str(answer): _numbers(rate) for answer, rate in one.answers.items()},
                "objected": _numbers(one.objected), "identified_holds": _numbers(one.relied),
                "pinned_called_prior_dominated": _numbers(one.blind),
                "confusion": {
                    str(item.verdict): {"said": _numbers(item.of), "interval_holds": _numbers(item.holds),
                                        "pinned": _numbers(item.pinned)}
                    for item in one.confusions
                },
                "complaints": list(one.complaints),
            }
            for one in found
        },
    }  # fmt: skip


def findings_text(found: Sequence[Finding]) -> str:
    """Both tables as Markdown."""
    lines = [
        "# Are fits right about themselves?", "",
        "Made by `scripts/validate --trust`: tables simulated with a known truth, fitted, and what each fit says of "
        "itself. In brackets 95 % intervals of the rates (Clopper and Pearson).", "",
        "## Does the model describe the table?", "",
        "An objection is `describes except` or `does not describe`. Of tables that the model made "
        f"{100 * FALSE_EXCEPT:.0f} % may meet one, {100 * FALSE_FAILS:.0f} % the second.", "",
        "| scenario | tables | describes | except | does not | cannot be told | not read | objected |",
        "|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for one in found:
        counts = " | ".join(
            str(one.answers[answer].count)
            for answer in (Answer.DESCRIBES, Answer.EXCEPT, Answer.FAILS, Answer.UNTOLD)
        )
        unread = one.tables - one.failed - sum(rate.count for rate in one.answers.values())
        lines.append(f"| {_title(one)} | {one.tables} | {counts} | {unread} | {_share(one.objected)} |")
    lines += [
        "", "## Are verdicts true?", "",
        f"Wanted where the model made the table: {100 * HOLD[0]:.0f} to {100 * HOLD[1]:.0f} % of the 95 % intervals "
        f"of identified parameters hold the truth, and under {100 * MOST_BLIND:.0f} % of the parameters that the "
        "likelihood pins are called prior-dominated.", "",
        "| scenario | identified | hold the truth | pinned, called prior-dominated |", "|---|---|---|---|",
    ]  # fmt: skip
    lines += [
        f"| {_title(one)} | {one.relied.of} | {_share(one.relied)} | {_share(one.blind)} |"
        for one in found
        if one.confusions
    ]
    lines += [
        "",
        "| tables | verdict | parameters | 95 % interval holds the truth | pinned |",
        "|---|---|---|---|---|",
    ]
    for one in (one for one in found if one.name not in SCENARIOS):
        lines += [
            f"| {one.name} | {item.verdict} | {item.of.count} | {_share(item.holds)} | {_share(item.pinned)} |"
            for item in one.confusions
        ]
    faults = [fault for one in found for fault in one.complaints]
    lines += ["", *(f"- FAILS: {fault}" for fault in faults)] if faults else ["", "Nothing speaks against the fits."]
    return "\n".join(lines) + "\n"


def _maker(one: Finding) -> str:
    if one.name in SCENARIOS and SCENARIOS[one.name].fault is not None:
        return "other code"
    return "yes" if one.made else "no"


def _title(one: Finding) -> str:
    if one.name not in SCENARIOS:
        return f"**{one.name}**"
    if _maker(one) == "other code":
        return f"made by other code, {one.name}: {one.words}"
    return f"{one.name}: {one.words}" if one.made else f"not made by it, {one.name}: {one.words}"
