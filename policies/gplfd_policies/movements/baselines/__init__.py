"""Other learning methods, for comparison with the Gaussian-process skill.

Those of Table 1 in Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979, and others; docs/notes/methods.md has their sources.
"""
