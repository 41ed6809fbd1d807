"""Eight impacts at once: a number type that holds eight, its elementary functions, and the bounce of eight impacts,
each doing what its own phases ask for.

Offers: `bounce_lanes`, which says of each impact whether it could be solved so.
May import: models.
"""
