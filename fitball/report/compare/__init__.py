"""A comparison of models for a person: rows, words, text, page, figures, folder.

Offers: `words`, `render`, `write_all`.
May import: report.saved, report.figures, report.form, inference, models, data.
"""
