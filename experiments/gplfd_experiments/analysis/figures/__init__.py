"""The paper's figures, drawn from logs, demonstrations and synthetic sets.

After Arduengo et al., *Gaussian-Process-based Robot Learning from Demonstration*,
arXiv:2002.09979. None of the figures simulates.
"""
