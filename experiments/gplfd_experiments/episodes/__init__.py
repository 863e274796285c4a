"""One episode, or many in lockstep: the loop, its log and its metrics."""
