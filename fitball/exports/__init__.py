"""A saved fit in the forms that other programs read: parameter sets, tables, engine settings, netCDF, source code,
a page with sliders. Bounces of a model that nothing was fitted to have some of them too.

Offers: `FORMATS`, `exported`, `exported_model`, `interactive_page`.
May import: report, inference, models, data.
"""
