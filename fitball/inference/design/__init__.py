"""What to measure next: the expected information gain of a planned impact (Bayesian optimal design, Lindley 1956),
from draws of a posterior, about parameters or about a prediction.

Offers: `make_plan`, `Asked`, `Plan`.
May import: inference.prediction, inference.likelihood, inference.results, inference.problem, tracks, models, data.
"""
