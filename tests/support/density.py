"""A posterior written out: priors by scipy.stats, one rebound at a time, whole covariances. Slow
and obvious.
"""

import re

import numpy as np
from scipy import stats

from fitball.base.columns import COLUMNS
from fitball.base.values import Ball, Impacts
from fitball.data.scene import BallSection, CameraSection, Scene, ValueWithSd
from fitball.data.table import ImpactTable
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.models.registry import model

# The ball that is simulated: that of the thesis.
BALL = Ball(0.0576, 0.03302, 0.56)
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
    "row_delay": 6e-4,
    "ball_mass": 0.0575,
    "inertia_ratio": 0.555,
    "speed_sd": 0.2,
    "angle_sd": 0.02,
}
# What impacts of a camera share.
CAMERA = ("scale", "clock", "tilt", "court_height", "row_delay")
# Standard gravity [m/s^2].
G = 9.80665
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
# The largest correlations of stated errors, by pair of columns.
CORRELATIONS = {
    "v_x1,v_x2": 0.6,
    "omega_1,omega_2": -0.5,
    "v_x2,v_y2": 0.3,
    "v_x1,v_y1": 0.4,
}
INCIDENT = ("v_x1", "v_y1", "omega_1")
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
    two_mass = model("two-mass", ball=BALL)
    parameters = {spec.name: TRUTH[spec.name] for spec in two_mass.parameters}
    rebound = two_mass.rebound(parameters, Impacts(*values.values()))
    for name in columns:
        noise = TRUTH[COLUMNS[name].noise.name]
        values[name] = rebound.column(name) + noise * rng.standard_normal(count)
    if gaps:
        for k, name in enumerate(columns):
            values[name][k % 3 :: 4] = np.nan
    stated = {"": (), "sd": columns, "corr": (*values,)}[errors]
    sd = {}
    for name in stated:
        missing = np.isnan(values[name])
        stated_sd = SDS[name] * rng.uniform(0.5, 1.5, count)
        sd[name] = np.where(missing, np.nan, stated_sd)
    corr = {}
    if errors == "corr":
        for pair, r in CORRELATIONS.items():
            corr[pair] = r * rng.uniform(0.5, 1.0, count)
        if "gap_path" in columns:
            corr["v_y1,gap_path"] = np.full(count, 0.5)
    texts = {"id": tuple(str(k + 1) for k in range(count))}
    for name in labels:
        texts[name] = tuple("ab"[k % 2] for k in range(count))
    return ImpactTable("made", values, sd, corr, texts)


def scene_of(camera=False, time=False, ball=False):
    """A scene that states the errors of a camera, the contact time, the ball, or none of them."""
    camera_section = None
    if camera:
        camera_section = CameraSection(
            scale=ValueWithSd(1.0, 0.01),
            clock=ValueWithSd(1.0, 0.001),
            tilt=ValueWithSd(0.0, 0.005),
            court_height=ValueWithSd(0.0, 0.003),
        )
    ball_section = BallSection(inertia_ratio=BALL.inertia_ratio)
    if ball:
        ball_section = BallSection(
            mass=ValueWithSd(0.0577, 2e-4),
            inertia_ratio=ValueWithSd(BALL.inertia_ratio, 0.01),
        )
    return Scene(
        camera=camera_section,
        contact_time=ValueWithSd(5e-3, 5e-4) if time else None,
        ball=ball_section,
    )


def problem_of(table, scene=None, text="grip-slip", **choices):
    """The problem of a table with a scene, by default that of the ball of TRUTH, and a model."""
    scene = scene or Scene(ball=BallSection(inertia_ratio=BALL.inertia_ratio))
    return build_problem(table, scene, Choices(text, **choices))


def truth_of(problem):
    """Values of its free parameters near TRUTH; levels lie apart."""
    values = {}
    for k, name in enumerate(problem.free):
        parameter, bracket, _ = name.partition("[")
        values[name] = TRUTH[parameter]
        if bracket:
            values[name] *= 1.0 + 0.02 * (k % 3)
    return values


def near(problem, count=3, reach=0.1, seed=1):
    """Coordinates (count, free) within `reach` widths of the truth."""
    prior = problem.prior
    truth = problem.coordinates(truth_of(problem))
    steps = np.random.default_rng(seed).standard_normal((count, truth.size))
    moved = truth + reach * prior.width * steps
    return np.clip(moved, prior.low + 1e-12, prior.high)


def log_prior(spec, text, value):
    """Log density of a prior in words with respect to its coordinate, truncated by the bounds of
    its spec.
    """
    family, numbers = re.fullmatch(r"([\w-]+)\((.*)\)", text).groups()
    a, b = map(float, (numbers + ",0").split(",")[:2])
    low = spec.lower
    high = spec.upper
    if family in ("beta", "gamma"):
        law = stats.beta(a, b) if family == "beta" else stats.gamma(a, scale=b)
        # From the density of the value to that of its coordinate.
        stretch = value * (1.0 - value) if family == "beta" else value
        return law.logpdf(value) + np.log(stretch) - np.log(law.cdf(high) - law.cdf(low))
    if family.startswith("log"):
        value = np.log(value)
        a = np.log(a)
        high = np.log(high)
        low = np.log(low) if low > 0.0 else -np.inf
        if family == "loguniform":
            b = np.log(b)
    if family.endswith("uniform"):
        low = max(low, a)
        high = min(high, b)
        return stats.uniform(low, high - low).logpdf(value)
    if family == "half-t":
        law = stats.t(b, 0.0, a)
    elif family == "half-normal":
        law = stats.norm(0.0, a)
    else:
        law = stats.norm(a, b)
    if family.startswith("half"):
        low = max(low, 0.0)
    if not low <= value <= high:
        return -np.inf
    return law.logpdf(value) - np.log(law.cdf(high) - law.cdf(low))


def log_prior_of_levels(problem, level, values):
    """The mean over 64 quantiles of the spread of a normal density with that spread and a common
    value.
    """
    parameters = problem.forward.model.parameters
    spec = next(spec for spec in parameters if spec.name == level.parameter)
    prior = problem.prior_texts[level.parameter]
    family, *numbers = re.fullmatch(r"(\w+)\((.*), (.*)\)", prior).groups()
    location, width = map(float, numbers)
    prior_of_spread = problem.prior_texts[f"{level.parameter}_spread"]
    scale, freedom = map(float, re.findall(r"\((.*), (.*)\)", prior_of_spread)[0])
    q = np.array([values[level.name(label)] for label in level.labels])
    if family == "lognormal":
        q = np.log(q)
        centre = np.log(location)
        general = 0.3
    else:
        assert family == "normal"
        centre = location
        ends = [(end - centre) / width for end in (spec.lower, spec.upper)]
        general = 0.3 * float(stats.truncnorm.ppf(0.5, *ends, centre, width))
    law = stats.t(freedom, 0.0, scale)
    most = law.cdf(20.0 * general) - 0.5
    spreads = law.ppf(0.5 + most * (np.arange(64) + 0.5) / 64)
    count = len(level.labels)
    mean = np.full(count, centre)
    densities = []
    for spread in spreads:
        covariance = spread**2 * np.eye(count) + width**2
        densities.append(stats.multivariate_normal(mean, covariance).pdf(q))
    return np.log(np.mean(densities))


def camera_errors(problem, values, k):
    """Scale, clock, tilt, height of the court and row delay in the session of the k-th impact."""
    errors = dict.fromkeys(CAMERA, 0.0) | {"scale": 1.0, "clock": 1.0}
    session = ""
    if "session" in problem.table.labels:
        session = problem.table.labels["session"][k]
    for key in errors:
        of_session = values.get(f"{key}[{session}]", errors[key])
        errors[key] = values.get(key, of_session)
    return errors.values()


def seen_by(problem, values, k, state):
    """What the camera shows of the rebound of the k-th impact at a measured state, by column; None
    without one.
    """
    parameters = {spec.name: values.get(spec.name) for spec in problem.forward.model.parameters}
    for name in ("ball_mass", "ball_radius", "inertia_ratio"):
        if name in values:
            parameters[name] = values[name]
    for level in problem.forward.levels:
        label = problem.table.labels[level.column][k]
        parameters[level.parameter] = values[level.name(label)]
    scale, clock, tilt, height, delay = camera_errors(problem, values, k)
    cos = np.cos(tilt)
    sin = np.sin(tilt)
    turn = np.array([[cos, -sin], [sin, cos]])
    # While the ball lands or rises, rows are read earlier or later than they seem to be.
    longer = 1.0 + delay * state[1]
    slower = np.array([0.0, G * height / state[1]])
    v_x1, v_y1 = scale / clock * turn @ (state[:2] - slower) / longer
    omega_1 = state[2] / clock / longer
    if v_y1 <= 0.0 or state[1] <= 0.0:
        return None
    rebound = problem.forward.model.evaluate(
        tuple(parameters),
        np.array([[*parameters.values()]]),
        Impacts(np.array([v_x1]), np.array([v_y1]), np.array([omega_1])),
    )
    if rebound.status[0, 0]:
        return None
    v_x2, v_y2 = clock / scale * turn @ [rebound.v_x2[0, 0], rebound.v_y2[0, 0]]
    path = rebound.gap_path[0, 0] / scale
    v_y2 += G * height / v_y2
    longer = 1.0 + delay * v_y2
    v_x2 /= longer
    v_y2 /= longer
    omega_2 = clock * rebound.omega_2[0, 0] / longer
    # Flights are cut at the height that was assumed: that much earlier and later.
    earlier = height / state[1]
    later = (height + path * sin) / v_y2
    return {
        "v_x2": v_x2,
        "v_y2": v_y2,
        "v_2": np.hypot(v_x2, v_y2),
        "theta_2": np.arctan2(v_y2, v_x2),
        "omega_2": omega_2,
        "contact_time": rebound.contact_time[0, 0],
        "gap_time": rebound.gap_time[0, 0] / clock - earlier - later + delay * path * sin,
        "gap_path": path * cos - earlier * state[0] - later * v_x2,
        "gap_turn": rebound.gap_turn[0, 0] - earlier * state[2] - later * omega_2,
    }


def covariance_of(table, columns, k, without=()):
    """Stated errors of (v_x1, v_y1, omega_1, *columns) of the k-th impact."""
    names = [*INCIDENT, *columns]
    sds = np.zeros(len(names))
    for i, name in enumerate(names):
        if name in table.sd:
            sds[i] = np.nan_to_num(table.sd[name][k])
    matrix = np.diag(sds**2)
    if "correlations" in without:
        return matrix
    for pair, values in table.corr.items():
        first, second = pair.split(",")
        if first in names and second in names:
            i = names.index(first)
            j = names.index(second)
            matrix[i, j] = values[k] * sds[i] * sds[j]
            matrix[j, i] = matrix[i, j]
    return matrix


def log_normal(deviation, covariance):
    """Log density of a normal distribution about zero."""
    if not deviation.size:
        return 0.0
    # Units differ by powers of ten, which scipy takes for a singular matrix.
    unit = np.sqrt(np.diag(covariance))
    law = stats.multivariate_normal(np.zeros(unit.size), covariance / np.outer(unit, unit))
    return law.logpdf(deviation / unit) - np.log(unit).sum()


def log_student(deviation, scale, freedom):
    """Log density of independent Student-t variables, made dependent by the Cholesky factor of
    `scale`.
    """
    factor = np.linalg.cholesky(scale)
    z = np.linalg.solve(factor, deviation)
    return np.sum(stats.t(freedom).logpdf(z) - np.log(np.diag(factor)))


def over_true_states(problem, values, k, used, stated):
    """Mean and covariance of the rebound of the k-th impact over its true states, by sigma points.

    `stated` is the covariance of the stated errors of impact and rebound.
    """
    table = problem.table
    state = np.array([getattr(table.impacts, name)[k] for name in INCIDENT])
    of_impact = stated[:3, :3]
    across = stated[3:, :3]
    # Scaled, since units differ by powers of ten.
    unit = np.sqrt(np.diag(of_impact))
    sizes, vectors = np.linalg.eigh(of_impact / np.outer(unit, unit))
    follows = across @ np.linalg.inv(of_impact)
    points = []
    for sign in (1.0, -1.0):
        for axis in range(3):
            step = sign * np.sqrt(3.0 * sizes[axis]) * unit * vectors[:, axis]
            seen = seen_by(problem, values, k, state + step)
            if seen is not None:
                rebound = np.array([seen[name] for name in used])
                points.append(rebound - follows @ step)
    mean = np.mean(points, axis=0)
    apart = np.array(points) - mean
    spread = apart.T @ apart / len(points)
    return mean, stated[3:, 3:] - follows @ across.T + spread


def log_priors(problem, values):
    """Log density of the free parameters that are at no level."""
    levels = problem.forward.levels
    at_levels = {level.name(label) for level in levels for label in level.labels}
    total = 0.0
    for parameter in problem.parameters:
        name = parameter.spec.name
        if parameter.fixed is None and name not in at_levels:
            total += log_prior(parameter.spec, parameter.prior.text, values[name])
    return total


def log_likelihood_of(problem, values, used_values, k, without):
    """Log density of the rebound of the k-th impact, and its contact time; None and None without an
    answer. The ball and the camera have `used_values`, the noise `values`.
    """
    table = problem.table
    state = np.array([getattr(table.impacts, name)[k] for name in INCIDENT])
    seen = seen_by(problem, used_values, k, state)
    if seen is None:
        return None, None
    columns = [observable.column.name for observable in problem.observables]
    used = [name for name in columns if np.isfinite(table.values[name][k])]
    stated = covariance_of(table, used, k, without)
    mean = np.array([seen[name] for name in used])
    covariance = stated[3:, 3:]
    if stated[:3, :3].any() and "errors" not in without:
        mean, covariance = over_true_states(problem, used_values, k, used, stated)
    scatter = np.array([values[COLUMNS[name].noise.name] for name in used])
    covariance = covariance + np.diag(scatter**2)
    deviation = np.array([table.values[name][k] for name in used]) - mean
    if problem.forward.noise.name == "normal":
        density = log_normal(deviation, covariance)
    else:
        density = log_student(deviation, covariance, values["degrees_of_freedom"])
    return density, seen["contact_time"]


def log_posterior(problem, values, without=()):
    """Log posterior density at values by name; -inf without an answer.

    Parts may be left out to see that they matter. `without` names them: "priors", "levels",
    "camera", "errors", "correlations", "contact time".
    """
    fixed = {}
    for parameter in problem.parameters:
        if parameter.fixed is not None:
            fixed[parameter.spec.name] = parameter.fixed
    values = {**fixed, **values}
    total = 0.0
    if "priors" not in without:
        total += log_priors(problem, values)
    if "levels" not in without:
        for level in problem.forward.levels:
            total += log_prior_of_levels(problem, level, values)
    used_values = without_camera(values) if "camera" in without else values
    times = []
    for k in range(len(problem.table)):
        density, contact_time = log_likelihood_of(problem, values, used_values, k, without)
        if density is None:
            return -np.inf
        total += density
        times.append(contact_time)
    if problem.contact_time is not None and "contact time" not in without:
        total += stats.norm(*problem.contact_time).logpdf(np.mean(times))
    return total


def without_camera(values):
    """Values but those of a camera."""
    return {name: value for name, value in values.items() if name.partition("[")[0] not in CAMERA}
