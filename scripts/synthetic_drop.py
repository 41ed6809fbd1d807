"""Write the bundled drop test with force records, `datasets/synthetic_drop*.csv`, whose truth is known.

The motion is written out here, not taken from the models that are fitted to it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

MASS, K_Y, COR = 0.0576, 2.6e4, 0.74
SPEEDS = (4.0, 6.0, 8.0, 10.0, 12.0)


def zeta_of(e: float) -> float:
    """Damping ratio at which the force vanishes with restitution e: -ln e = 2 b cot b, zeta = cos b, by bisection."""
    low, high = 1e-9, 0.5 * np.pi
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if 2.0 * middle / np.tan(middle) > -np.log(e) else (low, middle)
    return np.cos(low)


def force_at(times: np.ndarray, v: float, k_y: float = K_Y, e: float = COR, mass: float = MASS) -> np.ndarray:
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
    name: str = "drops",
    noise: float = 4.0,
    misfit: float = 0.04,
    step: float = 4e-5,
    scale: float = 1.0,
    records: bool = True,
    sd: float = 0.05,
    latest: float = 2e-3,
    edges: bool = False,
) -> Path:
    """Write `name`.csv and, with `records`, `name`_force.csv; return the table.

    Contacts start up to `latest` [s] after 1 ms. The force is multiplied by `scale`. It deviates by a random course
    of `misfit` its peak and by white `noise` [N]. `sd` [m/s] is that of the rebound speeds.
    """
    rng = np.random.default_rng(seed)
    lines, samples = ["id,v_y1,v_y2"], ["id,t [ms],F [N]"]
    for place, v in enumerate(SPEEDS):
        drop = f"drop {place + 1}"
        lines.append(f"{drop},{v:.3f},{COR * v + sd * rng.standard_normal():.4f}")
        start = 1e-3 + latest * rng.uniform()
        times = np.arange(0.0, 1e-2, step)
        force = force_at(times - start, v)
        apart = (times[:, None] - times) / 0.9e-3
        smooth = rng.multivariate_normal(np.zeros(times.size), np.exp(-0.5 * apart**2), method="eigh")
        shape = (force > 0.0) if edges else np.sqrt(np.maximum(force, 0.0) / force.max())
        force = scale * (force + misfit * force.max() * smooth * shape)
        force = force + noise * rng.standard_normal(times.size)
        samples += [f"{drop},{1e3 * t:.4f},{f:.4f}" for t, f in zip(times, force, strict=True)]
    table = folder / f"{name}.csv"
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    if records:
        (folder / f"{name}_force.csv").write_text("\n".join(samples) + "\n", encoding="utf-8")
    return table


if __name__ == "__main__":
    write_case(Path(__file__).resolve().parent.parent / "datasets", seed=1, name="synthetic_drop")
