"""How probable: densities and residuals of a problem, and their derivatives.

Offers: `log_posterior`, `log_likelihood`, `residuals`.
May import: inference.problem, models, data, scheduling.
"""
