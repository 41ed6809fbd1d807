"""What many tables have in common: centre and spread of a quantity, each table given the others; drift,
outliers.

Offers: `population`, `quantity`, `trend`.
May import: inference.sampling, inference.problem, models.
"""
