"""Room: many tables, each fitted on its own, and what they say together."""
