"""Do positions on film give the impacts, with errors that are right? Films with a known truth are made with the
two-mass ball and cameras of five frame rates, noise of 0.5 to 2 mm, outliers and marks, and `fitball track` estimates
from each what it holds. Straight lines through five frames are beside it. Films of 21 impacts with a camera whose
scale, clock, tilt and court are wrong within their errors are then fitted, and so are speeds by lines.

Controls are wrong on purpose: flights without drag and Magnus force, whose intervals must not hold, and a court 1 mm
too high, which moves the time between the flights by what geometry says. On the bundled film of a table-tennis ball
odd frames are held against even ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import binom

from fitball.api.calibrating import pose
from fitball.api.tracking import track
from fitball.data.scene import Camera, Quantity, Scene
from fitball.errors import FitError, ParameterError, TableError
from fitball.inference.point.point_fit import maximum_posterior
from fitball.inference.problem.problem import Choices
from fitball.models.registry import model
from fitball.models.types import Rebound
from fitball.observables import NOISE_OF, SI_UNITS
from fitball.report.form.document import columns
from fitball.tracks.frames import NINE, Air, Filmed, Track, TrackedImpact, Tracks
from fitball.tracks.lines import five_frame_lines
from fitball.tracks.session import CAMERA_SDS, estimate
from fitball.tracks.simulate import Film, ahead_at_release, simulated_tracks, truth
from fitball.values import FloatArray, Impacts
from validation.gaps import PRIORS, moments, sampled
from validation.harness import Rate, Row, Study, Verdict, rate

# The ball of films that are not fitted.
BALL: Mapping[str, float] = {
    "mass_ratio": 0.883, "k_y": 2.0e4, "k_theta": 19.0, "mu": 0.568, "eps_10": 2.38e-3, "eps_slope": 0.0,
    "cor_10": 0.774, "cor_slope": -0.0151,
}  # fmt: skip
# Width and height of the view [m] by least frames per second: faster cameras see less.
VIEWS = {5000.0: (0.25, 0.35), 1500.0: (0.5, 0.35), 400.0: (0.8, 0.5), 0.0: (1.2, 0.8)}
# What a search of fits of lines begins with.
NOISE = {"velocity_sd": 0.3, "v_x_sd": 0.3, "v_y_sd": 0.3, "spin_sd": 5.0}


@dataclass(frozen=True)
class Case:
    """A kind of film of so many `impacts`; some are `fitted`, with errors of the camera."""

    name: str
    film: Film
    impacts: int = 8
    fitted: bool = False
    controls: bool = False


def _case(fps: float, noise: float = 1.0, outliers: float = 0.02, fold: int = 1, **more: Any) -> Case:
    width, height = next(size for least, size in VIEWS.items() if fps >= least)
    film = Film(fps=fps, noise=1e-3 * noise, outliers=outliers, fold=fold, width=width, height=height)
    words = "" if fold == 1 else ", stripe"
    return Case(f"{fps:g}/s, {noise:g} mm, outliers {100 * outliers:g} %{words}", film, **more)


CASES = (
    _case(240, controls=True), _case(240, noise=2.0), _case(240, fold=2), _case(500), _case(1000, noise=0.5),
    _case(1000, controls=True), _case(1000, outliers=0.0), _case(1000, outliers=0.1), _case(1000, noise=2.0),
    _case(1000, fold=2), _case(2000), _case(10000),
    replace(_case(240), name="240/s, fitted", impacts=21, fitted=True),
    replace(_case(1000), name="1000/s, fitted", impacts=21, fitted=True),
)  # fmt: skip
LEVELS: Mapping[float, float] = {0.68: 0.994457883, 0.95: 1.959963985}
FITTED = ("mu", "eps_10", "cor_slope", "k_theta", "k_y")
BY_LINES = ("mu", "eps_10", "cor_slope", "k_theta")
STILL, HIGHER = "still air", "court 1 mm higher"
WRONG = 1e-3
# Shares that controls and promises are held to, as the study was designed.
STILL_AT_MOST, SURE_AT_LEAST, SURE_WRONG = 0.40, 0.90, 0.003
# A spin that is off by as much [rad/s], and by so many sds, is another whole turn, or another candidate.
OTHER_SPIN, MANY_SDS = 40.0, 6.0
# Effective draws of the fits.
DRAWS = 2000.0


def replicate(seed: int, number: int) -> list[Row]:
    """A film of one case in turn, with its controls, and its fits; the first holds the bundled film too."""
    case = CASES[number % len(CASES)]
    rng = np.random.default_rng([seed, number])
    own = drawn_ball(rng) if case.fitted else dict(BALL)
    impacts, rebound = bounced(case.impacts, own, rng)
    filmed = Filmed()
    # Air as the estimator takes it: a drag of the session, and lift that differs from its law.
    air = replace(Air(), drag=Air.drag + Air.drag_sd * rng.standard_normal())
    film = replace(case.film, air=air, lift_sd=Air.lift_sd)
    if case.fitted:
        off = {name: sd * rng.standard_normal() for name, sd in CAMERA_SDS.items()}
        film = replace(
            film, scale=1.0 + off["scale"], clock=1.0 + off["clock"], tilt=off["tilt"],
            court_height=off["court_height"],
        )  # fmt: skip
    ball = model("two-mass")
    twist = ahead_at_release(ball, {name: own[name] for name in ball.parameter_names}, impacts, rebound)
    tracks = simulated_tracks(impacts, rebound, film, rng, twist=twist)
    found = estimate(tracks, filmed)
    about_it: Row = {"case": number % len(CASES)}
    if case.fitted:
        return [{**about_it, "kind": "fit", **fitted(found, own, rng)}]
    exact = truth(impacts, rebound)
    made = [{**about_it, "kind": "film", **counted(found, exact)}]
    if case.controls:
        still = replace(filmed, air=replace(Air(), density=1e-6))
        made.append({**about_it, "kind": STILL, **counted(estimate(tracks, still), exact)})
        made.append(
            {**about_it, "kind": HIGHER, "ratios": ratios(found, estimate(tracks, replace(filmed, court=WRONG)))}
        )
    if number == 0:
        made.append({"case": -1, "kind": "real", **odd_against_even()})
    return made


def drawn_ball(rng: np.random.Generator) -> dict[str, float]:
    """A truth from the priors of `gaps`, noise parameters among it."""
    made = {}
    for name, text in PRIORS.items():
        if text.startswith("uniform"):
            low, high = (float(word) for word in text.partition("(")[2].rstrip(")").split(","))
            made[name] = float(rng.uniform(low, high))
            continue
        centre, spread = moments(text)
        drawn = rng.standard_normal() * spread
        made[name] = centre * float(np.exp(drawn)) if text.startswith("lognormal") else centre + float(drawn)
    return made


def bounced(count: int, own: dict[str, float], rng: np.random.Generator) -> tuple[Impacts, Rebound]:
    """So many impacts that the ball can have, and their rebounds with the ball's scatter, where it has one."""
    ball = model("two-mass")
    kept: list[tuple[float, float, float]] = []
    while len(kept) < count:
        speed, angle = rng.uniform(12.0, 25.0), np.radians(rng.uniform(16.0, 60.0))
        one = speed * np.cos(angle), float(np.clip(speed * np.sin(angle), 4.0, 16.0)), rng.uniform(-300.0, 400.0)
        try:
            alone = ball.rebound({name: own[name] for name in ball.parameter_names}, Impacts(*np.array(one)[:, None]))
        except ParameterError:
            # The ball cannot have this impact; one that has few is drawn again.
            if rng.uniform() < 0.1:
                own |= drawn_ball(rng)
                kept.clear()
            continue
        if alone.v_x2[0] > 1.0:
            kept.append(one)
    impacts = Impacts(*np.array(kept).T)
    rebound = ball.rebound({name: own[name] for name in ball.parameter_names}, impacts)
    scattered = {
        name: getattr(rebound, name) + own[NOISE_OF[name]] * rng.standard_normal(count)
        for name in NINE[3:]
        if NOISE_OF[name] in own
    }
    return impacts, replace(rebound, **scattered)


def counted(found: Tracks, exact: FloatArray) -> Row:
    """Of each impact that was found: by how many sds the `NINE` are off, sds, errors of lines, and spins."""
    rows = [_one(impact, exact[int(impact.id.split("-")[0]) - 1]) for impact in found.impacts]
    return {"of": len(exact), "impacts": rows}


def _one(impact: TrackedImpact, exact: FloatArray) -> Row:
    sds = np.sqrt(np.diagonal(impact.covariance))
    known = np.isfinite(impact.values) & (sds > 0.0)
    z = np.where(known, (impact.values - exact) / np.where(known, sds, 1.0), np.nan)
    spins = [NINE.index("omega_1"), NINE.index("omega_2")]
    far = np.maximum(OTHER_SPIN, MANY_SDS * sds)
    right = impact.sure and bool(np.all((np.abs(impact.values - exact) < far)[spins]))
    speeds = [NINE.index(name) for name in ("v_x1", "v_y1", "v_x2", "v_y2")]
    return {
        "z": [_short(one) for one in z],
        "sd": [_short(one) for one in np.where(known, sds, np.nan)],
        "lines": [_short(one) for one in five_frame_lines(impact) - exact[speeds]],
        "sure": bool(impact.sure),
        "right": right,
    }


def ratios(found: Tracks, higher: Tracks) -> list[float | None]:
    """The shift of the time between flights over what geometry says of a court that is higher."""
    right = {impact.id: impact.values for impact in found.impacts}
    made = []
    for impact in higher.impacts:
        if impact.id in right:
            v_y1, v_y2, time = (right[impact.id][NINE.index(name)] for name in ("v_y1", "v_y2", "gap_time"))
            shift = impact.values[NINE.index("gap_time")] - time
            made.append(_short(float(shift / (WRONG * (1.0 / v_y1 + 1.0 / v_y2)))))
    return made


def fitted(found: Tracks, own: Mapping[str, float], rng: np.random.Generator) -> Row:
    """The fit of the impacts of a film, and the one of speeds by lines."""
    sure = [impact for impact in found.impacts if impact.sure]
    values = np.array([impact.values for impact in sure])
    errors = np.array([impact.covariance for impact in sure])
    row: Row = {"of": len(found.impacts), "rows": len(sure), "failed": "", "found": {}, "lines": {}}
    known = {name: Quantity(1.0 if name in ("scale", "clock") else 0.0, sd) for name, sd in CAMERA_SDS.items()}
    camera = Camera(known["scale"], known["clock"], known["tilt"], known["court_height"])
    choices = Choices(priors=PRIORS)
    sheet = {f"{name} [{SI_UNITS[name]}]": values[:, k].tolist() for k, name in enumerate(NINE)}
    try:
        problem = pose(sheet, choices, scene=Scene(camera=camera), covariance=errors, as_read=True)
        begun = {**own, **{name: quantity.value for name, quantity in known.items()}}
        _point, chosen = sampled(problem, begun, rng, DRAWS)
    except (FitError, TableError) as error:
        return {**row, "failed": str(error)}
    for name in FITTED:
        draws = chosen[:, problem.free_names.index(name)]
        reach = [np.quantile(draws, [0.5 - level / 2, 0.5 + level / 2]) for level in LEVELS]
        row["found"][name] = {
            "inside": [bool(low <= own[name] <= high) for low, high in reach],
            "sd": _short(float(np.std(draws)) / abs(own[name])),
            "off": _short(float(np.median(draws)) / own[name] - 1.0),
        }
    lines = np.array([five_frame_lines(impact) for impact in sure])
    speeds = values[:, :6].copy()
    speeds[:, [0, 1, 3, 4]] = lines
    usable = np.isfinite(speeds).all(axis=1) & (speeds[:, 1] > 0.5) & (speeds[:, 4] > 0.5) & (speeds[:, 0] > 0.0)
    plain = {f"{name} [{SI_UNITS[name]}]": speeds[usable, k].tolist() for k, name in enumerate(NINE[:6])}
    try:
        problem = pose(plain, Choices(), as_read=True)
        start = [[{**own, **NOISE}[name] for name in problem.free_names]]
        point = maximum_posterior(problem, np.array(start))
    except (FitError, TableError) as error:
        row["lines_failed"] = str(error)
        return row
    row["lines"] = {name: _short(point.values[name] / own[name] - 1.0) for name in BY_LINES}
    return row


def odd_against_even() -> Row:
    """The bundled film: speeds by the odd frames of each track against those by the even ones, in their errors."""
    whole = track("table_tennis_topspin").tracks
    halves = [estimate([_half(impact.track, k) for impact in whole.impacts], whole.filmed) for k in (0, 1)]
    one, other = ({impact.id: impact for impact in half.impacts} for half in halves)
    speeds = [NINE.index(name) for name in ("v_x1", "v_y1", "v_x2", "v_y2")]
    found = []
    for name in one.keys() & other.keys():
        a, b = one[name], other[name]
        # Errors that last are those of both halves.
        spread = np.sqrt(
            sum(
                np.diagonal(one.covariance) / half.noise[one.track.session].slow ** 2
                for one, half in zip((a, b), halves, strict=True)
            )
        )
        found.append([_short(float(z)) for z in ((a.values - b.values) / spread)[speeds]])
    slow = [noise.slow for noise in whole.noise.values()]
    return {"z": sorted(found, key=str), "slow": [_short(one) for one in slow], "of": len(whole.impacts)}


def _half(one: Track, first: int) -> Track:
    own = slice(first, None, 2)
    return replace(
        one, frame=one.frame[own], time=one.time[own], x=one.x[own], y=one.y[own],
        angle=None if one.angle is None else one.angle[own], radius=None if one.radius is None else one.radius[own],
        row=None if one.row is None else one.row[own], line=None if one.line is None else one.line[own],
    )  # fmt: skip


def _short(value: float) -> float | None:
    """As files keep it."""
    return float(f"{value:.4g}") if np.isfinite(value) else None


def study() -> Study:
    """Films of all cases in turn."""
    settings = {
        "cases": [[case.name, case.impacts, case.fitted] for case in CASES], "ball": dict(BALL),
        "priors": dict(PRIORS), "camera": dict(CAMERA_SDS), "wrong": WRONG,
    }  # fmt: skip
    return Study("tracks", replicate, settings, "tracks", "films")


def judge(records: Sequence[Sequence[Row]], seed: int) -> Verdict:
    """Do 68 and 95 % intervals of all nine hold so often, within binomial limits (all in 95 % of such studies;
    where the spin is not known they are wider than they have to be), are sure spins right and spins sure where frames
    are fast, do the controls fail, and do fits hold the truth?
    """
    rows = [row for one in records for row in one]
    kinds = {kind: [row for row in rows if row["kind"] == kind] for kind in ("film", STILL, HIGHER, "fit", "real")}
    coverage = [
        item for k in range(len(CASES)) for item in _coverage(k, [r for r in kinds["film"] if r["case"] == k])
    ]
    still = [item for k in range(len(CASES)) for item in _coverage(k, [r for r in kinds[STILL] if r["case"] == k])]
    spins = [item for k in range(len(CASES)) for item in _spins(k, [r for r in kinds["film"] if r["case"] == k])]
    fits = [item for k in range(len(CASES)) for item in _fits(k, [r for r in kinds["fit"] if r["case"] == k])]
    shifts = [one for row in kinds[HIGHER] for one in row["ratios"] if one is not None]
    real = [abs(z) < LEVELS[0.68] for row in kinds["real"] for one in row["z"] for z in one]
    limit = 0.05 / max(1, 2 * len(coverage))
    sure, wrong = sum(item["sure"] for item in spins), sum(item["wrong"] for item in spins)
    fast = [item for item in spins if item["fast"]]
    by_air = [item["in_68"] / item["of"] for item in still if item["quantity"] in ("v_x1", "v_y1")]
    height = float(np.median(shifts)) if shifts else float("nan")
    content: dict[str, Any] = {
        "seed": seed, "films": len(records), "coverage": coverage, "still_air": still, "spins": spins, "fits": fits,
        "height": height, "real": {"in_68": str(rate(real)), "slow": [s for r in kinds["real"] for s in r["slow"]]},
        "failed": sum(bool(row["failed"]) for row in kinds["fit"]),
        "holds": all(min(_chances(item)) > limit for item in coverage)
        and wrong <= max(3, SURE_WRONG * sure)
        and all(item["sure"] >= SURE_AT_LEAST * item["of"] for item in fast)
        and (not by_air or min(by_air) < STILL_AT_MOST)
        and (not shifts or abs(height - 1.0) < 0.02)
        and all(min(_chances(one)) > 0.05 / len(fits) for one in fits),
    }  # fmt: skip
    tables = {"coverage": coverage, "still_air": still, "spins": spins, "fits": fits}
    return Verdict(content, tables, _words(content))


def _coverage(case: int, rows: Sequence[Row]) -> list[dict[str, Any]]:
    impacts = [one for row in rows for one in row["impacts"]]
    made = []
    for k, name in enumerate(NINE):
        z = np.abs([one["z"][k] for one in impacts if one["z"][k] is not None])
        if not z.size:
            continue
        item: dict[str, Any] = {
            "case": CASES[case].name, "quantity": name, "unit": SI_UNITS[name], "of": int(z.size),
            "in_68": int((z < LEVELS[0.68]).sum()), "in_95": int((z < LEVELS[0.95]).sum()),
            "sd": _short(float(np.median([one["sd"][k] for one in impacts if one["sd"][k] is not None]))),
        }  # fmt: skip
        speeds = ("v_x1", "v_y1", "v_x2", "v_y2")
        off = [one["lines"][speeds.index(name)] for one in impacts] if name in speeds else []
        off = [one for one in off if one is not None]
        item["lines"] = _short(float(np.sqrt(np.mean(np.square(off))))) if off else None
        made.append(item)
    return made


def _spins(case: int, rows: Sequence[Row]) -> list[dict[str, Any]]:
    impacts = [one for row in rows for one in row["impacts"]]
    if not impacts:
        return []
    film = CASES[case].film
    return [{
        "case": CASES[case].name, "films": sum(row["of"] for row in rows), "of": len(impacts),
        "sure": sum(one["sure"] for one in impacts),
        "wrong": sum(one["sure"] and not one["right"] for one in impacts),
        "fast": film.fps >= 1000 and film.fold == 1,
    }]  # fmt: skip


def _fits(case: int, rows: Sequence[Row]) -> list[dict[str, Any]]:
    sound = [row for row in rows if not row["failed"]]
    made = []
    for name in FITTED if sound else ():
        own = [row["found"][name] for row in sound]
        lines = [row["lines"][name] for row in sound if name in row["lines"]]
        for place, level in enumerate(LEVELS):
            held = rate(one["inside"][place] for one in own)
            made.append({
                "case": CASES[case].name, "parameter": name, "level": level, "holds": held.count, "of": held.total,
                "low": held.low, "high": held.high, "sd": _short(float(np.median([one["sd"] for one in own]))),
                "off": _short(float(np.median([one["off"] for one in own]))),
                "lines_off": _short(float(np.median(lines))) if lines else None,
            })  # fmt: skip
    return made


def _chances(one: Mapping[str, Any]) -> list[float]:
    """The chances of so few intervals that hold."""
    held = [("in_68", 0.68), ("in_95", 0.95)] if "in_68" in one else [("holds", one["level"])]
    return [float(binom.cdf(one[key], one["of"], level)) for key, level in held]


def _words(content: Mapping[str, Any]) -> str:
    def share(one: Mapping[str, Any], key: str) -> str:
        return f"{100 * one[key] / one['of']:.0f} %"

    def number(value: float | None, factor: float = 1.0) -> str:
        return "" if value is None else f"{factor * value:.3g}"

    def held(one: Mapping[str, Any]) -> str:
        return f"{Rate(one['holds'], one['of'])} of {one['of']}"

    def block(items: Sequence[Mapping[str, Any]]) -> list[list[str]]:
        heads = ["film", "quantity", "in 68 %", "in 95 %", "of", "median sd", "error of 5-frame lines"]
        return [heads] + [
            [item["case"], f"{item['quantity']} [{item['unit']}]", share(item, "in_68"), share(item, "in_95"),
             str(item["of"]), number(item["sd"]), number(item["lines"])]
            for item in items
        ]  # fmt: skip

    spins = [["film", "impacts", "found", "spins sure", "of these wrong"]] + [
        [item["case"], str(item["films"]), str(item["of"]), str(item["sure"]), str(item["wrong"])]
        for item in content["spins"]
    ]
    fits = [
        ["films of 21", "parameter", "level", "contain the truth", "median sd", "median error", "by 5-frame lines"]
    ]
    fits += [
        [one["case"], one["parameter"], f"{100 * one['level']:.0f} %", held(one),
         number(one["sd"], 100) + " %", number(one["off"], 100) + " %",
         "" if one["lines_off"] is None else number(one["lines_off"], 100) + " %"]
        for one in content["fits"]
    ]  # fmt: skip
    real, parts = content["real"], []
    if content["coverage"]:
        parts += ["Intervals of impacts:", "", *columns(block(content["coverage"]), 2), ""]
    if content["still_air"]:
        parts += [f"Control, {STILL} (must not hold):", "", *columns(block(content["still_air"]), 2), ""]
    parts += [*columns(spins, 1), ""] if content["spins"] else []
    parts += ["Sds and errors are shares of the value.", "", *columns(fits, 3), ""] if content["fits"] else []
    last = (
        f"A court 1 mm too high moves gap_time by {content['height']:.3f} of what geometry says. Table tennis, odd "
        f"against even frames: {real['in_68']} within one sd; factor of slow errors {real['slow']}. "
        f"Fits that failed: {content['failed']}."
    )
    return "\n".join([*parts, last]) + "\n"
