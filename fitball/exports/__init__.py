"""A saved fit in the forms that other programs read: parameter sets, tables, engine settings, netCDF, source code,
a page with sliders.

Offers: `FORMATS`, `exported`, `interactive_page`.
May import: report, inference, models, data.
"""
