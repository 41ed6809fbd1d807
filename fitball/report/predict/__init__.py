"""All of `predict`: rows, text."""
