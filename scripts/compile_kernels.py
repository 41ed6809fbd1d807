"""Compiles the kernels of a fit where the disk has none of them, so that the first fit does not wait for them."""

from dataclasses import replace

from fitball.bench.problems import posed
from fitball.inference.calibrate import compile_ahead

compile_ahead(replace(posed("wang_zero_spin"), threads=2))
