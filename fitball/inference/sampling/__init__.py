"""Draws of a posterior: ensembles of walkers, the chain file from which they continue, convergence, Monte Carlo
errors.

Offers: `sample`, `standard_errors`.
May import: inference.likelihood, inference.results, inference.problem, models, data.
"""
