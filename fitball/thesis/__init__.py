"""Room: the results of Jafri's thesis (2004) computed again."""

from collections.abc import Mapping

from fitball.base.errors import Note
from fitball.base.findings import Findings
from fitball.base.progress import Progress


def rederive(fix: Mapping[str, float], progress: Progress) -> Findings:
    """All results of the thesis: Appendices C and D counted, seven sets ranked, three
    cases (and a set of one's own, `fix`, in SI) in the posteriors of two-mass, thesis-exact and the
    thesis's own computation, Eq. 53, Figs 36-44, and slips. It has `failed` if a fit did not
    converge. Raises ParameterError (`unknown-parameter`, `out-of-bounds`, `no-answer`).
    """
    from fitball.inference.effort import TARGET_R_HAT
    from fitball.thesis import appendices, posteriors, ranking

    names, values = ranking.case_values(fix)
    errors, points = ranking.cases(names, values)
    rows_c = appendices.judged_c()
    rows_d = appendices.judged_d()
    fits = {name: posteriors.fitted(name, progress) for name in posteriors.MODELS}
    notes = []
    if fix:
        last = ", ".join(f"{name} = {column[-1]:.4g}" for name, column in values.items())
        text = f"Your set, as case 1 of Table 9 but for what you give: {last} (SI)."
        notes.append(Note("own-set", text))
    frames = {
        "counts": appendices.counts(rows_c, rows_d),
        "appendix_c": rows_c,
        "appendix_d": rows_d,
        "rankings": ranking.ranking(),
        "cases": errors,
        "fits": posteriors.fits_frame(fits),
        "parameters": posteriors.parameters_frame(fits, names, values),
        "places": posteriors.places_frame(fits, names, values),
        "offsets": posteriors.offsets_frame(fits),
        "figures": points,
        "slips": appendices.slips(),
        "draws": posteriors.draws_frame(fits),
    }
    failed = not all(fit.r_hat < TARGET_R_HAT for fit in fits.values())
    return Findings(frames, tuple(notes), failed)
