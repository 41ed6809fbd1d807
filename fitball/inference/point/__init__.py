"""The best values of a problem: least squares and the maximum of the posterior, from many starts; likelihood and
posterior as surfaces, and searches on them that advance together.

Offers: `point_fit`, `surface_of`, `descend`.
May import: inference.likelihood, inference.results, inference.problem, models, data.
"""
