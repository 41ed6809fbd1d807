"""Shapes that all reports share: rounding, units for reading, text tables, CSV, folders, files written whole or not
at all.

Offers: `columns`, `csv_text`, `json_text`, `write_text`, `fixed`, `handy`.
May import: data.
"""
