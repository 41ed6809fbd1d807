"""What was measured, as it comes from files: tables, scenes and force records are read, their units converted and
their contradictions refused, once. What the numbers say without any model is here too.

Offers: `load_table` and `load_tables` (an `ImpactTable`), `load_scene` (a `Scene`), `load_force`, `scene_balances`.
May import: nothing else.
"""
