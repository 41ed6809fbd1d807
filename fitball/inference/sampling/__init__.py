"""Draws of a posterior: ensembles of walkers, the chain file that lets them go on, whether they agree, how far what
they say may move.

Offers: `sample`, `standard_errors`.
May import: inference.likelihood, inference.results, inference.problem, models, data.
"""
