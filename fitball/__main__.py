"""`python -m fitball`."""

from __future__ import annotations

import sys

from fitball.cli.main import main

sys.exit(main())
