"""Simulation-based calibration: draw parameters, simulate their data, fit these, and look whether ranks are uniform.

Offers: `run_replicates`, `summarise`.
May import: studies.shared, api, exports, report, inference, models, data, scheduling.
"""
