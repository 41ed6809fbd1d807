"""The course of single contacts for a person: rows, text, figure, film, folder; and the map of their regimes.

Offers: `render`, `history_figure`, `write_film`, `map_figure`, `write_all`.
May import: report.saved, report.figures, report.form, inference, models, data.
"""
