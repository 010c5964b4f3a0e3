"""Palpate on the host: features, regression, link, recording, command line."""
