#!/bin/sh
# arviz-plots 1.3.2: `plot_trace` and `plot_autocorr` fail for draws whose dimensions have no coordinates.
#
# A file with the dimensions `chain` and `draw` is valid NetCDF without variables of these names, and
# xarray reads it. `summary`, `plot_dist`, `plot_forest`, `plot_rank` and `plot_ess` take it; `plot_trace`
# and `plot_autocorr` end with "Expected unidimensional data". With coordinates 0, 1, 2, ... both draw it.
#
# What it means for programs that write posteriors: write `chain` and `draw` as coordinates too. For a file
# without them: `data.posterior.dataset.assign_coords(chain=..., draw=...)`.
#
# Needs Python 3.12; name another one than python3 in PYTHON.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"${PYTHON:-python3}" -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check \
    arviz-base==1.3.1 arviz-plots==1.3.2 arviz-stats==1.3.3 netcdf4==1.7.5.1.post1 matplotlib==3.11.2
cd "$work"
MPLBACKEND=Agg MPLCONFIGDIR="$work" "$work/venv/bin/python" - <<'PYTHON'
import sys
from importlib.metadata import version

import arviz_plots
import numpy as np
import xarray as xr

draws = np.random.default_rng(1).standard_normal((4, 500))
bare = xr.Dataset({"mu": (("chain", "draw"), draws)})
coordinates = {"chain": np.arange(4), "draw": np.arange(500)}
for name, dataset in (("bare", bare), ("named", bare.assign_coords(coordinates))):
    xr.DataTree.from_dict({"posterior": dataset}).to_netcdf(f"{name}.nc", engine="netcdf4")


def outcome(plot, name):
    """What a plot does with a file, in words."""
    with xr.open_datatree(f"{name}.nc", engine="netcdf4") as tree:
        try:
            getattr(arviz_plots, plot)(tree, backend="matplotlib")
        except ValueError as error:
            return str(error).split(" but ")[0]
    return "drawn"


print(f"arviz-plots {version('arviz-plots')}")
failing = ("plot_trace", "plot_autocorr")
fine = ("plot_dist", "plot_forest", "plot_rank", "plot_ess")
without = {plot: outcome(plot, "bare") for plot in (*failing, *fine)}
for plot, words in without.items():
    print(f"{plot} without coordinates: {words}")
with_them = {plot: outcome(plot, "named") for plot in failing}
print(f"with coordinates: {with_them}")
expected = "Expected unidimensional data"
as_said = all(without[plot] == expected for plot in failing)
as_said = as_said and all(without[plot] == "drawn" for plot in fine)
if not (as_said and all(words == "drawn" for words in with_them.values())):
    sys.exit("the behaviour has changed: look again at what is said above")
PYTHON
