"""The command ``gplfd``."""
