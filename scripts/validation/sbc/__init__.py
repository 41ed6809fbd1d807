"""Simulation-based calibration: draw parameters, simulate their data, fit these, look whether ranks are uniform."""
