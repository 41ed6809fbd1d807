"""What many tables have in common: centre, spread, drift and outliers of a parameter over their fits.

Offers: `trend`.
May import: nothing else.
"""
