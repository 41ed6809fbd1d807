"""Room: Jafri (2004) computed again."""

from collections.abc import Mapping

from fitball.base.errors import Note
from fitball.base.findings import Findings
from fitball.base.progress import Progress


def rederive(fix: Mapping[str, float], progress: Progress) -> Findings:
    """Appendices C and D counted, seven sets ranked, three cases (and a set of one's own, `fix`) in
    the posteriors of two-mass, thesis-exact and the thesis's own computation, Eq. 53, Figs 36-44,
    slips, as frames. Raises ParameterError (`unknown-parameter`, `out-of-bounds`, `no-answer`).
    """
    from fitball.inference.effort import TARGET_R_HAT
    from fitball.thesis import appendices, posteriors, ranking

    names, values = ranking.case_values(fix)
    errors, points = ranking.cases(names, values)
    rows_c = appendices.judged_c()
    rows_d = appendices.judged_d()
    fits = {name: posteriors.fitted(name, progress) for name in posteriors.MODELS}
    own = ", ".join(f"{name} = {value[-1]:.4g}" for name, value in values.items())
    notes = [
        Note("own-set", f"Your set, as case 1 of Table 9 but for what you give: {own} (SI).")
    ] * bool(fix)
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
    failed = not all(one.r_hat < TARGET_R_HAT for one in fits.values())
    return Findings(frames, tuple(notes), failed)
