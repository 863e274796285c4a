"""Stiffness from uncertainty, its stability, and the admittance it drives.

*The paper*, to which equations and sections refer, is Arduengo et al., *Gaussian-
Process-based Robot Learning from Demonstration*, arXiv:2002.09979.
"""
