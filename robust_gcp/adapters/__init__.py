"""Closed-loop mechanisms in the terms of other libraries; each file needs the one that it is named after."""
