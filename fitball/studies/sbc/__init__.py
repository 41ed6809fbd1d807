"""Simulation-based calibration (scripts/validate)."""
