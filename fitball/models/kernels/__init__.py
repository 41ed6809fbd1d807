"""The compiled numerics of the bounce: phases of a contact, events between them, their derivatives. Numbers and
arrays in, numbers and arrays out; everything is compiled by Numba through `compiled`.

Offers: `bounce_batch` and its Jacobian and history, and the closed forms of the models without a time axis.
May import: models.
"""

from fitball.environment import load_numba

load_numba()
