"""A translator: the kernels of a calibrated model, with its parameters, in other languages, without dependencies.

Offers: `c_port`, `csharp_port`, `javascript_texts`, `python_port`, `port_of`.
May import: exports.bounces, inference.prediction, inference.results, models.
"""
