"""The units that people read, each once: what is shown takes its factor from here, by name.

Data, files and results are in SI, angles in radians. A spec or a column names its `display_unit`;
sentences and figures take the unit that they print.
"""

from math import pi

from fitball.base.numbers import Unit

# Ratios, coefficients, ratings, and numbers whose unit the sentence around them says.
PLAIN = Unit("")
# Rounded shares are `numbers.percent`; this is for shares with an interval.
PERCENT = Unit("%", 100.0)

# The default of a spec or a column, which reads it as its own SI unit.
SI = Unit("SI")

# SI units that people read as they are.
M_PER_S = Unit("m/s")
RAD_PER_S = Unit("rad/s")
NEWTON = Unit("N")

# Lengths: deflections and offsets of the ball, and heights of drops.
MM = Unit("mm", 1e3)
CM = Unit("cm", 1e2)
# Contacts last some milliseconds.
MS = Unit("ms", 1e3)
MICROSECONDS = Unit("us", 1e6)
DEG = Unit("deg", 180.0 / pi)
RPM = Unit("rpm", 30.0 / pi)
GRAM = Unit("g", 1e3)
# Vertical stiffness of a ball.
KN_PER_M = Unit("kN/m", 1e-3)
# Torsional over vertical stiffness.
CM2_PER_RAD = Unit("cm^2/rad", 1e4)
# Changes per m/s of vertical speed: of an offset, and of a coefficient.
MM_PER_M_PER_S = Unit("mm/(m/s)", 1e3)
MILLI_S_PER_M = Unit("1e-3 s/m", 1e3)
# Time in which a metre of a picture is read.
MS_PER_M = Unit("ms/m", 1e3)
