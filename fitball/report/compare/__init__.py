"""A comparison of models for a person: rows, words, text, figure, folder.

Offers: `words`, `render`, `write_all`.
May import: report.saved, report.figures, report.form, inference, models, data.
"""
