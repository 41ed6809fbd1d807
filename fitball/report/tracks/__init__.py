"""The report of `fitball track`: a document for terminal and page, figures of each impact and of the session, and the
folder of files.

Offers: `track_document`, `render`, `track_json`, `write_all`, `impact_figure`, `session_figure`.
May import: report.figures, report.form, inference, tracks, models, data.
"""
