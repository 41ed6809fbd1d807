"""Draws: emcee ensembles, chain file, convergence, Monte Carlo errors, prior draws."""
