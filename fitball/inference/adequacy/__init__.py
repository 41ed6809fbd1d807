"""Does the model describe the data? Fitted noise beside stated or expected, patterns in the residuals, misfits.

Offers: `adequacy`.
May import: inference.prediction, inference.point, inference.sampling, inference.likelihood, inference.results,
inference.problem, models, data.
"""
