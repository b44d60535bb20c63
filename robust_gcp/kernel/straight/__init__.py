"""Straight-line code of one mechanism's regular steps, compiled where it is needed."""
