"""Tables as people write them, in one form: whatever the file, its encoding, its delimiters, its decimal signs, the
lines around its header, and the spellings of its names and units, out come header, rows and what was assumed. What
can be taken in two ways is refused in words, never guessed.

Offers: `read_raw` (a file's cells), `frame_table` (a DataFrame's), `plain_numbers` (cells as our number columns have
them), `split_deviations`, `split_cell` (name and unit of a header cell), `guess_of` (what a foreign name probably
means), `spelled_unit`.
May import: nothing else.
"""
