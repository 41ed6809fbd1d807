"""How results depend on model assumptions: alternatives to each choice that a problem was posed with, fitted quickly
and scored.

Offers: `look`.
May import: inference.prediction, inference.identifiability, inference.sampling, inference.point,
inference.likelihood, inference.results, inference.problem, models, data.
"""
