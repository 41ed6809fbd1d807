"""The computation of Jafri (2004) as it was printed, slips included, to reproduce its tables.

Offers: `ThesisModel` and `thesis_motion`.
May import: models.
"""
