"""Which model: candidates fitted to one table and scored by what they predict of impacts left out.

Offers: `compare` (a `Comparison`).
May import: inference, models, data, scheduling.
"""
