"""Bounce models: parameters and incident states in, rebounds out."""
