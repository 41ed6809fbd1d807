"""What a ball does in one impact: parameters and incident states in, rebounds out, batched over draws. Nothing here
knows of measurements or noise.

Offers: `model` composes a `Model` by name; `SPECS` are the parameters; `history` and `jacobian` ask a model for its
course and its derivatives.
May import: nothing else.
"""
