"""A saved fit in the forms that other programs read: parameter sets, tables, engine settings, netCDF, source code.

Offers: `TEXT_FORMATS`.
May import: report, inference, models, data.
"""
