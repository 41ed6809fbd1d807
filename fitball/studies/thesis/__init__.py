"""Rederive and --example."""
