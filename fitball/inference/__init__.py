"""Where tables meet models. The rooms within hold the steps; here is the whole road from a problem to a fit.

Offers: `calibrate`, `Effort`.
May import: models, data, scheduling.
"""
