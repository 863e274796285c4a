"""How fast and how accurate the Gaussian processes are, beside other libraries."""
