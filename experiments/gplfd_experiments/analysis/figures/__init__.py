"""The paper's figures (arXiv:2002.09979), drawn from logs and synthetic sets."""
