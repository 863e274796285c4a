"""Gaussian-process regression for demonstrations that share their time stamps.

*The paper*, to which equations and sections refer, is Arduengo et al., *Gaussian-
Process-based Robot Learning from Demonstration*, arXiv:2002.09979.
"""
