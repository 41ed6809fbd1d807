"""A translator: the kernels of a calibrated model, with its parameters, as C99 or Python without dependencies.

Offers: `c_port`, `python_port`.
May import: inference.prediction, inference.results, models.
"""
