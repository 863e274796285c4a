"""Demonstrations and episodes in files: .npz archives and Minari data sets."""
