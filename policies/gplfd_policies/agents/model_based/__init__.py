"""Reference agents: what a learned policy has to be measured against.

None of them learns from a demonstration. The oracle is told the door; the others
observe what every agent observes, the hand's pose and the force on it, and know of
doors what an engineer knows, from a whole circle (`hinge_fit`) to nothing at all
(`compliant_pull`).
"""
