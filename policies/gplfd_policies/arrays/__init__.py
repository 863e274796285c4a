"""Immutable records of arrays, rows of a batch, one-thread linear algebra, archives."""
