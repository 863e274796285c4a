"""Model-based policies, for comparison with learned policies.

None of them learns from a demonstration. The oracle knows the door; the others observe
the hand's pose and the force on it, and use a model of doors.
"""
