"""A plan for a person as a document, with the impacts as a table that can be filled in and a map of gains.

Offers: `plan_document`, `render`, `write_all`, `plan_rows`.
May import: report.figures, report.form, inference, models.
"""
