"""Model-based policies, for comparison with learned policies.

None of them learns from a demonstration. The oracle knows the door. The others observe
the hand's pose and the force on it, like every agent, and use a model of doors: any
mechanism (`mechanism`), a circle, or a constant pull (`following`).
"""
