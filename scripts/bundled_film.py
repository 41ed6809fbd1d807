"""The film that comes with fitball: `bundled_film.py [OUT.mp4]`, else four_throws.mp4 of datasets.

Four throws of one ball, rebounds by the two-mass model of a known ball, seen by a phone with a
rolling shutter and cut together. Beside it OUT.truth.csv has the truth of each frame.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from render_film import Film, Scene, write

import fitball

# The ball: that of the thesis, nearly.
BALL: Mapping[str, float] = {
    "mass_ratio": 0.87,
    "k_y": 2.0e4,
    "k_theta": 20.0,
    "mu": 0.56,
    "eps_10": 2.4e-3,
    "eps_slope": 0.0,
    "cor_10": 0.776,
    "cor_slope": -0.0158,
}
# Incident speeds [m/s], angles [deg] and spins [rad/s].
THROWS = ((6.5, 40.0, -60.0), (7.5, 30.0, 0.0), (7.0, 50.0, 80.0), (6.0, 55.0, -100.0))
SEED = 58
# Most bytes of a bundled film.
MOST_BYTES = 600_000
REBOUND = ("v_x2", "v_y2", "omega_2", "gap_time", "gap_path", "gap_turn")


def scenes() -> list[Scene]:
    """The scene of each throw."""
    model = fitball.model("two-mass")
    made = []
    for speed, degrees, spin in THROWS:
        angle = np.radians(degrees)
        v_x1, v_y1 = speed * np.cos(angle), speed * np.sin(angle)
        rebound = model.rebound(BALL, fitball.impacts(v_x1, v_y1, spin))
        after: dict[str, Any] = {name: float(getattr(rebound, name)[0]) for name in REBOUND}
        scene = Scene(
            v_x1=v_x1,
            v_y1=v_y1,
            omega_1=spin,
            row_time=8e-6,
            exposure=6e-4,
            before=0.15,
            after=0.19,
            bitrate=3.2e6,
            **after,
        )
        made.append(scene)
    return made


def main() -> None:
    """Render the film and say how large it is."""
    here = Path(__file__).resolve().parent.parent / "datasets" / "tracks" / "four_throws.mp4"
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("out", type=Path, nargs="?", default=here)
    out = parser.parse_args().out
    # One seed, so that all throws are before one wall.
    write(out, [Film(scene, SEED) for scene in scenes()], "slow")
    size = out.stat().st_size
    if size > MOST_BYTES:
        raise SystemExit(f"{out}: {size} bytes, more than {MOST_BYTES}")
    print(f"{out}: {size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
