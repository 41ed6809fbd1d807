"""Ports: kernels as syntax trees -> C, C#, JavaScript, Python, with golden self-test."""

from fitball.exports.ports.text import FILES as FILES
from fitball.exports.ports.text import port as port
