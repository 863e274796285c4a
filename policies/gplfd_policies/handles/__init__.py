"""Adapters for doors whose handle turns."""
