"""Strokes become a model: the learner, its scopes, and the thesis' equations in a room of their own."""
