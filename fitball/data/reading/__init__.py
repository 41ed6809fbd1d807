"""Was a table read the right way round? Other readings of its columns (signs, units, angles from the normal, columns
exchanged) are compared with what its header says, by laws that every bounce obeys and a fit of a few milliseconds.

Offers: `doubt_of` (what to say of a table, if anything), `hypotheses` (the registry), `misfit`.
May import: data.
"""
