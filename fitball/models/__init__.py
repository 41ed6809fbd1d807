"""What a ball does in one impact: parameters and incident states in, rebounds out, batched over draws. Nothing here
knows of measurements or noise.

Offers: `model` composes a `Model` by name; it gives rebounds, their derivatives, and of one impact its `history`;
`SPECS` are the parameters.
May import: nothing else.
"""
