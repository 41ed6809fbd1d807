"""A fit in other forms (today report/exports): parameter sets, tables, engine settings, netCDF."""
