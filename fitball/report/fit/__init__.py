"""One fit for a person: on the terminal, as a page, as CSV files, as a folder.

Offers: `render`, `page`, `write_all`.
May import: report.saved, report.figures, report.form, inference, models, data.
"""
