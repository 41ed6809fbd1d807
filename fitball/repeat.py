"""A fit beside its repetition: bit-equal, equal within a tolerance, or different and where.

Numbers of a posterior may differ by their Monte Carlo standard errors, a maximum by the tolerance of its search,
rebounds by rounding; verdicts and the status must be equal.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import shorten
from typing import Any

import numpy as np
from scipy.special import ndtri

from fitball.api.calibrating import begin
from fitball.api.reading import Report
from fitball.errors import ResultFolderError
from fitball.files import all_or_none
from fitball.inference.problem.problem import Problem
from fitball.inference.results.quantiles import QUANTILES
from fitball.inference.results.results import Fit, Posterior, RunStatus
from fitball.inference.results.source import data_columns
from fitball.inference.sampling.chain_file import EnsembleChain, read_chains
from fitball.inference.sampling.convergence import standard_errors, summaries
from fitball.report.batch.rows import ROW_NAME
from fitball.report.fit.folder import CHAIN_NAME, older_result, write_all
from fitball.report.form.document import columns
from fitball.report.form.files import write_text
from fitball.report.form.folders import held
from fitball.report.form.numbers import significant
from fitball.report.saved.fit_file import fit_text, read_fit, read_posterior
from fitball.report.saved.netcdf_files import DATA_NAME, POSTERIOR_NAME, read_columns, write_data, write_netcdf
from fitball.report.saved.run_file import find_covariances, find_records, find_tables, read_run, record_problem
from fitball.report.saved.structure import FIT_NAME, OlderFileError

# A run as it lies in its folder, or as it was just made again: what a repetition compares.


@dataclass(frozen=True)
class Kept:
    """The content of a result folder: `fit.json`, the draws in `posterior.nc` (None for a point fit, and for a table
    of a batch that kept none), and the chains with their warm-up (None where there is no `posterior.h5`: a fit saved
    from Python has none).
    """

    folder: Path
    saved: Fit
    posterior: Posterior | None
    chains: tuple[EnsembleChain, ...] | None

    @property
    def drawless(self) -> bool:
        """Whether it was sampled, and its draws were not kept."""
        return self.posterior is None and self.saved.status is not RunStatus.POINT_ONLY

    @cached_property
    def content(self) -> Mapping[str, Any]:
        """`fit.json`."""
        content: Mapping[str, Any] = json.loads(fit_text(self.saved))
        return content


def read_kept(folder: Path) -> Kept:
    """Read a result folder. Raises ResultFolderError for what is missing, damaged or foreign."""
    saved = read_fit(folder)
    chain, left_out = folder / CHAIN_NAME, (folder / ROW_NAME).exists() and not (folder / POSTERIOR_NAME).exists()
    posterior = None if left_out else read_posterior(saved, folder / FIT_NAME, agreeing=False)
    chains = tuple(read_chains(chain)[2]) if chain.exists() and posterior is not None else None
    return Kept(folder, saved, posterior, chains)


def check_rows(problem: Problem, original: Kept) -> None:
    """Raise ResultFolderError unless the rows of the files are those the fit was made from, to the last digit."""
    place = original.folder / DATA_NAME
    kept, now = read_columns(original.saved.source, place), data_columns(problem.table, problem.force)
    # Names of tables, and so ids and labels, may differ: a file may lie elsewhere under another name.
    numbers = [name for name, column in now.items() if column.dtype.kind in "fi"]
    changed = [
        name for name in numbers if name not in kept or not np.array_equal(now[name], kept[name], equal_nan=True)
    ]
    if changed:
        raise ResultFolderError(
            f"{place}: its {' and '.join(changed)} are not those of {problem.table.source}. The table was changed in "
            "Python before the fit, or this file was changed since. Calibrate anew"
        )


@all_or_none()
def write_numbers(fit: Fit, folder: Path) -> None:
    """Write what a repetition compares, and no figures. Raises ResultFolderError."""
    if fit.posterior is not None:
        write_netcdf(fit, fit.posterior, folder / POSTERIOR_NAME)
    write_data(fit.problem, folder / DATA_NAME)
    write_text(folder / FIT_NAME, fit_text(fit))


# Whether the files of one result agree with each other: a number changed by hand shows even where a repetition has
# other draws.

# Shares by which rounding may differ: of a summary of many draws, and of one draw (an exponential).
SUMMARY, DRAW = 1e-9, 1e-12


def _summaries(kept: Kept) -> Iterator[Finding]:
    """Numbers of `fit.json` that are not those of its own draws."""
    if kept.posterior is None:
        return
    basis = "computed from its draws in posterior.nc"
    for k, name in enumerate(kept.posterior.names):
        item = kept.content["parameters"].get(name)
        if item is None:
            continue
        recomputed = summaries(kept.posterior.values[..., k])
        for number, value in recomputed.items():
            if item[number] is None or not abs(item[number] - value) <= SUMMARY * (abs(value) + recomputed["sd"]):
                yield Finding(f"{name} {number}", item[number], value, basis, True)


def _draws(kept: Kept) -> Iterator[Finding]:
    """Draws of `posterior.nc` that are not those of `posterior.h5`: the first of each parameter."""
    if kept.posterior is None or kept.chains is None:
        return
    warm_up, steps = (kept.content["diagnostics"][name] for name in ("warm_up", "steps"))
    parts = [ensemble.chain[warm_up:steps] for ensemble in kept.chains]
    ensembles, *shape = kept.posterior.values.shape
    if [list(part.shape) for part in parts] != [shape] * ensembles:
        size = sum(part.size for part in parts)
        yield Finding("number of draws", float(kept.posterior.values.size), float(size), "posterior.h5", True)
        return
    chains = np.stack(parts)
    for k, name in enumerate(kept.posterior.names):
        log = kept.saved.parameters[name].prior.lower().startswith("log")
        chain = np.exp(chains[..., k]) if log else chains[..., k]
        values = kept.posterior.values[..., k]
        apart = np.argwhere(~(np.abs(values - chain) <= DRAW * np.abs(chain)))
        if apart.size:
            at = tuple(int(i) for i in apart[0])
            what = f"{name} draw (ensemble {at[0]}, step {at[1] + warm_up}, walker {at[2]})"
            basis = f"posterior.h5, {len(apart)} draws in all"
            yield Finding(what, float(values[at]), float(chain[at]), basis, True)


# Whether two results are the same bytes, and where they are not.

# What says where and with what a fit was made, not what it found.
IGNORED = ("versions", "source.name", "source.file", "source.force.file")


def differing_leaves(one: Any, other: Any, at: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Every number or text of two JSON trees that is not the same to the last digit: its dotted place, and both."""
    if at in IGNORED:
        return
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in dict.fromkeys([*one, *other]):
            place = f"{at}.{key}" if at else key
            yield from differing_leaves(one.get(key), other.get(key), place)
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for k, (a, b) in enumerate(zip(one, other, strict=True)):
            yield from differing_leaves(a, b, f"{at}[{k}]")
    # As text, so that minus zero is not zero and true is not one.
    elif json.dumps(one) != json.dumps(other):
        yield at, one, other


def same_bytes(original: Kept, repeated: Kept) -> dict[str, bool]:
    """Which parts of two results are equal bit for bit; parts that only one of them has are left out."""
    equal = {"fit.json": next(differing_leaves(original.content, repeated.content), None) is None}
    one, other = original.posterior, repeated.posterior
    if one is not None and other is not None:
        parts = [(getattr(one, part), getattr(other, part)) for part in ("values", "log_posterior", "prior_draws")]
        same = all(a.shape == b.shape and a.tobytes() == b.tobytes() for a, b in parts)
        equal["draws"] = one.names == other.names and same
    elif not original.drawless and (one is not None or other is not None):
        equal["draws"] = False
    if original.chains is not None and repeated.chains is not None:
        equal["chain"] = _same_chains(original, repeated)
    return equal


def _same_chains(original: Kept, repeated: Kept) -> bool:
    """Whether the steps that both results used are equal; a resumed run may have made some more."""
    one, other = original.chains or (), repeated.chains or ()
    steps = min(int(kept.content["diagnostics"]["steps"]) for kept in (original, repeated))
    return len(one) == len(other) and all(
        np.array_equal(a.chain[:steps], b.chain[:steps])
        and np.array_equal(a.log_posterior[:steps], b.log_posterior[:steps])
        for a, b in zip(one, other, strict=True)
    )


# Chance that any one of all numbers of a true repetition lies farther off than its limit.
FALSE_ALARM = 1e-3
# A search for the maximum ends when its simplex spans 1e-5 of log density, steps of large tables when they promise
# 1e-8 of chi-square; so far above that no second search should end.
LOG_POSTERIOR = 1e-3
LOG_POSTERIOR_EACH = 1e-7
# Such a point lies within sqrt(2e-3) sd of the maximum, and no posterior is wider than its prior.
OF_WIDTH = 0.05
# Share of a derived number that other rounding may change where draws and point are the same bytes.
ROUNDING = 1e-9


class Outcome(StrEnum):
    """The outcome of a repetition."""

    BIT_EQUAL = "bit-equal"
    WITHIN = "equal within tolerance"
    DIFFERENT = "different"


@dataclass(frozen=True)
class Finding:
    """One thing compared. `allowed` is the largest difference that counts as equal (None: equality alone does),
    `standard_error` that of the difference of two Monte Carlo numbers, `basis` the reason for that tolerance.
    """

    what: str
    original: float | str
    repeated: float | str
    basis: str
    differs: bool
    allowed: float | None = None
    standard_error: float | None = None

    @property
    def difference(self) -> float | None:
        """Repeated less original, None for words."""
        if isinstance(self.original, str) or isinstance(self.repeated, str):
            return None
        return self.repeated - self.original

    @property
    def ratio(self) -> float | None:
        """Difference over its standard error; None where there is none."""
        difference = self.difference
        if difference is None or not self.standard_error:
            return None
        return abs(difference) / self.standard_error


@dataclass(frozen=True)
class Repetition:
    """The outcome; `same`: for each part whether it is the same bytes. `limit` is the largest ratio of a
    difference to its standard error that counts as equal; `findings` are empty where all is the same bytes.
    """

    outcome: Outcome
    same: Mapping[str, bool]
    findings: tuple[Finding, ...]
    limit: float
    notes: tuple[str, ...]

    @property
    def different(self) -> tuple[Finding, ...]:
        """What differs by more than its tolerance."""
        return tuple(finding for finding in self.findings if finding.differs)

    @property
    def largest(self) -> Finding | None:
        """The largest difference in standard errors, None without a posterior."""
        known = [finding for finding in self.findings if finding.ratio is not None]
        return max(known, key=lambda item: item.ratio or 0.0, default=None)


def compared(problem: Problem, original: Kept, repeated: Kept) -> Repetition:
    """Compare a result with its repetition; `problem` is that of the repetition."""
    same = same_bytes(original, repeated)
    limit = ratio_limit(problem.dimension)
    notes = tuple(_notes(original, repeated))
    if all(same.values()):
        return Repetition(Outcome.BIT_EQUAL, same, (), limit, notes)
    findings = [
        *_words(original, repeated),
        *_monte_carlo(original, repeated, limit),
        *_point(problem, original, repeated),
        *_golden(original),
        *_summaries(original),
        *_draws(original),
    ]
    findings += _derived(original, repeated, same, {finding.what for finding in findings if finding.differs})
    outcome = Outcome.DIFFERENT if any(finding.differs for finding in findings) else Outcome.WITHIN
    return Repetition(outcome, same, tuple(findings), limit, notes)


def ratio_limit(dimension: int) -> float:
    """Standard errors that the largest of all numbers of `dimension` parameters may differ by (Bonferroni)."""
    count = max(dimension, 1) * (len(QUANTILES) + 1)
    return float(-ndtri(0.5 * FALSE_ALARM / count))


def _notes(original: Kept, repeated: Kept) -> Iterator[str]:
    old, new = original.content, repeated.content
    others = [
        f"{name} {old['versions'].get(name, '-')}, now {version}"
        for name, version in new["versions"].items()
        if old["versions"].get(name) != version
    ]
    if others:
        yield "other versions, so bits may differ: " + "; ".join(others)
    if old["seed"] != new["seed"]:
        yield f"run.toml has seed {new['seed']}, but the fit used seed {old['seed']}"
    for name, item in new["parameters"].items():
        before = old["parameters"].get(name)
        if before is not None and before["prior"] != item["prior"]:
            yield f"run.toml has the prior {item['prior']} for {name}, but the fit used {before['prior']}"
    if old["status"] == "not converged":
        yield "the sampler of this fit did not converge, so the standard errors are uncertain themselves"


def _words(original: Kept, repeated: Kept) -> Iterator[Finding]:
    old, new = original.content, repeated.content
    told = [("status", old["status"], new["status"]), ("free parameters", _free(original), _free(repeated))]
    told += [
        (f"{name} verdict", item["verdict"], new["parameters"][name]["verdict"])
        for name, item in old["parameters"].items()
        if name in new["parameters"]
    ]
    for what, before, now in told:
        yield Finding(what, before, now, "exactly equal", before != now)


def _free(kept: Kept) -> str:
    return ", ".join(name for name, item in kept.content["parameters"].items() if item["verdict"] != "fixed")


def _monte_carlo(original: Kept, repeated: Kept, limit: float) -> Iterator[Finding]:
    one, other = original.posterior, repeated.posterior
    if other is None or (one is None and not original.drawless):
        return
    for name in other.names:
        if name not in (original.saved.free_names if one is None else one.names):
            continue
        its = standard_errors(other.values[..., other.names.index(name)])
        # Draws that were not kept had about the errors of those made again.
        mine = its if one is None else standard_errors(one.values[..., one.names.index(name)])
        for number, error in mine.items():
            old = original.content["parameters"][name][number]
            new = repeated.content["parameters"][name][number]
            joint = math.hypot(error, its[number])
            yield _number(f"{name} {number}", old, new, limit * joint, "Monte Carlo error", joint)


def _number(what: str, old: float, new: float, allowed: float, basis: str, error: float | None = None) -> Finding:
    gap = abs(new - old)
    # An allowance that is not a number allows nothing.
    return Finding(what, old, new, basis, gap > 0.0 and not gap <= allowed, allowed, error)


def _point(problem: Problem, original: Kept, repeated: Kept) -> Iterator[Finding]:
    old, new = original.content, repeated.content
    measured = sum(observable.observed.size for observable in problem.observables)
    allowed = LOG_POSTERIOR + LOG_POSTERIOR_EACH * measured
    basis = "tolerance of the search for the maximum"
    scores = [float(item["log_posterior"]) for item in (old, new)]
    yield _number("log posterior at the point estimate", scores[0], scores[1], allowed, basis)
    for parameter in problem.parameters:
        if parameter.name not in old["parameters"]:
            continue
        before, now = (float(item["parameters"][parameter.name]["point"]) for item in (old, new))
        # One width of the prior along its coordinate, as a difference in value there.
        scale = abs(before) if parameter.prior.log else 1.0
        width = OF_WIDTH * parameter.prior.width * scale if parameter.free else 0.0
        yield _number(f"{parameter.name} point", before, now, width, basis)


def _golden(original: Kept) -> Iterator[Finding]:
    """The kept golden impacts, bounced anew with the kept parameters: is it still the same model?"""
    fitted, golden = original.saved.fitted, original.saved.golden
    names = fitted.model.parameter_names
    row = np.array([[golden.parameters[name] for name in names]])
    rebound = fitted.model.evaluate(names, row, golden.impacts)
    for name in ("v_x2", "v_y2", "omega_2", "contact_time"):
        old, new = getattr(golden.rebound, name), getattr(rebound, name)[0]
        known = ~np.isnan(old)
        if not known.any():
            continue
        allowed = ROUNDING * float(np.max(np.abs(old[known])))
        worst = int(np.argmax(np.where(known, np.abs(new - old), -1.0)))
        what = f"golden impact {worst + 1} {name}"
        yield _number(what, float(old[worst]), float(new[worst]), allowed, "rounding of the model")


def _derived(original: Kept, repeated: Kept, same: Mapping[str, bool], told: set[str]) -> Iterator[Finding]:
    """Numbers of `fit.json` that differ although the draws (or the point) they follow from do not."""
    old, new = original.content, repeated.content
    if old["versions"] != new["versions"]:
        return
    if original.posterior is None:
        source = old["fitted"]["point"] == new["fitted"]["point"] or old["golden"] == new["golden"]
    else:
        source = same.get("chain", same.get("draws", False))
    if not source:
        return
    for place, one, other in differing_leaves(old, new):
        inside = place.removeprefix("parameters.")
        what = place if inside == place else inside.replace(".", " ")
        numbers = isinstance(one, int | float) and isinstance(other, int | float)
        if what not in told and not (numbers and abs(one - other) <= ROUNDING * abs(one)):
            before, now = (one, other) if numbers else (str(one), str(other))
            yield Finding(what, before, now, "draws or point are the same bytes", True)


# What a repetition found, as a person reads it and as JSON.

# Rows of the table that are printed; JSON holds all.
SHOWN = 20
# Characters of a text that are printed; JSON holds all.
WIDEST = 40


def render(repetition: Repetition, original: Kept) -> str:
    """The outcome, its basis, and the numbers."""
    lines = [f"{original.folder} repeated: {repetition.outcome}", ""]
    if repetition.outcome is Outcome.BIT_EQUAL:
        return "\n".join([*lines, f"  {_bytes(original)}: the same bytes."])
    same = [name for name, equal in repetition.same.items() if equal]
    if same:
        lines += [f"  The same bytes: {', '.join(same)}.", ""]
    usual = [finding for finding in repetition.findings if finding.what.endswith((" median", " point"))]
    lines += _table(repetition.different or usual, repetition.limit)
    largest = repetition.largest
    if largest is not None:
        lines += ["", f"  Largest difference: {largest.what}, {largest.ratio or 0.0:.2g} standard errors."]
        lines.append(
            f"  Differences up to {repetition.limit:.2g} count as equal: one true repetition in a thousand "
            "exceeds that."
        )
    return "\n".join(lines)


def _bytes(original: Kept) -> str:
    if original.posterior is None:
        return f"all numbers of fit.json ({'its draws were not kept' if original.drawless else 'a point fit'})"
    ensembles, steps, walkers, free = original.posterior.values.shape
    return (
        f"all numbers of fit.json and the draws ({ensembles} ensembles, {steps} steps, {walkers} walkers, "
        f"{free} parameters)"
    )


def _table(findings: Sequence[Finding], limit: float) -> list[str]:
    rows = [["", "original", "repeated", "difference", "allowed", "standard errors"]]
    rows += [_row(item) for item in findings[:SHOWN]]
    lines = [f"  {line}" for line in columns(rows)]
    reasons = dict.fromkeys(finding.basis for finding in findings)
    named = {"Monte Carlo error": f"Monte Carlo error ({limit:.2g} standard errors)"}
    lines += ["", "  Compared by: " + "; ".join(named.get(item, item) for item in reasons) + "."]
    if len(findings) > SHOWN:
        lines.append(f"  and {len(findings) - SHOWN} more: see --json")
    return lines


def _row(finding: Finding) -> list[str]:
    gap = finding.difference
    return [
        finding.what,
        _shown(finding.original),
        _shown(finding.repeated),
        "-" if gap is None else significant(gap),
        "-" if finding.allowed is None or math.isnan(finding.allowed) else significant(finding.allowed),
        "-" if finding.ratio is None else f"{finding.ratio:.2g}",
    ]


def _shown(value: float | str) -> str:
    return shorten(value, WIDEST, placeholder=" ...") if isinstance(value, str) else f"{value:.7g}"


def repetition_json(repetition: Repetition, original: Mapping[str, Any]) -> dict[str, Any]:
    """All of it; SI units."""
    largest = repetition.largest
    return {
        "kind": "fitball repetition",
        "outcome": str(repetition.outcome),
        "model": original["fitted"]["model_name"],
        "table": original["source"]["name"],
        "same_bytes": dict(repetition.same),
        "limit": repetition.limit,
        "false_alarm": FALSE_ALARM,
        "largest": None if largest is None else _entry(largest),
        "different": [_entry(finding) for finding in repetition.different],
        "compared": [_entry(finding) for finding in repetition.findings],
        "notes": list(repetition.notes),
    }


def _entry(finding: Finding) -> dict[str, Any]:
    def number(value: float | None) -> float | None:
        return None if value is None or not math.isfinite(value) else value

    return {
        "what": finding.what,
        "original": finding.original,
        "repeated": finding.repeated,
        "difference": finding.difference,
        "allowed": number(finding.allowed),
        "standard_error": number(finding.standard_error),
        "ratio": number(finding.ratio),
        "basis": finding.basis,
        "differs": finding.differs,
    }


@dataclass(frozen=True)
class Repeated:
    """A fit made again: what was found beside the `original`, and the folder `out` that the new one is kept in."""

    repetition: Repetition
    original: Kept
    out: Path | None

    @property
    def exit_code(self) -> int:
        """0 where the results do not contradict each other, else 1."""
        return 1 if self.repetition.outcome is Outcome.DIFFERENT else 0

    def report(self) -> str:
        """All of it as text."""
        kept = [] if self.out is None else [str(self.out)]
        return "\n".join([render(self.repetition, self.original), *kept])

    def json(self) -> dict[str, Any]:
        """All of it for machines, in SI."""
        return repetition_json(self.repetition, self.original.content)


def repeat(
    fit: Path,
    tables: Sequence[str],
    force: str | None,
    covariances: Sequence[str],
    out: Path | None,
    cores: int,
    report: Report,
) -> Repeated | None:
    """Make the fit of a folder or of a `run.toml` again and compare; None for one of an older fitball, which is only
    made again. `tables`, `force` and `covariances` are the present places of its files; the new result is kept in
    the folder `out`.

    Raises ResultFolderError, and as `calibrate` does; KeyboardInterrupt with nothing compared.
    """
    record = read_run(fit)
    try:
        original = read_kept(record.folder)
    except OlderFileError:
        # It cannot be compared with, and is the reason for many to make it again.
        if out is None:
            raise
        original = None
    places = find_tables(record, tables)
    problem = record_problem(record, places, find_records(record, force), find_covariances(record, covariances))
    if original is not None:
        check_rows(problem, original)
    if out is not None and (older := older_result(out)):
        raise ResultFolderError(
            f"{out}: holds {' and '.join(older)} of an older run, which is never overwritten here: name another "
            "folder "
            "with --out"
        )
    place = nullcontext(out) if out is not None else TemporaryDirectory(prefix="fitball-repeat-")
    with place as name, held(Path(name)):
        made = begin(problem, replace(record.effort, cores=cores), Path(name)).fit(report)
        report("comparison", None)
        (write_numbers if out is None else write_all)(made, Path(name))
        return (
            None if original is None else Repeated(compared(problem, original, read_kept(Path(name))), original, out)
        )
