"""Tables, problems and compositions that several tests share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fitball.api import calibrating, pose
from fitball.data.read import load_table
from fitball.data.scene import Scene, load_scene
from fitball.data.table import ImpactTable, Measurement
from fitball.inference.identifiability import examine
from fitball.inference.point import point_fit
from fitball.inference.problem.build import Choices, build_problem
from fitball.report.saved.fit_file import load, read_fit

# Seconds after which a process is taken to hang: no measure of how fast a machine is.
HANG = 900.0

# Model and closures: every closure at least once.
COMPOSITIONS = [
    ("two-mass", {}),
    ("thesis-exact", {}),
    ("two-mass", {"torsion": "free"}),
    ("two-mass", {"normal": "total", "release": "zero_displacement"}),
    ("two-mass", {"normal": "inner"}),
    ("two-mass", {"spin": "shell", "offset": "grip"}),
    ("two-mass", {"cor": "mean"}),
    ("two-mass", {"cor": "measured"}),
    ("two-mass", {"cor": "saturating"}),
    ("thesis-exact", {"cor": "saturating", "release": "zero_force", "normal": "total"}),
    ("thesis-exact", {"inertia": "table", "torsion": "free"}),
    ("thesis-exact", {"offset": "contact", "release": "zero_force"}),
    ("two-mass", {"torsion": "rigid"}),
    ("two-mass", {"torsion": "rigid", "offset": "grip"}),
    ("thesis-exact", {"torsion": "rigid"}),
]
# Parameters near those of Wang's balls.
GRIP_SLIP = {
    "mu": 0.55, "e_x": 0.1, "offset": 2e-3, "cor_10": 0.76, "cor_slope": -0.013, "velocity_sd": 0.25, "spin_sd": 10.0,
    "v_x_sd": 0.25, "v_y_sd": 0.25,
}  # fmt: skip
TWO_MASS = {
    "mass_ratio": 0.87, "k_y": 1.9e4, "k_theta": 15.0, "mu": 0.55, "eps_10": 2.5e-3, "eps_slope": 0.0,
    "cor_10": 0.775, "cor_slope": -0.0145, "velocity_sd": 0.25, "spin_sd": 11.0,
    "v_x_sd": 0.25, "v_y_sd": 0.25,
}  # fmt: skip
# Speeds and angles, whose spread depends on the parameters.
POLAR = (
    "id,v_1 [m/s],theta_1 [deg],omega_1 [rpm],v_2 [m/s],theta_2 [deg],omega_2 [rpm]\n"
    "a,17,18,0,12.2,20,2400\nb,17,27,50,10.7,34,2700\nc,16.4,38,0,10.7,45,2500\nd,16.4,52,-30,11,59,1900\n"
)


def search_briefly(patch):
    """Fits are searched from few starts, and nothing is looked at twice: profiles of the shortest tables alone, no
    other assumptions. For tests that look at what a fit is put into; others look at all of these.
    """
    run = calibrating.run
    patch.setattr(calibrating, "run", lambda *a, **k: run(*a, **k | {"assumptions": False}))
    patch.setattr(point_fit, "STARTS", 3)
    patch.setattr(examine, "PROFILED", 4)


def leave_out_figures(patch, but=()):
    """Results are saved without their figures, most of the time a save takes: for tests that look at other files."""
    patch.setattr("fitball.report.figures.registry.drawable_kinds", lambda _fit: [*but])


def restored(folder):
    """A fit read back with all the files beside it."""
    fit = read_fit(folder)
    load(fit)
    return fit


def save_without_figures(fit, folder):
    """Save a fit but for its figures."""
    return fit.save(folder, figures=False)


def polar_problem(folder):
    place = folder / "polar.csv"
    place.write_text(POLAR, encoding="utf-8")
    return build_problem(load_table(place), load_scene(place), Choices(model="grip-slip"))


def problem_of(table, model=None, *, scene=None, without=(), force=None, **choices):
    """The problem of a table, or of the path or bundled name of one, in the scene beside it. A table that was made
    here has none: only the table is known. The scene says nothing of what it is to be `without`.
    """
    if scene is None:
        scene = Scene() if isinstance(table, ImpactTable) else load_scene(table)
    scene = replace(scene, **dict.fromkeys(without))
    return pose(table, Choices(model=model, **choices), scene=scene, force=force)


def same_values(one, other):
    """Frozen values, mappings and arrays that are equal to the last bit."""
    if hasattr(one, "__dataclass_fields__"):
        assert type(one) is type(other)
        for name in one.__dataclass_fields__:
            same_values(getattr(one, name), getattr(other, name))
    elif isinstance(one, Mapping):
        assert one.keys() == other.keys()
        for name, item in one.items():
            same_values(item, other[name])
    elif isinstance(one, tuple | list):
        assert len(one) == len(other)
        for item, its in zip(one, other, strict=True):
            same_values(item, its)
    elif isinstance(one, np.ndarray):
        np.testing.assert_array_equal(one, other)
    else:
        assert one == other


def coordinates_of(problem, truth):
    return problem.to_coordinates(np.array([[truth[name] for name in problem.free_names]]))[0]


def drop_table(rng, count=9, noise=0.05):
    table = load_table("wang_zero_spin.csv")
    speeds = np.linspace(3.0, 16.0, count)
    rebound = (0.76 - 0.014 * (speeds - 10.0)) * speeds + noise * rng.standard_normal(count)
    return replace(
        table,
        impacts=type(table.impacts)(np.zeros(count), speeds, np.zeros(count)),
        incident_columns=("v_y1",),
        measurements=(Measurement("v_y2", rebound),),
        redundant=(),
        ids=tuple(f"d{k}" for k in range(count)),
        labels={},
        notices=(),
    )


def linear_problem(table, **scene):
    flat = {"cor_10": "uniform(0, 1)", "cor_slope": "uniform(-0.1, 0.1)"}
    return build_problem(table, Scene(**scene), Choices(model="brody", priors=flat, pool={"all": "none"}))


def synthetic(problem, truth, seed=None):
    """The problem with rebounds as the model makes them from `truth`, with noise when there is a seed."""
    rebound = problem.rebound(np.array([[truth[name] for name in problem.free_names]]))
    made = []
    for observable in problem.observables:
        values = observable.predict(rebound)[0]
        if seed is not None:
            rng = np.random.default_rng([seed, len(made)])
            values = values + truth[observable.noise] * rng.standard_normal(values.size)
        made.append(Measurement(observable.name, values))
    table = replace(problem.table, measurements=tuple(made), redundant=())
    return build_problem(table, problem.scene, Choices(model=problem.model.name))


# A hard sphere of 2.5 mm on glass (Kharaz, Gorham and Salman 2001), all lengths scaled to 33 mm with R omega kept.
HARD_SPHERE = (
    "v_x1 [m/s],v_y1 [m/s],omega_1 [rad/s],v_x2 [m/s],v_y2 [m/s],omega_2 [rad/s]\n"
    "0.6434,3.8466,0,0.4327,3.8081,17.1061\n1.3346,3.6645,0,0.7967,3.6279,40.9091\n"
    "1.9575,3.3732,0,1.3459,3.3394,46.1515\n2.4745,3.0144,0,1.9090,2.9843,44.8864\n"
    "2.9741,2.5228,0,2.5209,2.4976,34.9621\n3.3782,1.9488,0,3.0452,1.9293,29.1136\n"
)


def hard_sphere(folder, model, **choices):
    place = folder / "sphere.csv"
    place.write_text(HARD_SPHERE, encoding="utf-8")
    place.with_suffix(".toml").write_text(
        "[ball]\nmass = 0.058\nradius = 0.033\ninertia_ratio = 0.4\n", encoding="utf-8"
    )
    return build_problem(load_table(place), load_scene(place), Choices(model=model, **choices))
