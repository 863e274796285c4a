"""Other learning methods, for comparison with the Gaussian-process skill.

The rows of Table 1 in Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979: DMP, ProMP, GMM-GMR (`gmr`), GP (`local_gp` and
`wishart_gp`), KMP and GMM-based GP (`gmm_gp`); in addition TP-GMM, ProDMP and MiDiGaP.
"""
