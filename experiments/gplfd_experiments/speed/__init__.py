"""Speed of learning, adaptation, alignment and environment, beside other libraries."""
