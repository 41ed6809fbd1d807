"""Which fits are planned from, and what about."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fitball.data.lines import parse_range
from fitball.inference.design.make_plan import Asked

TIMER = "contact_time"


@dataclass(frozen=True)
class Case:
    """A plan in `words`: from the fit of `model` to a bundled `table`, about a `target`, so many `impacts` within
    ranges as options have them, read by the `sensor` (None: as before).
    """

    words: str
    table: str
    model: str
    target: str | None
    impacts: int
    ranges: Mapping[str, str]
    sensor: str | None = None

    def asked(self, seed: int) -> Asked:
        """What the plan is asked."""
        ranges = {name: parse_range(name, text) for name, text in self.ranges.items()}
        # Of equal costs the sensor is chosen whenever it tells more.
        cost = {} if self.sensor is None else {self.sensor.partition("=")[0]: 1.0}
        sensors = ("none",) if self.sensor is None else (self.sensor,)
        return Asked(
            self.target, ranges["speed"], ranges["angle"], ranges["spin"], self.impacts, 1, sensors, cost, seed
        )


MACHINE = {"speed": "5:20", "angle": "10:80", "spin": "-300:300"}
CASES: Mapping[str, Case] = {
    "wang": Case(
        "all parameters of the two-mass ball, after Wang's 21 impacts", "wang_all", "two-mass", None, 6, MACHINE
    ),
    "pace": Case("court pace, after Wang's 21 impacts", "wang_all", "two-mass", "court pace", 6, MACHINE),
    "timer": Case(
        "both stiffnesses, with a contact timer of 0.2 ms, after Wang's 21 impacts", "wang_all", "two-mass",
        "k_y,k_theta", 3, MACHINE, f"{TIMER}=0.2ms",
    ),
    "short": Case(
        "all parameters of grip-slip, after Wang's 7 impacts without spin", "wang_zero_spin", "grip-slip", None, 4,
        MACHINE,
    ),
}  # fmt: skip
