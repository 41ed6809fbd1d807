"""The sentences of verdicts and of adequacy: what a fit says of its model, of each parameter, and of all of them.

Templates only, from the first screen's to the last detail's, so that they can be read in one go; whoever fills one
has the numbers. Reasons and findings are parts of sentences: they begin small and are joined by semicolons.
"""

from __future__ import annotations

from collections.abc import Sequence

# --- does the model describe the data?

DESCRIBED = "The model describes the data: no residual test finds a pattern."
DESCRIBED_FINELY = (
    "The model describes the data. With {impacts:,} impacts, patterns far below the noise are significant: {faults}."
)
EXCEPTIONS = "The model describes the data, with exceptions: {faults}."
NOT_DESCRIBED = "The model does NOT describe the data: {faults}."
ALL_CONDITIONAL = "All further results are conditional: they hold only if the model is right."
TOO_FEW = "{few} too few to test the model{where}: {limit}."
# How many are too few, and in which columns if others are enough.
FEW_IMPACTS, FEW_MEASUREMENTS, WHERE = "impact", "measurement", " in {columns}"
ONLY_STRONG = "only a very strong misfit ({share:.0f} % of the residual variance) would be noticed"
NONE_NOTICED = "no misfit would be noticed"
ALL_ALIKE = (
    "The data cannot test the model: all {impacts:,} impacts have the same incidence, so residuals show no pattern."
)
ELSEWHERE = "In {columns}, no residual test finds a pattern."
HINTS = "Strongest hints: {hints}."
HINT = "{fault}, as strong in {chance:.0f} % of simulated data sets"
MODEL_ERROR = (
    "The misfit shifts {name} by {sds:.0f} of its sds. Standard deviations and intervals do not include this error."
)
WIDE = (
    "This noise is far above the usual size: {ratios}. State it in the scene if it is real; otherwise check signs, "
    "units and misread rows."
)
WIDE_RATIO = "{columns} {ratio} ×"
NO_NOISE = "The residuals' noise could not be estimated."

# --- what do incidences that were measured again say?

REPEATED = "{count} incidences were measured again ({freedom} degrees of freedom)."
REPEATED_ONE = "One incidence was measured again ({freedom} degrees of freedom)."
REPEATS = "{column} repeats to {pure}."
REPEATS_STATED = "{column} repeats to {pure} (stated: {stated})."
IMPACTS_SCATTER = "Impacts scatter beyond the stated errors of {columns}, whatever the model."
LACK_OF_FIT = "But residuals of {column} are {left}: the rest is misfit of the model, not scatter."
NO_REPEATS = (
    "{columns} scatter far beyond their stated errors. Rows that repeat an incidence would show whether impacts "
    "scatter or the model does not fit."
)

# --- how large is the noise?

NOISE = "{what}: {size}, {ratio} × the {known} {reference}"
NOISE_BY_ROW = "{what}: {ratio} × the stated sds"
RESIDUALS, PARAMETER = "residuals of {columns}", "noise parameter {name}"
STATED, EXPECTED = "stated", "expected"

# --- which patterns do the residuals show?

IN_COLUMN = "{column}: {pattern}"
SHARE = "{fault} ({share} of the residual variance)"
MORE = " and {more:,} more"
TREND, CURVE = "trend with {quantity}", "curved trend with {quantity}"
INTERACTION = "interaction of {quantity}"
DRIFT, IN_ORDER = "drift along the rows{order}", " (in the order of {quantities})"
BIASED, BIAS = "{column} is biased in {rows}", "bias in {group}"
# Of a parameter.
PARAMETER_DRIFT, PARAMETER_LEVEL = "{name}: {drift}", "{name} differs for {group}"
ALL_BIASED, ALL_DEPEND = "common bias in {rows}", "dependence on {quantity}"
NEIGHBOURS = "neighbouring residuals along {quantity} are correlated"
SCATTER = "the scatter changes with {quantity}"
SPREAD, GROWS = "the noise changes with {quantity}", "the noise increases with {quantity}"
FALLS = "the noise decreases with {quantity}"
LINKED = "residuals are correlated with those of {column}"
UNEVEN = "the scatter differs from that of {column}, which shares its noise"
OUTLIERS, OUTLIER, OUTLYING = "outliers", "impact {ids} is an outlier", "impacts {ids}{more} are outliers"
TAILS = "heavy tails"
LOO_PIT = "leave-one-out predictions are too wide, too narrow or biased"
BETTER = "{name} fits significantly better than {instead_of} ({gain} in log predictive density)"

# --- what is that based on?

TESTS = "{tests}, calibrated on {simulated}."
NO_TESTS = "No residual test: too few rows."
SIMULATED, SHORTER = "{count:,} simulated data sets", " of {impacts:,} impacts"
NOISES = "{count} compared with {known}."
LOO = "Leave-one-out predictions of each impact are among the tests (LOO-PIT)."
NO_LOO = "Without a posterior, leave-one-out predictions are to first order only."
POWER = "Share of the residual variance from which a trend is found in half of all cases: {shares}."
FALSE_ALARMS = "False alarms if the model is right: {exceptions:.0f} % with exceptions, {fails:.0f} % not described."

# --- did sampling converge, and what do the data determine?

CONVERGED = "Sampling converged: effective sample size at least {ess:.0f}, R-hat at most {r_hat:.3f}."
NOT_CONVERGED = (
    "Sampling did NOT converge in {steps} steps: effective sample size {ess:.0f} for {rarest} (target {enough:.0f}), "
    "R-hat {r_hat:.3f} for {apart} (target below {target})."
)
POINT_ONLY = "Point fit only, without a posterior: verdicts use profile likelihoods and the Fisher information."
R_HAT = "{name}: R-hat {r_hat:.3f}, target below {target} (the ensembles disagree)"
FEW_EFFECTIVE = "{name}: effective sample size {ess:.0f}, target {target:.0f}"
SEVERAL = "{count} fits describe the data: {fits}.{agree}"
AGREE = " They agree on {names}."
LESS_LIKELY = " (log likelihood {drop:.1f} below the best)"
# The first of these that is said begins with the data.
THE_DATA, THEY = "The data", "They"
DETERMINED = "{they} determine {names}."
GIVEN = "{they} determine {names} only under the model assumptions listed below."
UNEXAMINED = "{they} determine {names}; not all model assumptions could be examined."
EXTRAPOLATED = "Extrapolated beyond the measured speeds: {names}."
CONDITIONAL = "{they} determine {names} only if the model is right, which the residuals contradict."
ONE_SIDED = "{they} give only a lower or an upper bound on {names}."
NOT_DETERMINED = "{they} do not determine {names}: {its}."
ITS_PRIOR, THEIR_PRIORS = "its value is that of the prior", "their values are those of the priors"

# --- why is a parameter determined or not? By draws, by a profile, by the information.

UNCHANGED_BY_DRAWS = "the data hardly change its prior (contraction {contraction:.2f}){scene}{tied}"
UNCHANGED_BY_PROFILE = "the data hardly change its prior"
UNCHANGED_BY_INFORMATION = "to first order, the data hardly change its prior"
KNOWN_BY_DRAWS = "the data reduce its uncertainty to {marginal.percent:.2g} % of the prior's{scene}{tied}"
KNOWN_BY_PROFILE = "its profile likelihood is closed, 95 % interval {within}{scene}"
KNOWN_BY_INFORMATION = (
    "to first order, its standard error is {evidence.information.error:.2g} × the prior's sd{scene}"
)
NO_EVIDENCE = "a point fit has no posterior, and there is neither a profile likelihood nor a Fisher information"
NO_PROFILE = "a point fit has no posterior, and there is no profile likelihood"
TOGETHER = "the data determine it only in combination with {together}{tied}"
WITH_WHOM, OTHERS = "{others}: its own value comes from the priors of {whose}", "others"
NO_SCATTER = "no scatter beyond the stated errors was found: it is below {most} (95 %){tied}"
OPEN = "its profile likelihood is open on both sides: the data hardly change its prior"
NARROWED = "its profile likelihood is open on both sides: priors, its own or others', narrow it, not the data"
NO_FREEDOM = (
    "its measurements have {freedom:.2g} degrees of freedom left, and more than 2 are needed: its value comes from "
    "its prior"
)
BOUNDED_BY_DRAWS, BOUNDED_BY_PROFILE = "{bounded}{scene}{tied}", "{bounded}"
HELD_OFF = "priors, its own or others', keep it outside the data's 95 % interval {within}"
CONTRADICTED = "; prior and data disagree: the 95 % interval of the data alone is {within}"
BOUNDS = (
    "the data give only an upper bound (< {end}, 95 %); on its lower side ",
    "the data give only a lower bound (> {end}, 95 %); on its upper side ",
)
LIMITED = "it is limited by {limit}"
PRIOR, CONDITION, POSSIBLE = "the prior", "the model's condition {condition}", "physics, at {limit}"
SEARCHED = "the profile falls only because the search of {others} ended there"
PROFILE_IS = "the profile is {end}"
PRIOR_CLOSES = "; there the prior limits the posterior"
AT_BOUND = "; where its profile ends, {names} {at}"
ITS_BOUND, THEIR_BOUNDS = "is at its bound", "are at their bounds"
FROM_SCENE = "; its absolute value comes from {scene}"
PARTLY_SCENE = "; partly determined by {scene}: without it, the contraction would be {alone:.2f}"
SCENE, CONTACT_TIME = "the scene", "the scene's contact time ({value:.3g} ± {sd:.2g} ms)"
TIED = "; correlation {correlation:.2f} with {name}"
ACTS_NOWHERE = "; at these values it affects none of the {impacts} impacts{regimes}"
IN_DOUBT = "; {share:.0f} % of the information comes from impacts with an uncertain regime ({ids}{more})"
BEYOND = "extrapolated to {anchor:.0f} m/s from the measured {low:.3g} to {high:.3g} m/s"
FIXED = "held at its value: {why}"
IF_RIGHT = "only if the model is right: {reason}"
IF_MISFIT = "the model's misfit shifts it by {sds:.2g} sd; apart from that, {reason}"

# --- what values rest on an assumption?

NOTHING_DRAWN = "the fit gives neither draws nor derivatives to compare with"
NO_OPTIMUM = "no search found parameters that the model can evaluate"
NOT_SETTLED = "its quick fit did not settle"
SCORES_NOT_SETTLED = "too few of its leave-one-out scores settled"
WITHOUT = "without impact {ids}, whose score did not settle"

_COUNTS = (
    "No", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine", "Ten", "Eleven", "Twelve",
)  # fmt: skip


def listed(names: Sequence[str]) -> str:
    """Names as in a sentence: `a, b and c`."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def counted(count: int) -> str:
    """A number as a sentence begins with it: a word up to twelve."""
    return _COUNTS[count] if count < len(_COUNTS) else f"{count:,}"


def capital(text: str) -> str:
    """A text that begins a sentence."""
    return text[:1].upper() + text[1:]


CAMERA_EXPLAINS = (
    "{key} = {value} (sd {sd}) of the camera would explain {share:.0f} % of the residual variance: state {key} in "
    "[camera] of the scene, and it is fitted."
)
HEIGHT_OR_TIME = "A contact time that depends on the speed, which no model here has, looks much the same."
