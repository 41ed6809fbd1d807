"""Programs about fitball rather than about a table: is the thesis reproduced, what does speed cost, does a run
repeat. A room for each; no one imports another.

Offers: `thesis` (rederive), `bench` and `repeat`.
May import: api, exports, report, inference, models, data.
"""
