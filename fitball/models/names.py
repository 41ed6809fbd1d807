"""Names of models, for help texts, which must not wait for kernels; `registry` says what each is."""

from __future__ import annotations

DEFAULT_MODEL = "two-mass"
# Those that may stand in a comparison, most complete first.
RANKED = ("two-mass", "thesis-exact", "grip-slip", "brody")
# Those whose `history` gives courses.
FOLLOWED = ("two-mass", "thesis-exact")
