"""Does the model describe the table? Fitted noise against stated or expected, patterns in the residuals, misfits.

Offers: `adequacy`.
May import: prediction, sampling, likelihood, results, problem; models, data.
"""
