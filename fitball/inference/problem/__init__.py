"""What is asked: one frozen `Problem` made of table, model, parameters, priors, observables and the structure of the
noise. It computes rebounds, and no density.

Offers: `build_problem` with `Choices`.
May import: models, data.
"""
