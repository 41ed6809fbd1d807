"""Room: the results of Jafri's thesis (2004) computed again."""

from collections.abc import Mapping

from fitball.base.errors import Note
from fitball.base.findings import Findings
from fitball.base.progress import Progress


def rederive(fix: Mapping[str, float], progress: Progress) -> Findings:
    """All results of the thesis: rows of Appendices C and D that agree with print, seven sets
    ranked, three cases and a user's set `fix` (SI) in the posteriors of three models, Eq. (53),
    Figs 36 to 44, and slips. The findings have `failed` if a fit did not converge.

    Raises:
        ParameterError: `fix` has an unknown name (`unknown-parameter`), a value beyond its bounds
            (`out-of-bounds`), or a joint too soft for the computation (`no-answer`).
    """
    from fitball.inference.effort import TARGET_R_HAT
    from fitball.thesis import appendices, posteriors, ranking

    names, values = ranking.case_values(fix)
    errors, points = ranking.errors_and_points(names, values)
    rows_c = appendices.judge_appendix_c()
    rows_d = appendices.judge_appendix_d()
    fits = {name: posteriors.free_fit(name, progress) for name in posteriors.FITTED_MODELS}
    notes = []
    if fix:
        last = ", ".join(f"{name} = {column[-1]:.4g}" for name, column in values.items())
        text = f"Your set, as case 1 of Table 9 but for what you give: {last} (SI)."
        notes.append(Note("own-set", text))
    frames = {
        "counts": appendices.counts_frame(rows_c, rows_d),
        "appendix_c": rows_c,
        "appendix_d": rows_d,
        "rankings": ranking.rank_sets(),
        "cases": errors,
        "fits": posteriors.fits_frame(fits),
        "parameters": posteriors.parameters_frame(fits, names, values),
        "places": posteriors.places_frame(fits, names, values),
        "offsets": posteriors.offsets_frame(fits),
        "figures": points,
        "slips": appendices.slips_frame(),
        "draws": posteriors.draws_frame(fits),
    }
    failed = not all(fit.r_hat < TARGET_R_HAT for fit in fits.values())
    return Findings(frames, tuple(notes), failed)
