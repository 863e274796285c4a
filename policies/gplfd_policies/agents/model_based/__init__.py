"""Model-based policies: what a learned policy has to be measured against.

None of them learns from a demonstration. The oracle knows the door; the others
observe what every agent observes, the hand's pose and the force on it, and use a model
of doors: any mechanism (`mechanism_fit`), a circle (`hinge_fit`), or a constant pull
(`pulling`). Their tuned numbers are arguments of their classes.
"""
