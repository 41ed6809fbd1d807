"""What was found: frozen values that reports, files and callers read, and that a file holds as they are; and the
sentences of verdicts and adequacy (`sentences`). Nothing is fitted here.

Offers: `Fit` and its `Record`, `FittedModel`, `Identifiability`, `CourtPace`, the names of `QUANTILES`.
May import: inference.problem, models, data.
"""
