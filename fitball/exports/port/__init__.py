"""Ports: kernels as syntax trees -> C, C#, JavaScript, Python, with golden self-test.

Imports: parameter_set, models.
"""

from fitball.exports.port.port import FILES as FILES
from fitball.exports.port.port import port as port
