"""Slow solutions that share no code with the kernels, against which these are checked: matrix exponentials of
any precision.

Offers: `oracle_rebound` and `TwoMassOracle`.
May import: models.
"""
