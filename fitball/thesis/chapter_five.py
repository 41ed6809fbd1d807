"""Chapter V and Appendices C and D of Jafri (2004), regenerated and judged: everything `fitball rederive` finds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from uncertainties.core import Variable

from fitball.data.published import thesis_table
from fitball.inference.effort import Effort
from fitball.inference.thesis.published_cases import INCH, INERTIA_OF
from fitball.report.form.numbers import listed
from fitball.thesis import (
    appendices,
    judgement,
    printed_tables,
    recalibration,
    slips,
)
from fitball.thesis.appendices import CASE_IN_APPENDIX_C
from fitball.thesis.printed_tables import Check, chapter_five_predictions
from fitball.thesis.slips import slip_table, slip_words

# Results of the recomputation when a person last checked them; `Check.holds` compares against it.
ROWS_WITHIN = {0.1: 110, 0.5: 118, 1.0: 127}
APPENDIX_D_MATCHES = {"v_x2": 55, "theta_2": 52, "omega_2": 57}
# Relative deviation that rounding of printed energies and speeds makes.
ENERGY_ROUNDING = 1e-4
# Relative deviation of a moment of inertia printed to three digits.
INERTIA_ROUNDING = 2e-3


@dataclass(frozen=True)
class ChapterFive:
    """Tables by the stem of the file that holds one, fits and judgements; `checks` decide the exit code, `verdicts`
    are for reading.
    """

    appendix_c: appendices.AppendixC
    tables: Mapping[str, pd.DataFrame]
    inertia: printed_tables.Inertia
    rankings: Mapping[str, judgement.Ranking]
    fits: Mapping[str, recalibration.Recalibration]
    checks: tuple[Check, ...]
    verdicts: Mapping[str, str]

    @property
    def holds(self) -> bool:
        """Whether every count and number is still the pinned one; many rows are off all the same."""
        return all(check.holds for check in self.checks)

    @property
    def summary(self) -> str:
        """What `holds` means, in one paragraph."""
        changed = [check.name for check in self.checks if not check.holds]
        error = appendices.worst_error(self.appendix_c.rows)
        unexplained = int(np.sum(self.appendix_c.exceptions["kind"] == "unexplained"))
        now = f"changed: {listed(changed)}" if changed else "unchanged since a person last checked them"
        return (
            f"{len(self.checks)} comparisons with the printed numbers: {now}. Unchanged means that the code gives "
            f"the same results, not that these agree with print. Of the {len(error)} rows of Appendix C "
            f"{int(np.sum(error > appendices.REPRODUCED))} differ by more than {appendices.REPRODUCED:g} % and "
            f"{int(np.sum(error > 1.0))} by more than 1 %. {unexplained} cells are unexplained."
        )


def derive(effort: Effort, report: Callable[[str], None]) -> ChapterFive:
    """Recompute everything; fits and resampling draw from generators seeded with the effort's seed."""
    seed = effort.seed
    report("Appendix C")
    rows_c, slip_cells = appendices.reproduce(), slips.recomputed()
    strict = appendices.recompute(thesis_table("appendix_c"))
    report("Appendix D and Tables 2 to 8")
    rows_d, inertia = appendices.recompute_errors(), printed_tables.bifilar_inertia()
    energies, friction = printed_tables.energies(), printed_tables.mean_friction()
    damping, examples = printed_tables.formula_table(), printed_tables.examples()
    report("Table 9")
    rankings = judgement.rank_all(rows_c, seed)
    own = {f"case {case}": judgement.errors(found) for case, found in chapter_five_predictions().items()}
    by_chapter, sizes = judgement.rank(own, seed), slip_table(rankings)
    fits = {name: recalibration.recalibrate(name, effort, report) for name in recalibration.MODELS}
    checks = (
        _check_appendix_c(rows_c, strict),
        slips.check(slip_cells),
        _check_appendix_d(rows_d),
        _check_energies(energies),
        _check_friction(friction),
        _check_inertia(inertia.moment),
        _check_damping(damping),
        _check_examples(examples),
    )
    tables = {
        "appendix_c": rows_c.rows,
        "appendix_c_shares": appendices.shares(rows_c.rows),
        "appendix_c_shares_as_printed": appendices.shares(strict),
        "appendix_c_shares_by_case": appendices.shares_by_case(rows_c.rows),
        "appendix_c_exceptions": rows_c.exceptions,
        "slips": slip_cells,
        "appendix_d": rows_d,
        "appendix_d_exceptions": appendices.deviations(rows_d),
        "energies": energies,
        "mean_friction": friction,
        "damping": damping,
        "examples": examples,
        "figures_36_to_44": printed_tables.figures_36_to_44(),
        "rankings": judgement.side_by_side(rankings),
        "computation_slips": sizes,
        "fits": recalibration.fit_table(fits),
        "parameters": recalibration.parameter_table(fits),
        "offsets": recalibration.offset_table(fits),
        "errata": thesis_table("errata"),
    }
    for name, one in {**rankings, "chapter_v": by_chapter}.items():
        tables |= {f"ranking_{name}": one.scores, f"ranking_{name}_certainty": one.certainty}
    tables |= {f"credible_levels_{name}": item.points for name, item in fits.items()}
    verdicts = _verdicts(rankings, by_chapter, fits, sizes)
    return ChapterFive(rows_c, tables, inertia, rankings, fits, checks, verdicts)


def _check_appendix_c(appendix: appendices.AppendixC, strict: pd.DataFrame) -> Check:
    error, before = appendices.worst_error(appendix.rows), appendices.worst_error(strict)
    within = {limit: int(np.sum(error <= limit)) for limit in ROWS_WITHIN}
    beyond = int(np.sum(error > 1.0))
    kinds = appendix.exceptions["kind"].value_counts().to_dict()
    finding = (
        f"{within[0.1]} of {len(error)} rows agree within 0.1 % in both V_x2 and omega_2, {within[0.5]} within 0.5 "
        f"%, {within[1.0]} within 1 %. With misprinted inputs as printed {int(np.sum(before <= 0.1))} agree within "
        f"0.1 % and {int(np.sum(before <= 1.0))} within 1 %. {beyond} rows differ by more than 1 %. "
        f"{kinds.get('unexplained', 0)} cells beyond their rounding are unexplained."
    )
    problems = [f"not in the errata: {item}" for item in appendix.unlisted]
    problems += [f"now agrees, but is in the errata: {item}" for item in appendix.stale]
    return Check("Appendix C", " ".join([finding, *problems]), within == ROWS_WITHIN and not problems)


def _check_appendix_d(rows: pd.DataFrame) -> Check:
    matches = {name: int(rows[f"{name}_matches"].sum()) for name in appendices.ERRORS}
    angles = rows[appendices.ERROR_HEADS["theta_2"]]
    signed = int(np.sum(np.abs(rows["theta_2"] - angles) <= appendices.MATCHES))
    of_print = int(np.sum(appendices.matches(rows["theta_2_printed"], angles)))
    off = appendices.deviations(rows)
    finding = (
        f"of {len(rows)} rows, {matches['v_x2']} velocity, {matches['omega_2']} spin and {matches['theta_2']} angle "
        f"errors follow from Appendix C within {appendices.MATCHES} points. Angles use the mean restitution of "
        f"Chapter V and agree in size ({signed} with their sign). From the angles that Appendix C prints {of_print} "
        "would."
    )
    return Check("Appendix D", finding, matches == APPENDIX_D_MATCHES and "unlisted" not in set(off["kind"]))


def _check_energies(rows: pd.DataFrame) -> Check:
    worst = max(
        float((rows[f"{name}_recomputed"] / rows[name] - 1.0).abs().max())
        for name in ("cor", "v_x2_over_v_x1", "energy_1", "energy_2")
    )
    implied = rows["implied_inertia"]
    known, used = printed_tables.INERTIA_APPENDIX_B, INERTIA_OF["1/2"]
    whose = "that" if abs(implied.median() / known - 1.0) < INERTIA_ROUNDING else "not that"
    return Check(
        "Tables 2, 4 and 6",
        f"all {4 * len(rows)} numbers agree to {100.0 * worst:.3f} % or better. The energies need a moment of "
        f"inertia of {implied.median():.3g} lbf s^2 in ({implied.min():.3g} to {implied.max():.3g}), {whose} of "
        f"Appendix B ({known:g}). This is {100.0 * (implied.median() / used - 1.0):+.0f} % from the {used:g} of "
        "Chapter IV, which the simulations use.",
        worst < ENERGY_ROUNDING,
    )


def _check_friction(rows: pd.DataFrame) -> Check:
    counts = rows["print"].value_counts().to_dict()
    rounded, cut = counts.get("rounded", 0), counts.get("truncated", 0)
    return Check(
        "Table 7",
        f"Eq. (65) with the measured restitution: {rounded} of {len(rows)} values rounded, {cut} truncated.",
        rounded + cut == len(rows),
    )


def _check_inertia(inertia: Variable) -> Check:
    printed, measured = INERTIA_OF["1/2"], inertia.nominal_value
    how = "truncated" if 0.0 <= measured - printed < 1e-5 else "neither rounded nor truncated"
    how = "rounded" if abs(measured - printed) <= 0.5e-5 else how
    return Check(
        "Table 8",
        f"I = ({1e4 * measured:.3f} +- {1e4 * inertia.std_dev:.3f})e-4 lbf s^2 in by Eq. (79); the thesis prints "
        f"{printed:.5f}, {how}. Air drag, the tape and slanting strings are not included.",
        abs(measured - 2.888e-4) < 1e-7,
    )


def _check_damping(rows: pd.DataFrame) -> Check:
    nine = rows[rows["place"].str.startswith("Fig.")]
    appendix = rows[~rows["place"].str.startswith("Fig.")]
    counts = appendix["obeys"].value_counts().to_dict()
    obeying = nine[nine["obeys"] == "Chapter V"]
    impossible = int(rows["Eq. (8)"].isna().sum())
    return Check(
        "Damping c_y",
        f"{len(obeying)} of the {len(nine)} values of Chapter V obey exp(-x) = COR to "
        f"{obeying['nearest [%]'].max():.1f} %. Of the {len(appendix)} of Appendix C {counts.get('Chapter III', 0)} "
        f"obey exp(-x) = (M1/M)/COR to {printed_tables.OBEYS:g} %, {counts.get('Eq. (8)', 0)} Eq. (8), "
        f"{counts.get('none', 0)} none. Eq. (8) as printed has no solution for {impossible} of the {len(rows)}: the "
        "core would keep COR M/M1 > 1 of its speed.",
        len(obeying) == len(nine) and counts.get("Chapter III") == 19,
    )


def _check_examples(rows: pd.DataFrame) -> Check:
    used = rows[rows["inputs"] == "used"]
    worst = float(np.abs(used[["v_x2_error", "omega_2_error"]].to_numpy()).max())
    words = (printed_tables.rebound_words, printed_tables.transition_words)
    sentences = [text for number in used["example"] for word in words if (text := word(rows, int(number)))]
    finding = f"both rebounds agree to {worst:.3f} %. {' '.join(sentences)}"
    return Check("Examples of Chapter III", finding, worst < printed_tables.EXAMPLE_ROUNDING)


def _verdicts(
    rankings: Mapping[str, judgement.Ranking],
    by_chapter: judgement.Ranking,
    fits: Mapping[str, recalibration.Recalibration],
    slips: pd.DataFrame,
) -> dict[str, str]:
    """Whether `yield reasonable agreements` and `giving best results` hold, and the computation behind them."""
    fitted = fits["two-mass"]
    offset = fitted.offset
    placed = {name: item.placed for name, item in fits.items()}
    verdicts = {"Table 9": judgement.headline(rankings, placed), "Ranking": judgement.ranking_verdict(rankings)}
    for case in CASE_IN_APPENDIX_C:
        beside = judgement.fit_words(by_chapter.pooled, case, "two-mass", fitted.drawn.squares.rms)
        verdicts[f"Case {case}"] = f"{judgement.case_verdict(case, rankings)} {beside}"
    verdicts |= {f"Posterior of {name}": judgement.posterior_verdict(items) for name, items in placed.items()}
    verdicts["Offset"] = judgement.offset_verdict(fitted.problem.impacts.v_y1, offset.values / INCH, offset.sd / INCH)
    return verdicts | {"Slips": slip_words(slips)}
