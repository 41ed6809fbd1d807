"""Programs about fitball rather than about a table: is the thesis reproduced, are the posteriors calibrated, what
does speed cost, does a run repeat. A room for each; no one imports another, but for what is `shared`.

Offers: `thesis` (rederive), `sbc` (scripts/validate), `bench` and `repeat`.
May import: api, exports, report, inference, models, data.
"""
