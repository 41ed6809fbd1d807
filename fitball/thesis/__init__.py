"""The thesis of Jafri (2004) computed again and judged: its appendices, its tables, its examples, its Chapter V.

Offers: `derive`, `page`, `run_example`, `example_text`.
May import: api, exports, report, inference, models, data.
"""
