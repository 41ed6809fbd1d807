"""What follows from a fit: predictions with their uncertainty, how far they reach beyond the data, court pace,
courses of contact, settings for game engines, lookup tables, numerical error.

Offers: `predict_new`, `simulate`, `court_pace`.
May import: inference.sampling, inference.point, inference.likelihood, inference.results, inference.problem, models,
data.
"""
