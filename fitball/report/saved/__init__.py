"""The files of a result folder, written and read back: fit.json, run.toml, data.nc, posterior.nc.

Offers: `fit_text` and `read_fit` (a `SavedFit`), `run_text` and `read_run`, `restore`.
May import: report.form, inference, models, data.
"""
