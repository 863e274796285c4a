"""A study on one page: numbers, their intervals, paired tests and plots."""
