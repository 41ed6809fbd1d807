"""What is asked: the frozen Problem, its parameters, priors, observables, structure of the noise.

Computes rebounds, no density.
"""
