"""Predictions of new impacts for a person: rows and text.

Offers: `prediction_csv_rows`, `prediction_json`, `render_prediction`.
May import: report.saved, report.figures, report.form, inference, models, data.
"""
