"""Whole fits beside another edition, and beside a script as users write it: ratios and medians of
CPU time.

`python scripts/benchmark.py [--old PYTHON] [--rounds N] [--script] [--tables A,B]`; editions take
turns, and only ratios within one run carry over to another machine.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import emcee
import lmfit
import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

import fitball
from fitball.base.values import Impacts

COMMAND = "import sys; from fitball.cli import main; sys.exit(main())"
# CPU seconds of what a fit imports, a fit, its files without and with figures.
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
# Walkers times steps of a usual run of emcee, of which a part is timed.
WALKERS = 32
STEPS = 2_000
TIMED = 3
NAMES = ("mass_ratio", "k_y", "k_theta", "mu", "eps_10", "cor_10", "cor_slope")
START = (0.85, 2e4, 20.0, 0.55, 2e-3, 0.77, -0.015)


def tables(folder: Path) -> dict[str, str]:
    """Tables by name: bundled ones, and those that a seed makes of the two-mass ball."""
    rng = np.random.default_rng(1)
    made = {"wang_zero_spin": "wang_zero_spin.csv", "wang_all": "wang_all.csv"}
    values = dict(zip(NAMES, START, strict=True)) | {"eps_slope": 0.0}
    for name, count, steepest in (
        ("two_surfaces", 40, 15.0),
        ("grazing", 24, 4.0),
        ("rows_100000", 100_000, 15.0),
    ):
        states = rng.uniform((10.0, 2.0, -200.0), (30.0, steepest, 200.0), (count, 3))
        frame = pd.DataFrame(states, columns=["v_x1", "v_y1", "omega_1"])
        clay = np.arange(count) % 2 == 1
        draws = {key: np.full(count, value) for key, value in values.items()}
        if name == "two_surfaces":
            draws["mu"], frame["surface"] = (
                np.where(clay, 0.7, 0.55),
                np.where(clay, "clay", "hard"),
            )
        rebound = fitball.model().rebound(draws, Impacts(*np.hsplit(states, 3)))
        for column, sd in (("v_x2", 0.2), ("v_y2", 0.2), ("omega_2", 8.0)):
            frame[column] = getattr(rebound, column)[:, 0] + rng.normal(0.0, sd, count)
        made[name] = str(folder / f"{name}.csv")
        frame.round(4).to_csv(made[name], index=False)
    return made


def spent(command: list[str], folder: str) -> float:
    """CPU seconds of a process, run where no checkout is on its path."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {
        name: value for name, value in os.environ.items() if name != "PYTHONPATH" or "-c" in command
    }
    if subprocess.run(command, cwd=folder, env=environment, capture_output=True).returncode not in (
        0,
        1,
    ):
        raise SystemExit(f"failed: {' '.join(command)}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return sum(after[:2]) - sum(before[:2])


def bounce(values: dict[str, float], v_x: float, v_y: float, omega: float) -> list[float]:
    """The two-mass ball as a script has it: friction smoothed at zero slip, no events, no impulse
    at landing.
    """
    mass = 0.0576
    radius = 0.033
    core = values["mass_ratio"]
    inertia = 0.56 * mass * radius**2
    inner = 0.7 * inertia
    outer = inertia - inner
    cor = values["cor_10"] + values["cor_slope"] * (v_y - 10.0)
    decay = -np.log(cor) / np.pi
    damping = 2.0 * decay * np.sqrt(values["k_y"] * core * mass / (1.0 + decay**2))

    def rates(_t: float, z: np.ndarray) -> list[float]:
        force = values["k_y"] * z[0] + damping * z[1]
        torque = values["k_theta"] * z[5] + 2e-3 * (z[3] - z[4])
        friction = -values["mu"] * force * np.tanh((z[2] - radius * z[4]) / 0.05)
        spin = (torque - radius * friction - values["eps_10"] * force) / outer
        return [z[1], -force / (core * mass), friction / mass, -torque / inner, spin, z[3] - z[4]]

    end = np.pi / np.sqrt(values["k_y"] / (core * mass) - (0.5 * damping / (core * mass)) ** 2)
    z = solve_ivp(rates, (0.0, end), [0.0, v_y, v_x, omega, omega, 0.0], "LSODA", rtol=1e-6).y[
        :, -1
    ]
    return [z[2], cor * v_y, (inner * z[3] + outer * z[4]) / inertia]


def by_script(table: str) -> tuple[float, float]:
    """CPU seconds of a least-squares fit, and of a usual run of emcee as a few of its steps promise
    it.
    """
    data = fitball.load_table(table)
    scale = np.array([0.25, 0.25, 10.0])
    states = np.stack([data.impacts.v_x1, data.impacts.v_y1, data.impacts.omega_1], axis=1)
    seen = np.stack([data.values[name] for name in ("v_x2", "v_y2", "omega_2")], axis=1)

    def residuals(values: dict[str, float]) -> np.ndarray:
        return np.ravel((np.array([bounce(values, *state) for state in states]) - seen) / scale)

    parameters = lmfit.Parameters()
    for name, value in zip(NAMES, START, strict=True):
        low, high = sorted((0.2 * value, 3.0 * value))
        parameters.add(
            name,
            value,
            min=low,
            max=0.999 if name in ("mass_ratio", "cor_10") else high,
        )
    begun = time.process_time()
    best = lmfit.minimize(
        lambda given: residuals(given.valuesdict()),
        parameters,
    ).params.valuesdict()
    fitted = time.process_time() - begun
    at = np.array([best[name] for name in NAMES])

    def density(q: np.ndarray) -> float:
        return -0.5 * float(np.sum(residuals(dict(zip(NAMES, q, strict=True))) ** 2))

    start = at * (1.0 + 1e-3 * np.random.default_rng(1).standard_normal((WALKERS, len(NAMES))))
    begun = time.process_time()
    emcee.EnsembleSampler(WALKERS, len(NAMES), density).run_mcmc(start, TIMED)
    return fitted, (time.process_time() - begun) / (TIMED + 1) * STEPS


def timed(
    files: dict[str, str],
    editions: dict[str, list[str]],
    rounds: int,
    folder: str,
) -> dict[tuple[str, str], list[float]]:
    """CPU seconds of fits by table and edition, which take turns; a first round does not count."""
    seconds: dict[tuple[str, str], list[float]] = {}
    for k in range(rounds + 1):
        for name, file in files.items():
            for edition, command in editions.items():
                out = f"{folder}/{k}{name}{edition}"
                words = [*command, "calibrate", file, "--out", out, "--quiet"]
                seconds.setdefault((name, edition), []).append(spent(words, folder))
    return {key: times[1:] for key, times in seconds.items()}


def comparison(times: dict[str, list[float]]) -> str:
    """Medians of all editions, and ratios of the first to others."""
    first, *others = times.values()
    texts = [f"{edition} {median(seconds):.2f}" for edition, seconds in times.items()]
    for other in others:
        ratios = [a / b for a, b in zip(first, other, strict=True)]
        texts.append(f"ratio {median(ratios):.2f}")
    return " ".join(texts)


def shares(file: str, folder: str) -> str:
    """CPU seconds of what a fit on one core consists of."""
    command = [sys.executable, "-c", SHARES, file, f"{folder}/shares-{Path(file).stem}"]
    answer = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    names = ("imports", "fit", "files", "files and figures")
    seconds = map(float, answer.split()[-4:])
    return ", ".join(f"{name} {value:.2f}" for name, value in zip(names, seconds, strict=True))


def beside_script(ours: float) -> str:
    """What a script as users write it takes, beside our CPU seconds."""
    least, sampled = by_script("wang_zero_spin.csv")
    return (
        f"a script on wang_zero_spin: least squares {least:.1f} s, {WALKERS} walkers of "
        f"{STEPS:,} steps {sampled:.0f} s (from {TIMED + 1}), {(least + sampled) / ours:.0f} times "
        "calibrate"
    )


def main() -> None:
    """Measure by turns and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--old", metavar="PYTHON", help="Python of another edition")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--script", action="store_true", help="measure the script too")
    parser.add_argument("--tables", default="", help="names, separated by commas (default: all)")
    asked = parser.parse_args()
    editions = {"new": [sys.executable, "-c", COMMAND]} | (
        {"old": [asked.old, "-m", "fitball"]} if asked.old else {}
    )
    with tempfile.TemporaryDirectory() as folder:
        files = tables(Path(folder))
        chosen = asked.tables.split(",") if asked.tables else list(files)
        measured = timed({name: files[name] for name in chosen}, editions, asked.rounds, folder)
        print(
            f"CPU seconds of calibrate, medians of {asked.rounds} rounds by turns after one that "
            "is not counted"
        )
        for name in chosen:
            times = {edition: measured[name, edition] for edition in editions}
            print(f"{name}: {comparison(times)} | one core: {shares(files[name], folder)}")
        if asked.script:
            print(beside_script(median(measured["wang_zero_spin", "new"])))


if __name__ == "__main__":
    main()
