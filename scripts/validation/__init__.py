"""Is what fitball says true? Studies over many simulated tables, outside of the product.

`scripts/validate` runs `command`; a study a folder, `shared` what they have in common.
"""
