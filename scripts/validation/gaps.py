"""Do the gaps between the flights determine the stiffnesses, and do intervals hold? Films of 21 and of 40 impacts
like Wang's are simulated (`synthetic_gaps`), with gaps good to 0.05 ms, 0.7 mm and 2 deg or three times worse. The
truth is drawn from `PRIORS`, with which the film is fitted: 95 % of the 95 % intervals then contain it. The scale of
the camera (sd 1 %) and the height of the court (sd 3 mm) are free. The posterior is sampled by importance about its
maximum, which is searched from the truth.

Controls are wrong on purpose: the court 1 mm higher and that height not fitted; gaps that end at release, with the
ball still pressed in; the covariances of a row left out; and a turn that ends with the twist at release. The shift
and the coverage of each are predicted to first order from derivatives of the bounce alone, without the likelihood,
for a known scatter. The last is the smallest: a fit takes a part of it for scatter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import synthetic_gaps as films
from numpy.polynomial.legendre import leggauss
from scipy.stats import binom, norm

from fitball.api.calibrating import pose
from fitball.data.scene import Camera, Quantity, Scene
from fitball.errors import FitError, ParameterError, TableError
from fitball.inference.identifiability.examine import examine, profile_all
from fitball.inference.identifiability.information import about, prior_draws
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.point.point_fit import maximum_posterior
from fitball.inference.prediction.posterior_predictive import regime_shares
from fitball.inference.problem.camera import LEVEL, seen, true
from fitball.inference.problem.problem import Choices, Problem
from fitball.inference.results.results import PointFit, Posterior
from fitball.inference.results.results import Verdict as Said
from fitball.inference.sampling.importance import ENOUGH, importance_posterior
from fitball.models.registry import model
from fitball.models.types import OUTPUTS
from fitball.observables import NOISE_OF, SI_UNITS
from fitball.report.form.document import columns
from fitball.values import FloatArray, Impacts
from validation.harness import LEVEL as SHARE
from validation.harness import Rate, Row, Study, Verdict, drawn_truth, rate

# Rows of a film, and how many times worse than `synthetic_gaps` its gaps are.
CASES = ((21, 1.0), (21, 3.0), (40, 1.0), (40, 3.0))
PRIORS: Mapping[str, str] = {
    "mass_ratio": "uniform(0.75, 0.97)", "k_y": "lognormal(2.0e4, 0.4)", "k_theta": "lognormal(19, 0.4)",
    "mu": "lognormal(0.58, 0.15)", "eps_10": "normal(0.0022, 0.0008)", "eps_slope": "normal(0, 5e-5)",
    "cor_10": "normal(0.76, 0.03)", "cor_slope": "normal(-0.015, 0.004)",
    "v_x_sd": "lognormal(0.1, 0.4)", "v_y_sd": "lognormal(0.1, 0.4)", "spin_sd": "lognormal(4, 0.4)",
    "gap_time_sd": "lognormal(3e-5, 0.5)", "gap_path_sd": "lognormal(4e-4, 0.5)",
    "gap_turn_sd": "lognormal(0.012, 0.5)",
}  # fmt: skip
# Of the camera: value and sd.
SEEN: Mapping[str, tuple[float, float]] = {"scale": (1.0, 0.01), "court_height": (0.0, 0.003)}
COUNTED = ("k_y", "k_theta", "mu", "mass_ratio", "eps_10", "cor_10", "cor_slope", "court_height", "scale")
LEVELS = (0.5, 0.95)
ENDS = (0.025, 0.25, 0.5, 0.75, 0.975)
GAPS = tuple(name for name in films.SCATTER if name.startswith("gap_"))
HEIGHT, PRESSED, ALONE, TWIST = "height held", "press-in left out", "sds alone", "twist left out"
FITTED = "fitted"
WRONG = 1e-3
# Verdicts are of one film in so many.
JUDGED = 10
# By so much the coverage of a control may differ from the one that is predicted to first order.
NEAR = 0.15
# Predicted shifts of fewer sds are none.
NOTHING = 1e-12
RELIED_ON = (Said.IDENTIFIED, Said.GIVEN, Said.UNEXAMINED)


@dataclass(frozen=True)
class Film:
    """A simulated film: true `impacts` and `truth` by name, measured `values` (impacts, 9) of
    `synthetic_gaps.COLUMNS` and their `errors` (impacts, 9, 9).
    """

    impacts: Impacts
    truth: Mapping[str, float]
    values: FloatArray
    errors: FloatArray

    @property
    def own(self) -> dict[str, float]:
        """The parameters of the model."""
        return {name: self.truth[name] for name in films.TRUTH}

    @property
    def camera(self) -> dict[str, float]:
        """Those of the camera."""
        return {name: self.truth[name] for name in SEEN}

    @property
    def scatter(self) -> FloatArray:
        """By how much balls scatter beyond errors, of each of the columns, (9,)."""
        return np.array([self.truth.get(NOISE_OF.get(name, ""), 0.0) for name in films.COLUMNS])

    def problem(self, held: Sequence[str] = ()) -> Problem:
        """As `calibrate` poses it, with constants of the camera `held`."""
        scale, height = (None if name in held else Quantity(*known) for name, known in SEEN.items())
        scene = Scene(camera=Camera(scale=scale, court_height=height))
        sheet = {f"{name} [{SI_UNITS[name]}]": self.values[:, k].tolist() for k, name in enumerate(films.COLUMNS)}
        return pose(sheet, Choices(priors=PRIORS), scene=scene, covariance=self.errors, as_read=True)


def made_film(rows: int, worse: float, rng: np.random.Generator) -> Film:
    """A film of `rows` impacts with a truth from the priors; its errors of gaps are so many times `worse`. A truth
    with which the model ends before some of the true impacts is drawn again, and so is a film that cannot be read,
    as where the court is so much higher that one flight ends where the other begins.
    """
    impacts = films.incidence(rows, rng)
    plain = films.film(impacts, films.TRUTH, {}, films.SCATTER, np.random.default_rng(0))
    known = Film(impacts, {}, *plain).problem()
    while True:
        truth = dict(zip(known.free_names, drawn_truth(known, rng, "gaps").tolist(), strict=True))
        mine = Film(impacts, truth, *plain)
        scatter = {name: truth[NOISE_OF[name]] for name in films.SCATTER}
        try:
            FirstOrder.from_film(mine, mine.errors)
            values, errors = films.film(impacts, mine.own, mine.camera, scatter, rng, worse)
            made = replace(mine, values=values, errors=errors)
            made.problem()
        except (ParameterError, TableError):
            continue
        return made


def spoiled(film: Film) -> dict[str, Film]:
    """The same film with each fault that is in the data. The turn of the shell up to release is integrated along the
    history of the contact, so that no gap of the model is used for it.
    """
    fitted = model("two-mass")
    rebound = fitted.rebound(film.own, film.impacts)
    late = rebound.gap_time - rebound.contact_time
    nodes, weights = leggauss(60)
    turn = np.empty(len(film.impacts))
    for k, time in enumerate(rebound.contact_time.tolist()):
        course = fitted.history(film.own, film.impacts.take(np.array([k])), 0.5 * time * (nodes + 1.0))
        turn[k] = 0.5 * time * float(np.ravel(course.omega_2) @ weights)
    lost = {
        PRESSED: {"gap_time": late, "gap_path": rebound.v_x2 * late, "gap_turn": rebound.omega_2 * late},
        TWIST: {"gap_turn": rebound.gap_turn - rebound.omega_2 * late - turn},
        # A court that is higher is reached earlier and left later; what is true of the film is held at zero.
        HEIGHT: _higher(film, WRONG - film.truth["court_height"]),
    }
    made = {}
    for name, columns_lost in lost.items():
        values = film.values.copy()
        for column, difference in columns_lost.items():
            values[:, films.COLUMNS.index(column)] -= difference
        made[name] = replace(film, values=values)
    alone = np.stack([np.diag(np.diag(one)) for one in film.errors])
    return made | {ALONE: replace(film, errors=alone)}


def _higher(film: Film, height: float) -> dict[str, FloatArray]:
    """By how much the gaps shrink where the court is higher by `height`: both flights are cut off there."""
    v_x1, v_y1, omega_1, v_x2, v_y2, omega_2 = pictured(film).T[:6]
    return {
        "gap_time": height * (1.0 / v_y1 + 1.0 / v_y2),
        "gap_path": height * (v_x1 / v_y1 + v_x2 / v_y2),
        "gap_turn": height * (omega_1 / v_y1 + omega_2 / v_y2),
    }


def pictured(film: Film, **moved: float) -> FloatArray:
    """What the camera shows of the film without errors (impacts, 9), with parameters or incident columns `moved`."""
    truth = {**film.truth, **{name: film.truth[name] + step for name, step in moved.items() if name in film.truth}}
    camera = {name: np.array(value) for name, value in {**LEVEL, **{key: truth[key] for key in SEEN}}.items()}
    steps = (moved.get(name, 0.0) for name in films.INCIDENT)
    v_x, v_y, omega = (
        column + step for column, step in zip(films.pictured(film.impacts, film.camera), steps, strict=True)
    )
    measured = (v_x, v_y, omega)
    rebound = model("two-mass").rebound({name: truth[name] for name in films.TRUTH}, Impacts(*true(camera, measured)))
    after = seen(camera, measured, {name: getattr(rebound, name) for name in OUTPUTS})
    return np.stack([*measured, *(after[name] for name in films.SCATTER)], axis=1)


@dataclass(frozen=True)
class FirstOrder:
    """The posterior of a film as derivatives of the bounce promise it: `names`, `information` (names, names) with
    that of the priors, and `weights` (names, impacts, 6) by which residuals move the gradient. `rest` (impacts, 6, 6)
    is what residuals scatter by.
    """

    names: tuple[str, ...]
    information: FloatArray
    weights: FloatArray
    rest: FloatArray

    @classmethod
    def from_film(cls, film: Film, errors: FloatArray, held: Sequence[str] = ()) -> FirstOrder:
        """That of a fit which takes these errors (impacts, 9, 9) for true."""
        known = {**{name: moments(text) for name, text in PRIORS.items() if name in film.own}, **SEEN}
        names = tuple(name for name in known if name not in held)
        sds = np.array([known[name][1] * (film.truth[name] if _is_log(name) else 1.0) for name in names])
        own = len(films.INCIDENT)
        slopes = np.stack([_slope(film, name, 1e-3 * sd) for name, sd in zip(names, sds, strict=True)])[..., own:]
        inputs = np.stack([_slope(film, name, 1e-4) for name in films.INCIDENT], axis=-1)[:, own:]
        # Residuals have the errors of the rebound less those that the incident ones bring with them.
        mixed = np.concatenate([-inputs, np.broadcast_to(np.eye(6), (len(inputs), 6, 6))], axis=2)
        rest = mixed @ errors @ mixed.swapaxes(1, 2) + np.diag(film.scatter[own:] ** 2)
        weights = np.einsum("aki,kij->akj", slopes, np.linalg.inv(rest))
        information = np.einsum("akj,bkj->ab", weights, slopes) + np.diag(sds**-2.0)
        return cls(names, information, weights, rest)

    @property
    def sds(self) -> dict[str, float]:
        """Of the posterior, by name."""
        return dict(zip(self.names, np.sqrt(np.diag(np.linalg.inv(self.information))).tolist(), strict=True))

    def bias(self, difference: FloatArray) -> dict[str, float]:
        """By how much a `difference` (impacts, 6) of the measurements moves each parameter, in its sds."""
        moved = np.linalg.solve(self.information, np.einsum("akj,kj->a", self.weights, difference))
        return {name: float(step / self.sds[name]) for name, step in zip(self.names, moved, strict=True)}

    def width(self, right: FirstOrder) -> dict[str, float]:
        """The sd that is stated over that of the error, where residuals scatter as in the `right` one."""
        prior = self.information - np.einsum("akj,bkj->ab", self.weights, self._slopes)
        noise = np.einsum("aki,kij,bkj->ab", self.weights, right.rest, self.weights) + prior
        inverse = np.linalg.inv(self.information)
        errors = np.sqrt(np.diag(inverse @ noise @ inverse))
        return {name: self.sds[name] / error for name, error in zip(self.names, errors.tolist(), strict=True)}

    @property
    def _slopes(self) -> FloatArray:
        return np.asarray(np.einsum("aki,kij->akj", self.weights, self.rest))


def moments(text: str) -> tuple[float, float]:
    """Centre and sd of a prior in its coordinate."""
    one, other = (float(word) for word in text.partition("(")[2].rstrip(")").split(","))
    return (0.5 * (one + other), (other - one) / np.sqrt(12.0)) if text.startswith("uniform") else (one, other)


def _is_log(name: str) -> bool:
    return PRIORS.get(name, "").startswith("lognormal")


def _slope(film: Film, name: str, step: float) -> FloatArray:
    return (pictured(film, **{name: step}) - pictured(film, **{name: -step})) / (2.0 * step)


def held_share(bias: float, width: float = 1.0) -> float:
    """The share of 95 % intervals that contain the truth where they are off by so many of their sds, and that many
    times too wide.
    """
    reach = norm.ppf(0.5 + SHARE / 2.0)
    return float(norm.cdf(width * (reach - bias)) - norm.cdf(width * (-reach - bias)))


def predicted(film: Film, faulty: Mapping[str, Film]) -> dict[str, dict[str, tuple[float, float]]]:
    """Bias in sds, and coverage, of each control and parameter to first order."""
    right, own = FirstOrder.from_film(film, film.errors), len(films.INCIDENT)
    made = {}
    for name, other in faulty.items():
        order = FirstOrder.from_film(film, other.errors, ("court_height",) if name == HEIGHT else ())
        difference = (other.values - film.values)[:, own:]
        if name == HEIGHT:
            # It is held where the film has its own truth: only what is wrong counts.
            difference = -np.stack(
                [_higher(film, WRONG).get(column, np.zeros(len(difference))) for column in films.SCATTER], axis=1
            )
        bias, width = order.bias(difference), order.width(right)
        made[name] = {key: (bias[key], held_share(bias[key], width[key])) for key in order.names}
    return made


def fitted(film: Film, rng: np.random.Generator, held: Sequence[str] = ()) -> tuple[Problem, PointFit, FloatArray]:
    """The problem of a film, its maximum, and draws (draws, free) of the posterior. Raises FitError where importance
    sampling about the maximum fails.
    """
    problem = film.problem(held)
    return problem, *sampled(problem, film.truth, rng)


def sampled(
    problem: Problem, truth: Mapping[str, float], rng: np.random.Generator, enough: float = ENOUGH
) -> tuple[PointFit, FloatArray]:
    """The maximum of a posterior near the `truth`, and draws (draws, free) by importance sampling about it, of which
    `enough` are effective if possible. Raises FitError where that fails.
    """
    point = maximum_posterior(problem, np.array([[truth[name] for name in problem.free_names]]))
    optima = problem.to_coordinates(problem.free_rows(point.optima))
    drawn = importance_posterior(problem, [about(problem, one) for one in optima], rng, enough)
    if not drawn.settled:
        raise FitError(f"importance sampling has {drawn.effective:.0f} effective draws")
    return point, drawn.values[rng.choice(len(drawn.values), max(1000, round(enough)), p=np.exp(drawn.log_weights))]


def judged(problem: Problem, point: PointFit, draws: FloatArray, rng: np.random.Generator) -> dict[str, str]:
    """What the fit says of each parameter; other assumptions are not examined."""
    shape = (4, 25, 10, problem.dimension)
    values = draws[: 4 * 25 * 10].reshape(shape)
    scores = log_posterior(problem, problem.to_coordinates(draws)).reshape(shape[:-1])
    posterior = Posterior(problem.free_names, values, scores, prior_draws(problem, rng))
    regimes = regime_shares(problem.rebound(draws[:400]))
    correlation = np.atleast_2d(np.corrcoef(draws, rowvar=False))
    profiled = profile_all(problem, point, point.optima)
    _evidence, found = examine(problem, point, profiled, posterior, correlation, regimes)
    return {name: str(found[name].verdict) for name in problem.free_names}


def replicate(seed: int, number: int) -> list[Row]:
    """Film `number`, of a case in turn, fitted as it is and with its covariances left out; those of the first case
    with every fault. For each fit and parameter: `z`, by how many sds the median lies above the truth, its `sd` and
    that to first order (`expected`), whether the 50 and 95 % intervals contain the truth (`inside`), the coverage and
    the bias that are `predicted`; the `verdicts` of some.
    """
    rows, worse = CASES[number % len(CASES)]
    rng = np.random.default_rng([seed, number])
    film = made_film(rows, worse, rng)
    faulty = {name: other for name, other in spoiled(film).items() if number % len(CASES) == 0 or name == ALONE}
    promised = predicted(film, faulty)
    made = []
    for name, other in {FITTED: film, **faulty}.items():
        about_it: Row = {"case": number % len(CASES), "fit": name}
        held = ("court_height",) if name == HEIGHT else ()
        try:
            problem, point, draws = fitted(other, rng, held)
        except (FitError, TableError) as error:
            made.append({**about_it, "failed": str(error)})
            continue
        sds = FirstOrder.from_film(film, other.errors, held).sds
        found = {
            key: _found(draws[:, problem.free_names.index(key)], key, film.truth[key], sds[key])
            for key in COUNTED
            if key not in held
        }
        row = {**about_it, "failed": "", "found": found}
        if name != FITTED:
            row["predicted"] = {key: [_short(one) for one in promised[name][key]] for key in found}
        elif number // len(CASES) % JUDGED == 0:
            row["verdicts"] = judged(problem, point, draws, rng)
        made.append(row)
    return made


def _found(draws: FloatArray, name: str, truth: float, expected: float) -> Row:
    """What draws (draws,) say of a parameter, in its coordinate; `expected` is its sd in SI."""
    if _is_log(name):
        draws, truth, expected = np.log(draws), float(np.log(truth)), expected / truth
    ends, sd = np.quantile(draws, ENDS), float(np.std(draws))
    return {
        "z": _short((ends[2] - truth) / sd),
        "sd": _short(sd),
        "expected": _short(expected),
        "inside": [bool(ends[1] <= truth <= ends[3]), bool(ends[0] <= truth <= ends[4])],
    }


def _short(value: float) -> float:
    """As files keep it."""
    return float(f"{value:.5g}")


def study() -> Study:
    """Films of all cases in turn."""
    settings = {
        "cases": CASES, "priors": dict(PRIORS), "camera": dict(SEEN), "judged": JUDGED, "wrong": WRONG,
        "film": [films.FRAMES, films.RATE, films.POINT, films.ANGLE, films.MARK],
    }  # fmt: skip
    return Study("gaps", replicate, settings, "gaps", "films")


def coverages(rows: Sequence[Row]) -> list[dict[str, object]]:
    """How many 50 and 95 % intervals of each parameter contain the truth, of how many; the median sd and that over
    the one to first order. Of each case, and of all.
    """
    made = []
    for case in (*range(len(CASES)), None):
        some = [row["found"] for row in rows if case is None or row["case"] == case]
        for name in COUNTED:
            mine = [one[name] for one in some if name in one]
            if not mine:
                continue
            for level, share in enumerate(LEVELS):
                held = rate(one["inside"][level] for one in mine)
                made.append({
                    "case": "all" if case is None else _title(case), "parameter": name, "level": share,
                    "holds": held.count, "of": held.total, "low": held.low, "high": held.high,
                    "sd": float(np.median([one["sd"] for one in mine])),
                    "over_first_order": float(np.median([one["sd"] / one["expected"] for one in mine])),
                })  # fmt: skip
    return made


def _title(case: int) -> str:
    rows, worse = CASES[case]
    return f"{rows} rows" if worse <= 1.0 else f"{rows} rows, gaps {worse:g} x"


def controls(records: Sequence[Sequence[Row]]) -> list[dict[str, object]]:
    """Of each control k_y and the parameter of which it spoils most intervals, as predicted: the share of 95 %
    intervals that contain the truth, as counted and as predicted to first order; the shifts from the fit of the same
    film without a fault, in sds (root mean square), as found and as predicted, and the `slope` of the ones on the
    others, with its standard error.
    """
    made = []
    for name in (HEIGHT, PRESSED, TWIST, ALONE):
        pairs = [(by[FITTED], by[name]) for one in records if {FITTED, name} <= (by := _by_fit(one)).keys()]
        if not pairs:
            continue
        some = [row for _right, row in pairs]
        least = {key: float(np.mean([row["predicted"][key][1] for row in some])) for key in some[0]["found"]}
        for key in dict.fromkeys(("k_y", min(least, key=lambda one: least[one]))):
            held = rate(row["found"][key]["inside"][1] for row in some)
            expected = np.array([row["predicted"][key][0] for row in some])
            moved = np.array([_shift(right["found"][key], row["found"][key]) for right, row in pairs])
            made.append({
                "control": name, "parameter": key, "holds": held.count, "of": held.total, "low": held.low,
                "high": held.high, "predicted": least[key], "shift": _size(moved), "predicted_shift": _size(expected),
                **_slope_of(moved, expected),
            })  # fmt: skip
    return made


def _by_fit(rows: Sequence[Row]) -> dict[str, Row]:
    return {row["fit"]: row for row in rows if not row["failed"]}


def _shift(right: Row, wrong: Row) -> float:
    """From one median to the other, in sds of the latter."""
    return float(wrong["z"] - right["z"] * right["sd"] / wrong["sd"])


def _size(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _slope_of(moved: FloatArray, expected: FloatArray) -> dict[str, float | None]:
    """The line through the origin; none where nothing is to be moved."""
    square = float(expected @ expected)
    if square < NOTHING * len(expected):
        return {"slope": None, "slope_se": None}
    slope = float(expected @ moved) / square
    return {"slope": slope, "slope_se": float(np.sqrt(np.sum((expected * (moved - slope * expected)) ** 2)) / square)}


def judge(records: Sequence[Sequence[Row]], seed: int) -> Verdict:
    """Do intervals hold in 50 and 95 % within binomial limits (all of them together in 95 % of such studies), are sds
    those of first order, are both stiffnesses identified, and does each control fail, by about as much as predicted?
    """
    every = [row for one in records for row in one]
    rows = [row for row in every if not row["failed"]]
    sound = [row for row in rows if row["fit"] == FITTED]
    found, wrong = coverages(sound), controls(records)
    limit = (1.0 - SHARE) / max(1, len(found))
    said = [row["verdicts"] for row in sound if "verdicts" in row]
    verdicts = {
        name: {
            verdict: sum(one[name] == verdict for one in said) for verdict in dict.fromkeys(one[name] for one in said)
        }
        for name in COUNTED
    }
    stiff = [rate(one[name] in RELIED_ON for one in said) for name in ("k_y", "k_theta")]
    worst = {str(one["control"]): one for one in wrong}
    content: dict[str, Any] = {
        "seed": seed,
        "films": len(records),
        "failed": len(every) - len(rows),
        "coverages": found,
        "controls": wrong,
        "verdicts": verdicts,
        "judged": len(said),
        "holds": all(min(_chances(one)) > limit / 2.0 for one in found)
        and all(abs(float(str(one["over_first_order"])) - 1.0) < NEAR for one in found)
        and all(one.agrees(SHARE, 1.0) for one in stiff)
        and len(every) - len(rows) <= 0.02 * len(every)
        and all(_moves(one) if name == TWIST else _spoils(one) for name, one in worst.items()),
    }  # fmt: skip
    return Verdict(content, {"coverage": found, "controls": wrong}, _words(content))


def _spoils(one: Mapping[str, Any]) -> bool:
    """Whether too few intervals contain the truth, and about as few as predicted."""
    return bool(one["high"] < SHARE and one["low"] - NEAR <= one["predicted"] <= one["high"] + NEAR)


def _moves(one: Mapping[str, Any]) -> bool:
    """Whether the fits follow a fault, be it less than predicted with the scatter known."""
    return one["slope"] is not None and 3.0 * one["slope_se"] < one["slope"] < 1.0 + NEAR


def _chances(one: Mapping[str, object]) -> tuple[float, float]:
    """Chances of so few intervals that hold, and of so many."""
    count, total, share = int(str(one["holds"])), int(str(one["of"])), float(str(one["level"]))
    return float(binom.cdf(count, total, share)), float(binom.sf(count - 1, total, share))


def _in_words(one: Mapping[str, Any]) -> str:
    return "-" if one["slope"] is None else f"{one['slope']:.2f} +- {one['slope_se']:.2f}"


def _words(content: Mapping[str, Any]) -> str:
    def held(one: Mapping[str, Any]) -> str:
        return f"{Rate(one['holds'], one['of'])} of {one['of']}"

    heads = ["films", "parameter", "level", "contain the truth", "median sd", "over first order"]
    every = [heads] + [
        [one["case"], one["parameter"], f"{100 * one['level']:.0f} %", held(one), f"{one['sd']:.3g}",
         f"{one['over_first_order']:.2f}"]
        for one in content["coverages"]
    ]  # fmt: skip
    wrong = [["control", "parameter", "contain the truth", "predicted", "shift in sds", "predicted", "slope"]]
    wrong += [
        [one["control"], one["parameter"], held(one), f"{100 * one['predicted']:.0f} %",
         f"{one['shift']:.2f}", f"{one['predicted_shift']:.2f}", _in_words(one)]
        for one in content["controls"]
    ]  # fmt: skip
    said = [["parameter", f"verdicts of {content['judged']} films"]]
    said += [
        [name, ", ".join(f"{verdict} {count}" for verdict, count in counts.items())]
        for name, counts in content["verdicts"].items()
    ]
    head = "Sds of k_y, k_theta and mu are shares of the value, others in SI.\n"
    last = f"Fits that failed: {content['failed']}."
    return "\n".join([head, *columns(every, 3), "", *columns(wrong, 2), "", *columns(said, 1), "", last]) + "\n"
