"""Do plans keep what they promise? Tables are simulated at planned impacts from a truth drawn from the posterior and
fitted together with the first table; compared is by how much sds fell, and by how much at as many of its own impacts.
"""
