"""The parameter sets and inputs that Jafri (2004) prints, in SI, and what they predict of a table.

Offers: `PublishedCase`, `case_errors`, `compare_cases`.
May import: inference.prediction, inference.results, inference.problem, models, data.
"""
