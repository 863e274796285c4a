"""gplfd: doors opened by policies that learned from demonstrations."""
