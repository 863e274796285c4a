"""The paper's figures, drawn from logs, demonstrations and synthetic sets.

One module per figure of Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979, named by its number. Each measures (data in, numbers
out), draws (numbers in, figure out) and writes its caption. None of them simulates.
"""
