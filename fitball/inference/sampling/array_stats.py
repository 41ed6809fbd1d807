"""ArviZ's statistics of arrays, without what its densities would need."""

from __future__ import annotations

from fitball.environment import heavy_later

with heavy_later("arviz_base", "arviz_stats", "xarray"):
    from arviz_stats.base.array import array_stats

__all__ = ["array_stats"]
