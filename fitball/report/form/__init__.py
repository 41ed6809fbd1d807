"""Shared shapes: rounding, display units, text tables, CSV, folders, atomic writing."""
