"""Stops, dry friction and locks: a run through phases of smooth motion.

parts        what a user names: `Stop`, `JointFriction`, `Lock`
rows         r(q) of each, as rows of velocities
frame        admissible velocities and accelerations at an instant, without a choice of y
box          quadratic programs and linear ones of a few unknowns
impact       impulses: Newton's restitution
decision     Gauss's principle at rest: what is held, slips, leaves
machine      the mechanism of a phase, in which what is held is one more closure
watch        events on a stretch: all roots of quintics, and how well what is held is held
joined       the record of all stretches as one trajectory
course       from phase to phase
"""
