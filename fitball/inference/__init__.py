"""Models fitted to tables. The rooms within hold the steps; here is the whole road from a problem to a fit.

Offers: `calibrate`, `Effort`.
May import: models, data, scheduling.
"""

from __future__ import annotations

from fitball.environment import heavy_later

with heavy_later():
    import scipy.optimize  # noqa: F401
