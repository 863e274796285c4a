"""How well a policy learns a skill, measured without a simulator."""
