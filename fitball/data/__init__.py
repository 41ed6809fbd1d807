"""What was measured, as it comes from files: tables, scenes and force records are read, their units converted and
their contradictions refused, once. What the numbers say without any model is here too.

The road of a table: `text` and `workbooks` (bytes to records), `cells` (which are header and rows), `header` (what
each column is), `numbers` (SI, gaps), `heights` (drop tests), `checks` (by the one `kinematics`), `table`; each a
frozen value made from the one before. `read` walks it, and asks `misreading` whether to trust what it gives.

Offers: `load_table` and `load_tables` (an `ImpactTable`), `load_scene` (a `Scene`), `load_force`, `scene_balances`.
May import: nothing else.
"""
