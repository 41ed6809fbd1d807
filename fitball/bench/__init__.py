"""Speed against error of kernels and densities beside common alternatives, ratios of times that show when something
has become slower, and cases on which a search could fail.

Offers: `measure`, `hard_cases`.
May import: api, exports, report, inference, models, data, scheduling.
"""
