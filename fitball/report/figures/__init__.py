"""Figures of a fit: the arrays first, then the drawing; one registry of kinds.

Offers: `KINDS`, `save_png`.
May import: report.form, inference, models, data.
"""
