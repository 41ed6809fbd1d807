"""Speed against error of kernels and densities beside what one would take instead, ratios that tell when something
has become slower, and cases on which a search could fail.

Offers: `measure`, `hard_cases`.
May import: api, exports, report, inference, models, data, scheduling.
"""
