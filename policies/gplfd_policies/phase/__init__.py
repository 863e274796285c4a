"""Which phase of the task an observed pose belongs to."""
