"""How large the slips of the thesis's computation are on Wang's impacts, set by set, and in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from fitball.data.published import SPINS, measured, thesis_table
from fitball.inference.prediction.outputs import root_mean_square
from fitball.inference.thesis.inputs import BALL_RADIUS, INERTIA, INERTIA_OF, printed_model, row_parameters
from fitball.report.form.rounding import digits
from fitball.report.form.sentences import listed
from fitball.thesis.ranking import EXACT, RECOMPUTED, UNITS, Ranking
from fitball.values import impacts

# Relative difference below which two computations count as the same.
ALIKE = 0.01


def slip_table(rankings: Mapping[str, Ranking]) -> pd.DataFrame:
    """One row per set of Appendix C, over the impacts of Wang that slide throughout in its computation: the spin
    gained over what the loss of `v_x` gives by angular momentum, recomputed and printed (medians), and what the stray
    cosine takes back of that loss (largest); then how far the computation is from the exact solution, over all
    impacts.
    """
    rows = []
    ours, exact = rankings[RECOMPUTED].errors, rankings[EXACT].errors
    for (case, mine), name in zip(thesis_table("appendix_c").groupby("case"), ours, strict=True):
        ratio, share = mine["mass_ratio"].iloc[0], mine["i1_over_i"].iloc[0]
        ratios = np.array([item for spin in SPINS for item in _sliding(mine[mine["spin"] == spin], spin)])
        gained, printed, stray = ratios.reshape(-1, 3).T
        rows.append(
            {"set": case, "M1/M": ratio, "I1/I2": share / (1.0 - share), "sliding": len(gained),
             "spin gained / balance": np.median(gained), "in print": np.median(printed),
             "stray cosine [% of loss]": 100.0 * stray.max(),
             **{f"{output} from exact [{UNITS[output]}]": root_mean_square(ours[name][output] - exact[name][output])
                for output in ("v_x2", "omega_2")}}
        )  # fmt: skip
    return pd.DataFrame(rows)


def _sliding(rows: pd.DataFrame, spin: str) -> Iterator[tuple[float, float, float]]:
    """For each sliding impact: spin gained over the balance, recomputed and printed, and the stray cosine's share."""
    chosen, wang, first = printed_model(), measured(spin), rows.iloc[0]
    values = row_parameters(first.to_dict())
    lever = values["ball_mass"] * BALL_RADIUS / (INERTIA_OF[first["mass_ratio"]] * INERTIA)
    for k, row in enumerate(rows.to_dict("records")):
        incident, omega_1 = row["v_x1 [m/s]"], row["omega_1 [rad/s]"]
        impact = impacts(incident, wang["v_y1"][k], omega_1, wang["v_y2"][k] / wang["v_y1"][k])
        rebound = chosen.rebound(values, impact)
        course = chosen.course(values, impact, rebound.contact_time)
        if np.isnan(course.transition):
            loss = incident - course.v_x[0]
            gained = (rebound.omega_2[0] - omega_1) / (lever * loss)
            printed = (row["omega_2 [rad/s]"] - omega_1) / (lever * (incident - row["v_x2 [m/s]"]))
            yield gained, printed, (course.v_x[0] - rebound.v_x2[0]) / loss


def slip_words(table: pd.DataFrame) -> str:
    """What the slips do, one clause a mass ratio."""
    gained, stray = [], []
    for ratio, mine in table.groupby("M1/M", sort=False):
        factor = float(mine["spin gained / balance"].median())
        size = "right" if abs(factor - 1.0) <= ALIKE else "too small" if factor < 1.0 else "too large"
        gained.append(f"{factor:.2f} ({size}) for M1/M = {ratio}, where I1/I2 is {mine['I1/I2'].iloc[0]:.2f}")
        stray.append(f"{digits(mine['stray cosine [% of loss]'].max(), 1)} % ({ratio})")
    apart = 100.0 * (table["spin gained / balance"] / table["I1/I2"] - 1.0).abs().max()
    spin, speed = table["omega_2 from exact [rad/s]"], table["v_x2 from exact [m/s]"]
    return (
        f"the spin gained while sliding is I1/I2 times, to {apart:.1f} %, what the loss of V_x beside it gives: "
        f"{listed(gained)}. A stray cosine takes back up to {listed(stray)} of the velocity that a ball loses which "
        f"slides throughout. Solved exactly, the equations give rebounds that differ from the computed ones by "
        f"{digits(speed.min(), 2)} to {digits(speed.max(), 2)} m/s and {digits(spin.min(), 2)} to "
        f"{digits(spin.max(), 2)} rad/s (rms over all impacts, from set to set)."
    )
