"""Predictions of new impacts for a person as a document, with its figure, and as rows for machines.

Offers: `predict_document`, `predict_page`, `prediction_csv_rows`, `prediction_json`.
May import: report.figures, report.form, inference, models.
"""
