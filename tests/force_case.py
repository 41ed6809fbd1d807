"""A synthetic drop test with force records, made without the code under test: the motion is written out here."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fitball.data.force_file import load_force
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.inference.problem import Choices, build_problem

MASS, K_Y, COR = 0.0576, 2.6e4, 0.74
SPEEDS = (4.0, 6.0, 8.0, 10.0, 12.0)


def zeta_of(e):
    """Damping ratio at which the force vanishes with restitution e: -ln e = 2 b cot b, zeta = cos b, by bisection."""
    low, high = 1e-9, 0.5 * np.pi
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if 2.0 * middle / np.tan(middle) > -np.log(e) else (low, middle)
    return np.cos(low)


def force_at(times, v, k_y=K_Y, e=COR, mass=MASS):
    """K y + C y' of a mass on a damped spring, from landing at 0 until it vanishes."""
    zeta, omega = zeta_of(e), np.sqrt(k_y / mass)
    sigma, damped = zeta * omega, omega * np.sqrt(1.0 - zeta**2)
    decay = np.exp(-sigma * times)
    y = v * decay * np.sin(damped * times) / damped
    rate = v * decay * (np.cos(damped * times) - sigma / damped * np.sin(damped * times))
    force = k_y * y + 2.0 * zeta * omega * mass * rate
    release = 2.0 * np.arccos(zeta) / np.sin(np.arccos(zeta)) / omega
    return np.where((times > 0.0) & (times < release), force, 0.0)


def write_case(
    folder: Path,
    seed: int,
    *,
    noise=4.0,
    misfit=0.04,
    step=4e-5,
    scale=1.0,
    records=True,
    sd=0.05,
    latest=2e-3,
    edges=False,
) -> Path:
    """Write drops.csv and, with `records`, drops_force.csv; return the table. Starts of contact lie up to `latest`
    after 1 ms, the force is multiplied by `scale`, and misses the model's by a random course of `misfit` its peak."""
    rng = np.random.default_rng(seed)
    lines, samples = ["id,v_y1,v_y2"], ["id,t [ms],F [N]"]
    for place, v in enumerate(SPEEDS):
        name = f"drop {place + 1}"
        lines.append(f"{name},{v:.3f},{COR * v + sd * rng.standard_normal():.4f}")
        start = 1e-3 + latest * rng.uniform()
        times = np.arange(0.0, 1e-2, step)
        force = force_at(times - start, v)
        apart = (times[:, None] - times) / 0.9e-3
        smooth = rng.multivariate_normal(np.zeros(times.size), np.exp(-0.5 * apart**2), method="eigh")
        shape = (force > 0.0) if edges else np.sqrt(np.maximum(force, 0.0) / force.max())
        force = scale * (force + misfit * force.max() * smooth * shape)
        force = force + noise * rng.standard_normal(times.size)
        samples += [f"{name},{1e3 * t:.4f},{f:.4f}" for t, f in zip(times, force, strict=True)]
    table = folder / "drops.csv"
    table.write_text("\n".join(lines) + "\n")
    if records:
        (folder / "drops_force.csv").write_text("\n".join(samples) + "\n")
    return table


def problem_of(table: Path, *, records=True, scene=None, **choices):
    """The problem of a case, its closures left to the drop test."""
    loaded = load_table(table)
    force = load_force(table.with_name("drops_force.csv"), loaded) if records else None
    return build_problem(loaded, scene or Scene(), Choices(**choices), force)
