"""Many tables, each fitted by itself: tasks, what each found as one row, a table and a page of all.

Offers: `calibrate_many`, `load_batch`, `Batch`.
May import: api, report, inference, models.own, data, scheduling.
"""

from fitball.batch.many import Batch, calibrate_many, load_batch

__all__ = ["Batch", "calibrate_many", "load_batch"]
