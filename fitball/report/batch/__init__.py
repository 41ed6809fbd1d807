"""Many fits for a person: a row each, a table of all, a figure of parameters over tables, a page.

Offers: `row_of`, `write_results`.
May import: report.figures, report.saved, report.form, inference, models.
"""
