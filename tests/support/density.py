"""A posterior written out: priors by scipy.stats, one rebound at a time, whole covariances. Slow
and obvious.
"""

import re

import numpy as np
from scipy import stats

from fitball.base.columns import COLUMNS
from fitball.base.values import Impacts
from fitball.data.scene import BallSection, CameraSection, Quantity, Scene
from fitball.data.table import ImpactTable
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.models.registry import model

TRUTH = {
    "mass_ratio": 0.88,
    "k_y": 2.0e4,
    "k_theta": 19.0,
    "mu": 0.56,
    "eps_10": 2.4e-3,
    "eps_slope": 1e-5,
    "cor_10": 0.774,
    "cor_slope": -0.0151,
    "e_x": 0.1,
    "offset": 2e-3,
    "degrees_of_freedom": 7.0,
    "v_x_sd": 0.21,
    "v_y_sd": 0.17,
    "spin_sd": 6.0,
    "contact_time_sd": 1.5e-4,
    "gap_time_sd": 1e-4,
    "gap_path_sd": 1e-3,
    "gap_turn_sd": 0.03,
    "scale": 1.004,
    "clock": 0.9995,
    "tilt": 4e-3,
    "court_height": 1.2e-3,
    "ball_mass": 0.0575,
    "inertia_ratio": 0.555,
    "speed_sd": 0.2,
    "angle_sd": 0.02,
}
SDS = {
    "v_x1": 0.06,
    "v_y1": 0.05,
    "omega_1": 3.0,
    "v_x2": 0.05,
    "v_y2": 0.06,
    "omega_2": 4.0,
    "contact_time": 1e-4,
    "gap_time": 8e-5,
    "gap_path": 7e-4,
    "gap_turn": 0.02,
}
REBOUND = ("v_x2", "v_y2", "omega_2")
TIMED = (*REBOUND, "contact_time", "gap_time", "gap_path", "gap_turn")


def table_of(columns, errors="", gaps=False, labels=(), count=10, seed=0):
    """Impacts of a ball of TRUTH that scatters, with stated `errors` ("", "sd", "corr"), `gaps` in
    columns.
    """
    rng = np.random.default_rng(seed)
    speed = rng.uniform(12.0, 22.0, count)
    angle = np.radians(np.linspace(18.0, 62.0, count))
    values = {
        "v_x1": speed * np.cos(angle),
        "v_y1": speed * np.sin(angle),
        "omega_1": rng.uniform(-150, 200, count),
    }
    chosen = model("two-mass")
    made = chosen.rebound(
        {s.name: TRUTH[s.name] for s in chosen.parameters},
        Impacts(*values.values()),
    )
    for name in columns:
        noise = COLUMNS[name].noise.name
        values[name] = made.column(name) + TRUTH[noise] * rng.standard_normal(count)
    if gaps:
        for k, name in enumerate(columns):
            values[name][k % 3 :: 4] = np.nan
    stated = {"": (), "sd": columns, "corr": (*values,)}[errors]
    sd = {
        name: np.where(np.isnan(values[name]), np.nan, SDS[name] * rng.uniform(0.5, 1.5, count))
        for name in stated
    }
    pairs = (
        {"v_x1,v_x2": 0.6, "omega_1,omega_2": -0.5, "v_x2,v_y2": 0.3, "v_x1,v_y1": 0.4}
        if errors == "corr"
        else {}
    )
    corr = {pair: r * rng.uniform(0.5, 1.0, count) for pair, r in pairs.items()}
    if pairs and "gap_path" in columns:
        corr["v_y1,gap_path"] = np.full(count, 0.5)
    texts = {"id": tuple(str(k + 1) for k in range(count))}
    texts |= {name: tuple("ab"[k % 2] for k in range(count)) for name in labels}
    return ImpactTable("made", values, sd, corr, texts)


def scene_of(camera=False, time=False, ball=False):
    """A scene that states these."""
    known = {
        "scale": (1.0, 0.01),
        "clock": (1.0, 0.001),
        "tilt": (0.0, 0.005),
        "court_height": (0.0, 0.003),
    }
    seen = CameraSection(**{key: Quantity(*both) for key, both in known.items()})
    return Scene(
        camera=seen if camera else None,
        contact_time=Quantity(5e-3, 5e-4) if time else None,
        ball=BallSection(mass=Quantity(0.0577, 2e-4), inertia_ratio=Quantity(0.56, 0.01))
        if ball
        else BallSection(),
    )


def problem_of(table, scene=None, text="grip-slip", **choices):
    """A problem of that table."""
    return build_problem(table, scene or Scene(), Choices(text, **choices))


def truth_of(problem):
    """Values of its free parameters near TRUTH; levels lie apart."""
    found = {}
    for k, name in enumerate(problem.free):
        found[name] = TRUTH[name.partition("[")[0]] * (1.0 + 0.02 * (k % 3) * ("[" in name))
    return found


def near(problem, count=3, reach=0.1, seed=1):
    """Coordinates (count, free) within `reach` widths of the truth."""
    at = problem.coordinates(truth_of(problem))
    moved = at + reach * problem.prior.width * np.random.default_rng(seed).standard_normal(
        (count, at.size)
    )
    return np.clip(moved, problem.prior.low + 1e-12, problem.prior.high)


def log_prior(spec, text, value):
    """Of a prior in words, with respect to its coordinate, truncated by the bounds of its spec."""
    family, numbers = re.fullmatch(r"([\w-]+)\((.*)\)", text).groups()
    a, b = map(float, (numbers + ",0").split(",")[:2])
    low = spec.lower
    high = spec.upper
    if family.startswith("log"):
        value = np.log(value)
        a = np.log(a)
        high = np.log(high)
        low = np.log(low) if low > 0.0 else -np.inf
        b = np.log(b) if family == "loguniform" else b
    if family.endswith("uniform"):
        low = max(low, a)
        high = min(high, b)
        return stats.uniform(low, high - low).logpdf(value)
    bell = {"half-t": stats.t(b, 0.0, a), "half-normal": stats.norm(0.0, a)}.get(
        family
    ) or stats.norm(a, b)
    low = max(low, 0.0) if family.startswith("half") else low
    return (
        bell.logpdf(value) - np.log(bell.cdf(high) - bell.cdf(low))
        if low <= value <= high
        else -np.inf
    )


def log_prior_of_levels(problem, level, values):
    """The mean over 64 quantiles of the spread of a normal density with that spread and a common
    value.
    """
    spec = next(s for s in problem.forward.model.parameters if s.name == level.parameter)
    family, a, b = re.fullmatch(r"(\w+)\((.*), (.*)\)", problem.known[level.parameter]).groups()
    scale, freedom = map(
        float,
        re.findall(r"\((.*), (.*)\)", problem.known[f"{level.parameter}_spread"])[0],
    )
    log = family == "lognormal"
    assert log or family == "normal"
    centre = np.log(float(a)) if log else float(a)
    ends = ((end - centre) / float(b) for end in (spec.lower, spec.upper))
    general = 0.3 if log else 0.3 * float(stats.truncnorm.ppf(0.5, *ends, centre, float(b)))
    half = stats.t(freedom, 0.0, scale)
    most = half.cdf(20.0 * general) - 0.5
    spreads = half.ppf(0.5 + most * (np.arange(64) + 0.5) / 64)
    q = np.array([values[level.name(label)] for label in level.labels])
    q = np.log(q) if log else q
    count = len(level.labels)
    each = [
        stats.multivariate_normal(
            np.full(count, centre),
            tau**2 * np.eye(count) + float(b) ** 2,
        ).pdf(q)
        for tau in spreads
    ]
    return np.log(np.mean(each))


def seen_by(problem, values, k, state):
    """What the camera shows of the rebound of the k-th impact at a measured state, by column; None
    without one.
    """
    own = {s.name: values.get(s.name) for s in problem.forward.model.parameters}
    own |= {
        name: values[name]
        for name in ("ball_mass", "ball_radius", "inertia_ratio")
        if name in values
    }
    for level in problem.forward.levels:
        own[level.parameter] = values[level.name(problem.table.labels[level.column][k])]
    camera = {"scale": 1.0, "clock": 1.0, "tilt": 0.0, "court_height": 0.0}
    session = problem.table.labels.get("session", ("",) * (k + 1))[k]
    for key in camera:
        camera[key] = values.get(key, values.get(f"{key}[{session}]", camera[key]))
    s, c, tau, h = camera.values()
    turn = np.array([[np.cos(tau), -np.sin(tau)], [np.sin(tau), np.cos(tau)]])
    v_1 = s / c * turn @ state[:2]
    omega_1 = state[2] / c
    if v_1[1] <= 0.0 or state[1] <= 0.0:
        return None
    names = tuple(own)
    made = problem.forward.model.evaluate(
        names,
        np.array([[own[n] for n in names]]),
        Impacts(*(np.array([one]) for one in (*v_1, omega_1))),
    )
    if made.status[0, 0]:
        return None
    v_2 = c / s * turn @ [made.v_x2[0, 0], made.v_y2[0, 0]]
    omega_2 = c * made.omega_2[0, 0]
    found = {
        "v_x2": v_2[0],
        "v_y2": v_2[1],
        "v_2": np.hypot(*v_2),
        "theta_2": np.arctan2(*v_2[::-1]),
    }
    found["omega_2"] = omega_2
    path = made.gap_path[0, 0] / s
    r = h + made.gap_path[0, 0] / s * np.sin(tau)
    found["contact_time"] = made.contact_time[0, 0]
    found["gap_time"] = made.gap_time[0, 0] / c - h / state[1] - r / v_2[1]
    found["gap_path"] = path * np.cos(tau) - h * state[0] / state[1] - r * v_2[0] / v_2[1]
    found["gap_turn"] = made.gap_turn[0, 0] - h * state[2] / state[1] - r * omega_2 / v_2[1]
    return found


def covariance_of(table, columns, k, without=()):
    """Stated errors of (v_x1, v_y1, omega_1, *columns) of the k-th impact."""
    names = ["v_x1", "v_y1", "omega_1", *columns]
    sds = np.array([np.nan_to_num(table.sd[n][k]) if n in table.sd else 0.0 for n in names])
    matrix = np.diag(sds**2)
    for pair, values in table.corr.items():
        if {*pair.split(",")} <= {*names} and "correlations" not in without:
            i, j = map(names.index, pair.split(","))
            matrix[i, j] = matrix[j, i] = values[k] * sds[i] * sds[j]
    return matrix


def log_posterior(problem, values, without=()):
    """At values by name; -inf without an answer. Parts are left `without`, to see that they matter:
    "priors", "levels", "camera", "errors", "correlations", "contact time".
    """
    table = problem.table
    at_levels = {level.name(label) for level in problem.forward.levels for label in level.labels}
    values = {
        item.spec.name: item.fixed for item in problem.parameters if item.fixed is not None
    } | values
    ours = ("scale", "clock", "tilt", "court_height") if "camera" in without else ()
    known = {name: value for name, value in values.items() if name.partition("[")[0] not in ours}
    total = 0.0
    for item in problem.parameters:
        if item.fixed is None and item.spec.name not in at_levels and "priors" not in without:
            total += log_prior(item.spec, item.prior.text, values[item.spec.name])
    for level in problem.forward.levels if "levels" not in without else ():
        total += log_prior_of_levels(problem, level, values)
    columns = [item.column.name for item in problem.observables]
    times = []
    for k in range(len(table)):
        read = np.array([getattr(table.impacts, name)[k] for name in ("v_x1", "v_y1", "omega_1")])
        centre = seen_by(problem, known, k, read)
        if centre is None:
            return -np.inf
        times.append(centre["contact_time"])
        used = [name for name in columns if np.isfinite(table.values[name][k])]
        stated = covariance_of(table, used, k, without)
        u = stated[:3, :3]
        across = stated[3:, :3]
        own = stated[3:, 3:]
        if "errors" in without:
            u = np.zeros((3, 3))
            across = 0.0 * across
        mean = np.array([centre[name] for name in used])
        if u.any():
            # Scaled, since units differ by powers of ten.
            unit = np.sqrt(np.diag(u))
            sizes, vectors = np.linalg.eigh(u / np.outer(unit, unit))
            follows = across @ np.linalg.inv(u)
            points = []
            for sign in (1.0, -1.0):
                for axis in range(3):
                    t = sign * np.sqrt(3.0 * sizes[axis]) * unit * vectors[:, axis]
                    made = seen_by(problem, known, k, read + t)
                    if made is not None:
                        points.append(np.array([made[name] for name in used]) - follows @ t)
            mean = np.mean(points, axis=0)
            own = (
                own
                - follows @ across.T
                + (np.array(points) - mean).T @ (np.array(points) - mean) / len(points)
            )
        scatter = np.array([values[COLUMNS[name].noise.name] for name in used])
        whole = own + np.diag(scatter**2)
        gap = np.array([table.values[name][k] for name in used]) - mean
        if problem.forward.noise.name == "normal":
            # Units differ by powers of ten, which scipy takes for a singular matrix.
            unit = np.sqrt(np.diag(whole))
            density = stats.multivariate_normal(np.zeros(len(used)), whole / np.outer(unit, unit))
            total += density.logpdf(gap / unit) - np.log(unit).sum() if used else 0.0
        else:
            factor = np.linalg.cholesky(whole)
            z = np.linalg.solve(factor, gap)
            total += np.sum(
                stats.t(values["degrees_of_freedom"]).logpdf(z) - np.log(np.diag(factor))
            )
    if problem.contact_time is not None and "contact time" not in without:
        total += stats.norm(*problem.contact_time).logpdf(np.mean(times))
    return total
