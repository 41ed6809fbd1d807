"""Figures of a fit: the arrays first, then the drawing; one registry of kinds.

Offers: `FIGURES`, `draw`, `save_figure`.
May import: report.form, inference, models, data.
"""
