"""Figures of a fit: arrays, then drawing; kinds.py is the registry."""
