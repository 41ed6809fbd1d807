"""Speed against error: the kernels beside general solvers, and cases on which a search could fail.

Offers: `measure`, `hard_cases`.
May import: api, exports, report, inference, models, data.
"""
