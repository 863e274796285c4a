"""The paper's figures, drawn from logs, demonstrations and synthetic sets.

One module per figure of Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979, named by its number. Each has a ``TITLE``, the
``DOORS`` whose episodes it shows, and three functions: ``measure(material)`` returns
the data, ``draw(shown)`` the figure, ``caption(shown)`` a paragraph about the figure,
the paper's version and the numbers. None of them simulates.
"""
