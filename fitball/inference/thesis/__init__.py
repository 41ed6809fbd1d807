"""The thesis as input of an inference (moves on to fitball/thesis/ if that room is built)."""
