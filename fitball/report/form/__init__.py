"""Shapes that all reports share: rounding, units for reading, symbols, colours, text tables, CSV, folders, files
written whole or not at all.

Offers: `columns`, `csv_text`, `json_text`, `write_text`, `fixed`, `handy`, `symbol_html`, `style_rules`.
May import: data, models, inference.problem, inference.results.
"""
