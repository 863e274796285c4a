"""Doors as records: configuration, standards, geometry, randomization, disturbances."""
