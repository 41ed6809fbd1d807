"""What was found: frozen values that reports, files and callers read. Nothing is fitted here.

Offers: `Fit` and its parts, `FittedModel`, `Identifiability`, `CourtPace`, the names of `QUANTILES`.
May import: inference.problem, models, data.
"""
