"""The thesis computation with its slips."""
