"""What the data can tell of each parameter, by four kinds of evidence: profiles, information, contraction, power-
scaling; and the verdict.

Offers: `examine`.
May import: inference.sampling, inference.point, inference.likelihood, inference.results, inference.problem, models,
data, scheduling.
"""
