"""Are the verdicts of a fit right? Tables from the model, and others, are simulated and fitted. The study counts how
often a fit says that the model describes them, and how often intervals of identified parameters contain the truth.

No fit is needed to find which parameters the likelihood of a design determines at a truth. A table without noise, at
the design's incidence and with the true noise known, has the expected profile likelihood of all tables of that design
(the Asimov data set of Cowan, Cranmer, Gross and Vitells 2011, section 3). A table a hundred times as long has one a
hundred times as steep. No prior is used.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fitball.errors import FitballError, FitError
from fitball.inference.adequacy.describe import adequacy
from fitball.inference.assemble import qualified
from fitball.inference.assumptions.look import look
from fitball.inference.calibrate import search_again
from fitball.inference.identifiability.examine import examine, profile_all
from fitball.inference.identifiability.information import prior_draws
from fitball.inference.identifiability.profile import DROP_95, profile_contraction, profiles
from fitball.inference.point.point_fit import point_fit
from fitball.inference.prediction.posterior_predictive import regime_shares
from fitball.inference.problem.parameters import NOISE_SPECS, Parameter
from fitball.inference.problem.problem import Problem
from fitball.inference.results.evidence import FALSE_EXCEPT, FALSE_FAILS, Adequacy, Answer, End, Profile
from fitball.inference.results.results import Posterior, thinned
from fitball.inference.results.results import Verdict as Said
from validation.harness import CHAIN, Rate, Row, Study, Verdict, drawn_values, rate, short_chain
from validation.scenarios import FAULTS, SCENARIOS, Scenario, foreign_problem

# Contraction from which a table is said to pin a parameter (half the prior's sd), and that which a table `LONGER`
# times as long must miss for it to be beyond any table.
PINNED, BEYOND = 0.75, 0.2
LONGER = 100.0


def pinned(problem: Problem, truth: Mapping[str, float]) -> dict[str, bool | None]:
    """For each free parameter of a `problem` whether its likelihood pins it at a `truth` (by name, in SI).

    True if the expected profile, without the scene's contact time, is closed on both sides, and leaves, times the
    prior, less than half of the prior's sd. Prior-dominated is then a mistake. False if, with a hundred times the
    rows and the scene's contact time, it is open on both sides or leaves the prior unchanged. Identified is then a
    mistake. None in between.
    """
    table = _without_noise(problem, truth)
    alone = profiles(table, [truth], scene=False).by_name
    sure = {
        parameter.name
        for parameter in problem.free
        if (
            _noise_pinned(problem, parameter)
            if parameter.name in NOISE_SPECS
            else parameter.name in alone and _is_pinned(alone[parameter.name], parameter)
        )
    }
    rest = [name for name in alone if name not in sure]
    beside = profiles(table, [truth], names=rest).by_name if rest and table.contact_time is not None else alone
    lost = {item.name for item in problem.free if item.name in rest and _is_beyond(beside.get(item.name), item)}
    return {name: True if name in sure else False if name in lost else None for name in problem.free_names}


def _without_noise(problem: Problem, truth: Mapping[str, float]) -> Problem:
    """The table and the scene's contact time as the model has them, the true noise held."""
    held = tuple(
        replace(item, fixed=truth[item.name]) if item.free and item.name in NOISE_SPECS else item
        for item in problem.parameters
    )
    rebound = problem.rebound(np.array([[truth[name] for name in problem.free_names]]))
    made = tuple(replace(one, observed=one.predict(rebound)[0]) for one in problem.observables)
    time = problem.contact_time
    if time is not None:
        time = (float(rebound.contact_time.mean()), time[1])
    return replace(problem, parameters=held, observables=made, contact_time=time)


def _is_pinned(profile: Profile, parameter: Parameter) -> bool:
    return not any(profile.open_sides) and profile_contraction(profile, parameter.prior) >= PINNED


def _is_beyond(profile: Profile | None, parameter: Parameter) -> bool:
    if profile is None:
        return False
    longer = replace(profile, drop=LONGER * profile.drop)
    still = [
        end is End.RANGE or (end is not End.CLOSED and longer.drop[side] < DROP_95)
        for end, side in zip(profile.ends, (0, -1), strict=True)
    ]
    return all(still) or profile_contraction(longer, parameter.prior) < BEYOND


def _noise_pinned(problem: Problem, parameter: Parameter) -> bool:
    """By the expected information of a noise, 2 n of its logarithm, the parameters' share of the rows taken off."""
    count = sum(one.observed.size for one in problem.observables if one.noise == parameter.name)
    every = sum(one.observed.size for one in problem.observables)
    spent = sum(name not in NOISE_SPECS for name in problem.free_names) * count / every
    variance = 0.5 / max(count - spent, 1e-9)
    return parameter.prior.variance >= PINNED * (parameter.prior.variance + variance)


LEVELS = (0.025, 0.975)
# What is said of a table that is not read.
REFUSED = "refused"
# Verdicts that stand for an interval to be relied on, within the model or given what is named.
RELIED_ON = (Said.IDENTIFIED, Said.GIVEN, Said.UNEXAMINED)
# The share of 95 % intervals that may hold, and of pinned parameters that may be called prior-dominated.
HOLD = (0.92, 0.98)
MOST_BLIND = 0.05
# The share of tables with a fault that may be taken for good: three of twenty.
MISSED = 0.15


def study(name: str) -> Study:
    """The tables of the scenario called `name`."""
    scenario = SCENARIOS[name]
    known = scenario.problem
    settings = {
        "scenario": name, "model": scenario.model, "words": scenario.words, "rows": len(known.impacts),
        "parameters": [[item.name, item.prior.text, item.fixed] for item in known.parameters], **CHAIN,
    }  # fmt: skip
    return Study(name, partial(replicate, name), settings, name, "tables")


def replicate(name: str, seed: int, number: int) -> list[Row]:
    """One record, of table `number` of a scenario. It has the answer (`REFUSED` if not read), the smallest
    probability of any test, `converged`, and why a fit `failed`. `said` has for each parameter the verdict, the ends
    of the 95 % interval, the truth (or None), and whether the likelihood pins it (see `pinned`).
    """
    scenario = SCENARIOS[name]
    if scenario.fault is not None:
        return [_described(scenario, seed, number)]
    # The scenario counts too: with the same numbers in each, scenarios would be no independent draws.
    roots = np.random.SeedSequence(seed, spawn_key=(zlib.crc32(name.encode()), number)).spawn(3)
    values = scenario.truth(np.random.default_rng(roots[0]))
    problem = scenario.simulated(values, np.random.default_rng(roots[1]))
    truth = dict(zip(scenario.problem.free_names, values.tolist(), strict=True))
    try:
        return [_fitted(scenario, problem, truth, roots[2])]
    except FitError as error:
        return [_told("", failed=str(error))]


def _told(answer: str, p: float = 0.0, said: Row | None = None, converged: bool = True, failed: str = "") -> Row:
    return {"answer": answer, "p": p, "said": said or {}, "converged": converged, "failed": failed}


def _described(scenario: Scenario, seed: int, number: int) -> Row:
    """The answer alone, as a point fit gives it; the same tables for each model."""
    fault, name = FAULTS[str(scenario.fault)], f"{scenario.fault} {scenario.size:g}"
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(zlib.crc32(name.encode()), number)))
    try:
        problem = foreign_problem(str(scenario.fault), scenario.size, scenario.model, rng)
    except FitballError:
        return _told(REFUSED)
    try:
        _squares, point = point_fit(problem, rng)
        looked = look(problem, point, None, rng) if fault.looked else None
        described = adequacy(problem, point, None, seed, looked)
    except FitError as error:
        return _told("", failed=str(error))
    return _told(str(described.answer), _least(described))


def _least(described: Adequacy) -> float:
    checks = (*(check.p for check in described.checks), *(check.adjusted for check in described.noise))
    return min(checks, default=1.0)


def _fitted(scenario: Scenario, problem: Problem, truth: Mapping[str, float], root: np.random.SeedSequence) -> Row:
    """The road of `calibrate` with a shorter chain, up to verdicts."""
    rng = np.random.default_rng(root)
    seed = int(root.generate_state(1)[0])
    squares, point = point_fit(problem, rng)
    sampled = short_chain(problem, point, seed)
    values, scores = drawn_values(problem, sampled), sampled.log_posterior[:, sampled.warm_up :]
    posterior = Posterior(problem.free_names, values, scores, prior_draws(problem, rng))
    squares, point, _said = search_again(problem, squares, point, sampled)
    profiled = profile_all(problem, point, [*point.optima, *squares.optima])
    described = adequacy(problem, point, posterior, seed)
    regimes = regime_shares(problem.rebound(thinned(posterior, 400)))
    correlation = np.atleast_2d(np.corrcoef(posterior.draws, rowvar=False))
    _evidence, judged = examine(problem, point, profiled, posterior, correlation, regimes)
    verdicts = {name: qualified(name, judged[name], described, None)[0] for name in problem.free_names}
    pins = pinned(problem, truth) if scenario.by_model else {}
    ends = np.quantile(posterior.draws, LEVELS, axis=0).T.tolist()
    said = {
        name: {"verdict": str(verdicts[name]), "low": low, "high": high, "pinned": pins.get(name),
               "truth": truth[name] if scenario.knows(name) else None}
        for name, (low, high) in zip(posterior.names, ends, strict=True)
    }  # fmt: skip
    return _told(str(described.answer), _least(described), said, sampled.converged)


@dataclass(frozen=True)
class Finding:
    """One scenario, or several together. It counts tables by answer, tables with any objection and with the worst,
    intervals of identified parameters that contain the truth, and pinned parameters that are called prior-dominated.
    For each verdict it counts parameters, intervals that contain the truth, and parameters that the likelihood pins.

    `maker` is `yes` for tables from the model, `no`, or `other code`. `wanted` says whether other tables should be
    objected to, None if this is open.
    """

    name: str
    words: str
    maker: str
    tables: int
    unconverged: int
    failed: int
    answers: Mapping[Answer, int]
    objected: Rate
    refused: Rate
    relied: Rate
    blind: Rate
    confusions: Mapping[Said, tuple[Rate, Rate, Rate]]
    wanted: bool | None = None

    @property
    def unread(self) -> int:
        """Tables that are refused."""
        return self.tables - self.failed - sum(self.answers.values())

    @property
    def complaints(self) -> tuple[str, ...]:
        """Failures of the program, in words. Of tables that are not from the model, only good ones, and those with a
        fault that must be found, count.
        """
        if self.wanted and not self.objected.agrees(1.0 - MISSED, 1.0):
            return (f"{self.name}: only {self.objected} of the tables are objected to",)
        if self.wanted is False and not self.objected.agrees(0.0, FALSE_EXCEPT):
            return (f"{self.name}: {self.objected} of good tables are objected to",)
        if self.maker != "yes":
            return ()
        asked = (
            (self.objected, (0.0, FALSE_EXCEPT), "of tables that the model made are objected to"),
            (self.refused, (0.0, FALSE_FAILS), "of tables that the model made are called not described"),
            (self.relied, HOLD, "of the 95 % intervals of identified parameters hold"),
            (self.blind, (0.0, MOST_BLIND), "of pinned parameters are called prior-dominated"),
        )
        return tuple(f"{self.name}: {found} {what}" for found, limits, what in asked if not found.agrees(*limits))

    def row(self) -> dict[str, object]:
        """As a row of the table of rates."""
        row: dict[str, object] = {
            "scenario": self.name, "made_by_the_model": self.maker, "tables": self.tables,
            "not_converged": self.unconverged, "without_fit": self.failed,
        }  # fmt: skip
        row |= {str(answer).replace(" ", "_"): count for answer, count in self.answers.items()}
        for what, found in (
            ("objected", self.objected), ("not_described", self.refused), ("identified_holds", self.relied),
            ("pinned_called_prior_dominated", self.blind),
        ):  # fmt: skip
            ends = [round(end, 4) if found.total else "" for end in (found.value or 0.0, found.low, found.high)]
            heads = (what, f"{what}_of", f"{what}_low", f"{what}_high")
            row |= zip(heads, (ends[0], found.total, *ends[1:]), strict=True)
        return row | {"refused": self.unread, "words": self.words}


def finding(name: str, words: str, maker: str, records: Sequence[Row], wanted: bool | None = None) -> Finding:
    """What the tables of one scenario, or of several together, add up to."""
    fitted = [row for row in records if not row["failed"]]
    said = [one for row in fitted for one in row["said"].values()]
    answers = {answer: sum(row["answer"] == answer for row in fitted) for answer in Answer}
    bad = (Answer.EXCEPT, Answer.FAILS, REFUSED)
    verdicts = {verdict: [one for one in said if one["verdict"] == verdict] for verdict in Said}
    return Finding(
        name=name,
        words=words,
        maker=maker,
        tables=len(records),
        unconverged=sum(not row["converged"] for row in fitted),
        failed=len(records) - len(fitted),
        answers=answers,
        objected=rate(row["answer"] in bad for row in fitted),
        refused=Rate(answers[Answer.FAILS], len(fitted)),
        relied=rate(holds(one) for one in said if one["verdict"] in RELIED_ON),
        blind=rate(one["verdict"] == Said.PRIOR_DOMINATED for one in said if one["pinned"]),
        confusions={
            verdict: (Rate(len(mine), len(said)), rate(map(holds, mine)), rate(one["pinned"] for one in mine))
            for verdict, mine in verdicts.items()
            if mine
        },
        wanted=wanted,
    )


def holds(parameter: Row) -> bool | None:
    """Whether the interval of a parameter contains the truth; None without a truth."""
    known = parameter["truth"] is not None
    return bool(parameter["low"] <= parameter["truth"] <= parameter["high"]) if known else None


def wanted(scenario: Scenario) -> bool | None:
    """Whether such tables are to be objected to; smaller faults than the usual ones show how small they may be."""
    if scenario.fault is None:
        return None
    return False if scenario.fault == "clean" else True if scenario.size >= 1.0 else None


def findings(records: Mapping[str, Sequence[Row]]) -> list[Finding]:
    """Findings of each scenario, and of all together that the model made or did not make."""
    known = {name: SCENARIOS[name] for name in records}
    makers = {
        name: "other code" if one.fault is not None else "yes" if one.by_model else "no"
        for name, one in known.items()
    }
    each = [
        finding(name, known[name].words, makers[name], some, wanted(known[name])) for name, some in records.items()
    ]
    for maker, name in (("yes", "all made by the model"), ("no", "all not made by it")):
        some = [row for key, many in records.items() if makers[key] == maker for row in many]
        if some:
            each.append(finding(name, name, maker, some))
    return each


def judge(records: Mapping[str, Sequence[Row]], seed: int) -> Verdict:
    """Is what fits say of themselves true?"""
    found = findings(records)
    content = {
        "holds": not any(one.complaints for one in found),
        "seed": seed,
        "stated": {"objected": FALSE_EXCEPT, "not described": FALSE_FAILS, "hold": HOLD, "blind": MOST_BLIND},
        "scenarios": {one.name: one.row() | {"complaints": list(one.complaints)} for one in found},
    }
    return Verdict(content, {"rates": [one.row() for one in found], "confusions": _confusions(found)}, text(found))


def _confusions(found: Iterable[Finding]) -> list[dict[str, object]]:
    """A row a scenario and verdict."""
    return [
        {"scenario": one.name, "verdict": str(verdict), "parameters": said.count, "of": said.total,
         "holds": held.count, "holds_of": held.total, "pinned": pins.count, "pinned_of": pins.total}
        for one in found for verdict, (said, held, pins) in one.confusions.items()
    ]  # fmt: skip


def text(found: Sequence[Finding]) -> str:
    """Both tables as Markdown."""
    lines = [
        "# Are the verdicts right?", "",
        "Written by `scripts/validate --trust`: fits of simulated tables with a known truth. In brackets are 95 % "
        "intervals of the rates (Clopper and Pearson).", "",
        "## Does the model describe the table?", "",
        "An objection is `describes except` or `does not describe`. Of tables from the model "
        f"{100 * FALSE_EXCEPT:.0f} % may get one, {100 * FALSE_FAILS:.0f} % the second.", "",
        "| scenario | tables | describes | except | does not | cannot test | not read | objected |",
        "|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for one in found:
        order = (Answer.DESCRIBES, Answer.EXCEPT, Answer.FAILS, Answer.UNDECIDED)
        counts = " | ".join(str(one.answers[answer]) for answer in order)
        lines.append(f"| {_title(one)} | {one.tables} | {counts} | {one.unread} | {one.objected} |")
    lines += [
        "", "## Are the verdicts of parameters right?", "",
        f"Required for tables from the model: {100 * HOLD[0]:.0f} to {100 * HOLD[1]:.0f} % of the 95 % intervals "
        f"of identified parameters contain the truth, and under {100 * MOST_BLIND:.0f} % of the parameters that the "
        "likelihood pins are called prior-dominated.", "",
        "| scenario | identified | contain the truth | pinned, called prior-dominated |", "|---|---|---|---|",
        *(f"| {_title(one)} | {one.relied.total} | {one.relied} | {one.blind} |" for one in found if one.confusions),
        "", "| tables | verdict | parameters | 95 % interval contains the truth | pinned |", "|---|---|---|---|---|",
    ]  # fmt: skip
    for one in (one for one in found if one.name not in SCENARIOS):
        lines += [
            f"| {one.name} | {verdict} | {said.count} | {held} | {pins} |"
            for verdict, (said, held, pins) in one.confusions.items()
        ]
    faults = [fault for one in found for fault in one.complaints]
    lines += ["", *(f"- FAILS: {fault}" for fault in faults)] if faults else ["", "No failure."]
    return "\n".join(lines) + "\n"


def _title(one: Finding) -> str:
    if one.name not in SCENARIOS:
        return f"**{one.name}**"
    made = {"yes": "", "no": "not made by it, ", "other code": "made by other code, "}[one.maker]
    return f"{made}{one.name}: {one.words}"
