"""One paragraph for the methods section of a paper, with the numbers of a fit and the works to cite."""

from __future__ import annotations

from fitball.inference.results.evidence import Answer
from fitball.inference.results.results import Fit, Verdict
from fitball.observables import OBSERVABLES
from fitball.report.form.numbers import listed, parameter_row
from fitball.version import __version__

# The equations of each model.
MODELS = {
    "two-mass": " (a core and a shell, after Jafri 2004)", "thesis-exact": " (Jafri 2004)", "brody": " (Brody 1984)",
    "grip-slip": " (after Walton 1993 and Cross 2002)",
}  # fmt: skip
ENSEMBLES = (
    "Sampling used {ensembles} independent ensembles of {walkers} walkers and {steps} steps, of which {warm_up} were "
    "warm-up (Goodman and Weare 2010; emcee, Foreman-Mackey et al. 2013)."
)
WEIGHTED = "Sampling used adaptive importance sampling (Cornuet et al. 2012; Vehtari et al. 2024)."
CONVERGENCE = (
    "Convergence: nested R-hat of at most {r_hat:.3f} (Margossian et al. 2024) and an effective sample size of at "
    "least {ess:.0f} (Vehtari et al. 2021)."
)
TESTED = "Of {tests} residual tests, calibrated on {sets:,} simulated data sets, {found} found a misfit{so}."
CONCLUSIONS = {
    Answer.DESCRIBES: "", Answer.EXCEPT: "", Answer.FAILS: ": the model does not fit the data",
    Answer.UNDECIDED: ", but the data are too few to test the model",
}  # fmt: skip
VARIED = (
    "{count} model variants were compared by leave-one-out predictive density (Vehtari, Gelman and Gabry 2017); "
    "{good} fit equally well."
)


def methods_text(fit: Fit) -> str:
    """The paragraph."""
    problem, sampler, squares = fit.problem, fit.diagnostics, fit.least_squares
    measured = listed([item.name for item in problem.observables if item.name in OBSERVABLES])
    options = ", ".join(f"{name}={option}" for name, option in problem.model.options.items())
    lines = [
        f"The {problem.model.name} model of a bounce{MODELS.get(problem.model.name, '')} was fitted to "
        f"{len(problem.table)} impacts ({measured}) with fitball {fit.versions.get('fitball', __version__)}.",
        *([f"Model assumptions: {options}."] if options else []),
    ]
    if sampler is None:
        rms = f" ({squares.starts} starts)" if squares.starts else ""
        lines.append(f"Values are maxima of the posterior density{rms}; no posterior was sampled.")
    else:
        lines.append(f"The posterior of {len(problem.free_names)} parameters was sampled with seed {fit.seed}.")
        numbers = {name: getattr(sampler, name) for name in ("ensembles", "walkers", "steps", "warm_up")}
        lines.append(ENSEMBLES.format(**numbers) if sampler.pareto_k is None else WEIGHTED)
        ess = min(sampler.min_ess_bulk, sampler.min_ess_tail)
        lines.append(CONVERGENCE.format(r_hat=sampler.max_r_hat, ess=ess))
        if not sampler.converged:
            lines.append("The sampler did not converge.")
    if fit.adequacy is not None and fit.adequacy.checks:
        found = fit.adequacy
        count = sum(check.found for check in found.checks) or "none"
        conclusion = CONCLUSIONS[found.answer]
        lines.append(TESTED.format(tests=len(found.checks), sets=found.replicates, found=count, so=conclusion))
    if fit.assumptions is not None and fit.assumptions.alternatives:
        count, good = len(fit.assumptions.alternatives), len(fit.assumptions.as_good)
        lines.append(VARIED.format(count=count, good=good))
    values = [
        f"{row.name} = {row.within} {row.unit}".rstrip() + mark
        for item in fit.reported
        if item.verdict is not Verdict.FIXED
        for row, mark in [(parameter_row(item), " (prior-dominated)" * (item.verdict is Verdict.PRIOR_DOMINATED))]
    ]
    what = "Posterior medians with 95 % credible intervals" if sampler is not None else "Values"
    return " ".join([*lines, f"{what}: {'; '.join(values)}."])
