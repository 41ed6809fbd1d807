"""The files that a fit is kept in: written, and read back as the types that it has in memory.

Offers: `fit_text`, `read_fit`, `load`, `run_text`, `read_run`, `write_data`, `write_netcdf`.
May import: report.form, inference, models, data.
"""
