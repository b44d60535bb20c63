"""The spanning tree: joints, M and C by Pinocchio, motions of bodies."""
