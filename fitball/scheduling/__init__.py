"""Many tasks over processes: the one door to an engine that schedules them, joblib here or Dask elsewhere.

Offers: `Engine`, `engine`, `in_order`.
May import: nothing else.
"""
