"""Speed of learning, adaptation, alignment and environment, and of other libraries."""
