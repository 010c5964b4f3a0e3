"""Recordings of sessions: written as they happen, read whole or damaged, replayed, converted."""
