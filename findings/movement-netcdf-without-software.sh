#!/bin/sh
# movement 0.15.0: a dataset that `load_poses.from_numpy` makes with its defaults cannot be saved by
# `to_netcdf`, though movement reads such files again.
#
# `source_software` is None by default, and is stored as an attribute None, for which netCDF has no
# type: TypeError. With any name it is saved.
#
# What it means for films of a ball: give `source_software="mine"` to `from_numpy`, or delete the
# attribute before saving. `save_poses.to_dlc_file` needs neither.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check \
    numpy==2.4.6 pandas==3.1.1 xarray==2026.9.0 movement==0.15.0
cd "$work"
"$work/venv/bin/python" -W ignore - <<'EOF'
import sys
from importlib.metadata import version

import numpy as np
from movement.io import load_poses, save_poses

# 20 frames, x and y, one part, one ball.
POSITIONS = np.random.default_rng(1).uniform(size=(20, 2, 1, 1))


def saved(**options):
    """What saving says, "" where it works."""
    poses = load_poses.from_numpy(POSITIONS, fps=240.0, **options)
    try:
        poses.to_netcdf("poses.nc")
    except TypeError as error:
        return str(error).partition(". ")[0]
    return ""


print(f"movement {version('movement')}, xarray {version('xarray')}")
by_default = saved()
named = saved(source_software="mine")
print(f"from_numpy(positions, fps=240): {by_default or 'saved'}")
print(f"with source_software='mine': {named or 'saved'}")
save_poses.to_dlc_file(load_poses.from_numpy(POSITIONS, fps=240.0), "poses.csv")
if not (by_default and not named):
    sys.exit("the behaviour has changed: look again at what is said above")
EOF
