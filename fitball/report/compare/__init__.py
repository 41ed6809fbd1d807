"""A comparison of models for a person as a document, with its rows, words and figures.

Offers: `compare_document`, `render`, `write_all`.
May import: report.saved, report.figures, report.form, inference, models, data.
"""
