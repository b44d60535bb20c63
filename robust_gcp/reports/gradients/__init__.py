"""A test set of derivatives of closed-loop mechanisms, which any tool can be scored by.

`problems.json` holds linkages, planar and in space, at regular states, near and at singular configurations,
with u̇ and its derivatives by y, u and τ from seventy-digit arithmetic: see `scores.Problem`.
"""
