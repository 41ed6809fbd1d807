"""What a ball does in one impact: parameters and incident states in, rebounds out, batched over draws. Nothing here
knows of measurements or noise.

Offers: `model` composes a `Model` by name; `SPECS` are the parameters; `history` and `jacobian` ask a
model for its course, its derivatives and how near its regimes are.
May import: nothing else.
"""
