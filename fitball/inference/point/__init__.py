"""The best values of a problem: least squares and the maximum of the posterior, from many starts.

Offers: `point_fit`.
May import: inference.likelihood, inference.results, inference.problem, models, data.
"""
