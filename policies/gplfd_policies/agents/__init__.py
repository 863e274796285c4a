"""Agents: compliant, in lockstep, reaching first, with several modes, model-based."""
