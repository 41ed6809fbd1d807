"""Programs about fitball rather than about a table: is the thesis reproduced, are the posteriors calibrated, what
does speed cost, does a run repeat, can a damaged file bring a command down. A room for each; no one imports another.

Offers: `thesis` (rederive), `sbc` (scripts/validate), `bench`, `repeat` and `fuzz`.
May import: api, exports, report, inference, models, data.
"""
