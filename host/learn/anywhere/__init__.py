"""Lumps that lie anywhere in tissue that the probe knows nothing about: what can be known of them."""
