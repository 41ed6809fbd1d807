"""Ports: kernels as syntax trees -> C, C#, JavaScript, Python, with golden self-test."""

from fitball.exports.port.port import FILES as FILES
from fitball.exports.port.port import port as port
