"""What counts as zero: every threshold on a rank or a residual, dimensionless, with its reason.

Matrices are scaled before they are judged: rows of φ by the characteristic length or one radian, columns of
K by `ClosedLoops.column_scale`. A threshold on singular values is relative to the largest.
"""

from __future__ import annotations

# ----------------------------------------------------------------- configurations

CLOSED = 1e-12
"""Largest |φ| / length of a configuration that counts as closed: some thousand roundings."""

NEARLY_CLOSED = 1e-6
"""Largest |φ| / length of a start that is polished instead of refused: rounded input, not an open loop."""

ROUNDED = 1e-3
"""Distance from 1 of the norm of a quaternion that is normalised instead of refused: rounded input."""

COMPATIBLE = 1e-6
"""Largest |K v| relative to |K| |v| of an initial velocity that satisfies the constraint: rounded input."""

# ----------------------------------------------------------------- ranks of K

STRUCTURAL = 1e-9
"""Entries and singular values below it at generic configurations are zero in all: rounding of K is 1e-15
there, and a direction that closures determine is seldom worse conditioned than 1e-6."""

RANK = 1e-8
"""Of K at one configuration. Near a singularity σ grows like the distance, and a configuration typed or
computed to 1e-9 rad should be recognised as the singular one."""

RANK_NEARBY = 1e-6
"""Of K at a distance of 1e-2 from a configuration that may be singular: σ has grown to 1e-2 there where K is
regular nearby, and to 1e-4 of a tangential meeting; what is smaller is redundant."""

POLISHED = 1e-6
"""Singular directions of K that Newton's steps leave alone: φ ≤ `NEARLY_CLOSED` divided by more than that
would move q by more than its input was rounded."""

DETERMINES = 1e-6
"""Share of the whole motion below which a joint counts as at rest: it neither parametrises the motion nor is
it left undetermined. A joint that moves has seldom less than 1e-3 of it; rounding leaves 1e-9 and less."""

# ----------------------------------------------------------------- starts and curves

SINGULAR_START = 1e-5
"""Conditioning of K_d below which a start counts as singular: G has lost ten digits there."""

SAME_MODE = 1e-4
"""Sine of the largest angle, dimensionless velocities, between tangents of the same mode."""

SINGULAR_HOME = 1e-6
"""Conditioning of K below which home itself is a singular point of a traced space: half of all digits."""

BENDING = 1e-3
"""Directions of K that a curve's curvature leaves out: near a singular point they are rounding over σ²."""

LOCATING = 1e-10
"""Of the system that locates a singular point, square but for rows that depend on others."""

FORM = 1e-6
"""Eigenvalue ratio below which a direction of a second-order form counts as flat: forms are differences of k
with some ten digits."""
