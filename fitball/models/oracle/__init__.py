"""The slow independent solution."""
