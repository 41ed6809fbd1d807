"""Many fits for a person as a document: a row each, centres and spreads, a figure of parameters over tables.

Offers: `row_of`, `write_results`, `render`.
May import: report.figures, report.saved, report.form, inference, models.
"""
