"""Numba kernels only (compiled.py: SOURCES globs its own folder, keep it beside them, or rglob)."""
