"""One fit for a person as a document; as CSV files, as a folder.

Offers: `fit_document`, `render`, `page`, `write_all`.
May import: report.saved, report.figures, report.form, inference, models, data.
"""
