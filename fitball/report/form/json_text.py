"""Content as JSON text, the same wherever it is written or printed."""

from __future__ import annotations

import json


def json_text(content: object) -> str:
    """`content` as lines of JSON, the last one ended; NaN and infinity cannot occur."""
    return json.dumps(content, indent=1, allow_nan=False) + "\n"
