"""A plan for a person: words, the impacts as a table that can be filled in, a map of gains, a page.

Offers: `render`, `write_all`, `plan_rows`.
May import: report.figures, report.form, inference, models.
"""
