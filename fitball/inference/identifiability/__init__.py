"""What the data determine of each parameter, by four kinds of evidence: profiles, information, contraction and
power-scaling; and the verdict.

Offers: `examine`.
May import: inference.sampling, inference.point, inference.likelihood, inference.results, inference.problem, models,
data, scheduling.
"""
