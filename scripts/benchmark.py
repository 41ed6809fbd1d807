"""CPU time of whole fits beside another edition, and beside a script as users write it.

`python scripts/benchmark.py [--old PYTHON] [--rounds N] [--script] [--tables A,B]` prints medians
and ratios. Editions take turns; only ratios within one run carry over to another machine.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from statistics import median
from typing import NamedTuple

import emcee
import lmfit
import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

import fitball
from fitball.base.values import FloatArray, Impacts

# Runs the command line of this checkout.
COMMAND = "import sys; from fitball.cli import main; sys.exit(main())"
# Prints CPU seconds of the imports of a fit, of a fit, and of its files without and with figures.
SHARES = """
import sys; from time import process_time as now; times = [now()]
import corner, emcee, lmfit, matplotlib.figure, scipy.stats, fitball
import fitball.data.read, fitball.inference.calibrate
import fitball.report.fit_page, fitball.report.figures.parameters
times.append(now()); fit = fitball.calibrate(sys.argv[1], cores=1)
times.append(now()); fit.save(sys.argv[2], figures=False)
times.append(now()); fit.save(sys.argv[2], overwrite=True); times.append(now())
print(*(after - before for before, after in zip(times, times[1:])))
"""
# Walkers of a usual run of emcee, some four times the parameters.
WALKERS = 32
# Steps of a usual run of emcee.
STEPS = 2_000
# Steps that are timed, besides the first evaluation of the walkers.
TIMED_STEPS = 3
# Starting values of the script's parameters, those that tables are simulated with.
START = {
    "mass_ratio": 0.85,
    "k_y": 2e4,
    "k_theta": 20.0,
    "mu": 0.55,
    "eps_10": 2e-3,
    "cor_10": 0.77,
    "cor_slope": -0.015,
}
# Sds of measurements, SI, as the script assumes them: velocities and spin.
SDS = np.array([0.25, 0.25, 10.0])
# Tables that are simulated: name, rows, largest vertical speed [m/s].
SIMULATED = (
    ("two_surfaces", 40, 15.0),
    ("grazing", 24, 4.0),
    ("rows_100000", 100_000, 15.0),
)


class Ball(NamedTuple):
    """A ball of the script: mass [kg], radius [m], moments of inertia of core and shell
    [kg m^2].
    """

    mass: float
    radius: float
    core: float
    shell: float


# Moment of inertia of a tennis ball [kg m^2].
_INERTIA = 0.56 * 0.0576 * 0.033**2
# A tennis ball whose core has 0.7 of its moment of inertia.
BALL = Ball(0.0576, 0.033, 0.7 * _INERTIA, _INERTIA - 0.7 * _INERTIA)
# Damping of the twist of the shell against the core in the script [N m s/rad].
TORSIONAL_DAMPING = 2e-3
# Slip [m/s] over which the script smooths friction.
SMOOTH_SLIP = 0.05


def tables(folder: Path) -> dict[str, str]:
    """Tables by name: bundled ones, and files in the folder, simulated with the two-mass ball."""
    rng = np.random.default_rng(1)
    files = {"wang_zero_spin": "wang_zero_spin.csv", "wang_all": "wang_all.csv"}
    values = START | {"eps_slope": 0.0}
    for name, count, steepest in SIMULATED:
        states = rng.uniform((10.0, 2.0, -200.0), (30.0, steepest, 200.0), (count, 3))
        frame = pd.DataFrame(states, columns=["v_x1", "v_y1", "omega_1"])
        parameters = {key: np.full(count, value) for key, value in values.items()}
        if name == "two_surfaces":
            is_clay = np.arange(count) % 2 == 1
            parameters["mu"] = np.where(is_clay, 0.7, 0.55)
            frame["surface"] = np.where(is_clay, "clay", "hard")
        rebound = fitball.model().rebound(parameters, Impacts(*np.hsplit(states, 3)))
        for column, sd in (("v_x2", 0.2), ("v_y2", 0.2), ("omega_2", 8.0)):
            frame[column] = getattr(rebound, column)[:, 0] + rng.normal(0.0, sd, count)
        files[name] = str(folder / f"{name}.csv")
        frame.round(4).to_csv(files[name], index=False)
    return files


def cpu_of(command: list[str], folder: str) -> float:
    """CPU seconds of a process. Only this edition has the checkout on its path."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = dict(os.environ)
    if "-c" not in command:
        environment.pop("PYTHONPATH", None)
    process = subprocess.run(command, cwd=folder, env=environment, capture_output=True, check=False)
    # Code 1 is a result with a warning.
    if process.returncode not in (0, 1):
        raise SystemExit(f"failed: {' '.join(command)}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return sum(after[:2]) - sum(before[:2])


def bounce(values: Mapping[str, float], v_x: float, v_y: float, omega: float) -> list[float]:
    """Velocities and spin after the bounce of a two-mass ball, SI, as a script has it: friction is
    smoothed at zero slip, without events and without an impulse at landing.
    """
    mass, radius, inner, outer = BALL
    core_mass = values["mass_ratio"] * mass
    k_y = values["k_y"]
    cor = values["cor_10"] + values["cor_slope"] * (v_y - 10.0)
    decay = -np.log(cor) / np.pi
    damping = 2.0 * decay * np.sqrt(k_y * core_mass / (1.0 + decay**2))

    def rates(_t: float, state: FloatArray) -> list[float]:
        y, rate, v, core, shell, twist = state
        force = k_y * y + damping * rate
        torque = values["k_theta"] * twist + TORSIONAL_DAMPING * (core - shell)
        friction = -values["mu"] * force * np.tanh((v - radius * shell) / SMOOTH_SLIP)
        on_shell = torque - radius * friction - values["eps_10"] * force
        return [
            rate,
            -force / core_mass,
            friction / mass,
            -torque / inner,
            on_shell / outer,
            core - shell,
        ]

    end = np.pi / np.sqrt(k_y / core_mass - (0.5 * damping / core_mass) ** 2)
    start = [0.0, v_y, v_x, omega, omega, 0.0]
    solution = solve_ivp(rates, (0.0, end), start, "LSODA", rtol=1e-6)
    _, _, v_x2, core, shell, _ = solution.y[:, -1]
    omega_2 = (inner * core + outer * shell) / (inner + outer)
    return [v_x2, cor * v_y, omega_2]


class ScriptFit:
    """The fit of a table as a script has it: misses over sds, and what emcee and lmfit need."""

    def __init__(self, table: str) -> None:
        data = fitball.load_table(table)
        impacts = data.impacts
        self.states = np.stack([impacts.v_x1, impacts.v_y1, impacts.omega_1], axis=1)
        columns = [data.values[name] for name in ("v_x2", "v_y2", "omega_2")]
        self.measured = np.stack(columns, axis=1)

    def residuals(self, values: Mapping[str, float]) -> FloatArray:
        """Misses (rows * 3,) over their sds."""
        rebounds = np.array([bounce(values, *state) for state in self.states])
        return np.ravel((rebounds - self.measured) / SDS)

    def log_density(self, q: FloatArray) -> float:
        """Log density at values (parameters,), as emcee calls it."""
        values = dict(zip(START, q, strict=True))
        return -0.5 * float(np.sum(self.residuals(values) ** 2))

    def best(self) -> FloatArray:
        """Best values (parameters,) by lmfit."""
        parameters = lmfit.Parameters()
        for name, value in START.items():
            low, high = sorted((0.2 * value, 3.0 * value))
            most = 0.999 if name in ("mass_ratio", "cor_10") else high
            parameters.add(name, value, min=low, max=most)
        best = lmfit.minimize(lambda trial: self.residuals(trial.valuesdict()), parameters)
        return np.array([best.params[name].value for name in START])


def by_script(table: str) -> tuple[float, float]:
    """CPU seconds of a least-squares fit by a script, and of a usual run of emcee, extrapolated
    from a few of its steps.
    """
    fit = ScriptFit(table)
    begun = time.process_time()
    best = fit.best()
    fitted = time.process_time() - begun
    scatter = np.random.default_rng(1).standard_normal((WALKERS, len(START)))
    start = best * (1.0 + 1e-3 * scatter)
    sampler = emcee.EnsembleSampler(WALKERS, len(START), fit.log_density)
    begun = time.process_time()
    sampler.run_mcmc(start, TIMED_STEPS)
    # The walkers are evaluated once before the first step.
    of_step = (time.process_time() - begun) / (TIMED_STEPS + 1)
    return fitted, of_step * STEPS


def times_of_fits(
    files: dict[str, str],
    editions: dict[str, list[str]],
    rounds: int,
    folder: str,
) -> dict[tuple[str, str], list[float]]:
    """CPU seconds of each fit by table and edition. Editions take turns; a first round does not
    count.
    """
    seconds: dict[tuple[str, str], list[float]] = {}
    for k in range(rounds + 1):
        for name, file in files.items():
            for edition, command in editions.items():
                out = f"{folder}/{k}{name}{edition}"
                words = [*command, "calibrate", file, "--out", out, "--quiet"]
                seconds.setdefault((name, edition), []).append(cpu_of(words, folder))
    return {key: times[1:] for key, times in seconds.items()}


def comparison(times: dict[str, list[float]]) -> str:
    """Medians of CPU seconds by edition, and medians of the ratio of the first to each other."""
    first, *others = times.values()
    texts = [f"{edition} {median(seconds):.2f}" for edition, seconds in times.items()]
    for other in others:
        ratios = [ours / theirs for ours, theirs in zip(first, other, strict=True)]
        texts.append(f"ratio {median(ratios):.2f}")
    return " ".join(texts)


def shares_of_fit(file: str, folder: str) -> str:
    """CPU seconds of the parts of a fit on one core, in words."""
    command = [sys.executable, "-c", SHARES, file, f"{folder}/shares-{Path(file).stem}"]
    answer = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    names = ("imports", "fit", "files", "files and figures")
    seconds = map(float, answer.split()[-4:])
    return ", ".join(f"{name} {value:.2f}" for name, value in zip(names, seconds, strict=True))


def beside_script(ours: float) -> str:
    """The sentence on CPU seconds of a script as users write it; `ours` are those of fitball."""
    least, sampled = by_script("wang_zero_spin.csv")
    ratio = (least + sampled) / ours
    return (
        f"a script on wang_zero_spin: least squares {least:.1f} s, {WALKERS} walkers of "
        f"{STEPS:,} steps {sampled:.0f} s (from {TIMED_STEPS + 1}), {ratio:.0f} times calibrate"
    )


def main() -> None:
    """Measure by turns and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--old", metavar="PYTHON", help="Python of another edition")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--script", action="store_true", help="measure the script too")
    parser.add_argument("--tables", default="", help="names, separated by commas (default: all)")
    arguments = parser.parse_args()
    rounds = arguments.rounds
    editions = {"new": [sys.executable, "-c", COMMAND]}
    if arguments.old:
        editions["old"] = [arguments.old, "-m", "fitball"]
    with tempfile.TemporaryDirectory() as folder:
        files = tables(Path(folder))
        if arguments.tables:
            files = {name: files[name] for name in arguments.tables.split(",")}
        seconds = times_of_fits(files, editions, rounds, folder)
        print(
            f"CPU seconds of calibrate, medians of {rounds} rounds by turns after one that is not "
            "counted"
        )
        for name, file in files.items():
            times = {edition: seconds[name, edition] for edition in editions}
            print(f"{name}: {comparison(times)} | one core: {shares_of_fit(file, folder)}")
        if arguments.script:
            print(beside_script(median(seconds["wang_zero_spin", "new"])))


if __name__ == "__main__":
    main()
