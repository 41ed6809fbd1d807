"""What was measured, as it comes from files: tables, scenes and force records are read, their units converted and
their contradictions refused, once. What the numbers say without any model is here too.

The road of a table: `text` and `workbooks` (bytes to cells), `layout` (which are header and rows), `header` and
`names` (what each column is), `numbers` (SI), `rows` and `heights` (gaps, drop tests), `kinematics`, `checks` and
`bounds`, `table`; `read` walks it, `join` for several, and asks `misreading` and `repeats` whether to trust it.

Offers: `load_table` and `load_tables` (an `ImpactTable`), `load_scene` (a `Scene`), `load_force`, `scene_balances`.
May import: nothing else.
"""
