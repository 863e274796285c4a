"""How fast learning, adaptation, alignment and environment are, beside other libraries.

Figures that only developers need are measured by the scripts of the checkout's folder
``benchmarks``, with the same tools.
"""
