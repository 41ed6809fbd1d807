"""A run made again from its folder and compared with what lies there, to the last bit or within Monte Carlo error.

Offers: `compared`.
May import: api, exports, report, inference, models, data.
"""
