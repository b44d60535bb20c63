"""Stops, dry friction and locks: a run through phases of smooth motion.

parts        what a user names: `Stop`, `JointFriction`, `Lock`
rows         r(q) of each, as rows of velocities
frame        admissible velocities and accelerations at an instant, without a choice of y
box          quadratic programs and linear ones of a few unknowns
impact       impulses: Newton's restitution
decision     Gauss's principle at rest: what is held, slips, leaves
machine      the mechanism of a phase, in which what is held is one more closure
watch        events on a stretch: all roots of quintics, and how well what is held is held
leg          steps of a phase that go on from each other, in one run
bearings     dry friction as a share of reactions
sliding      the same while joints slip, where it acts on its reactions
partial      single steps of a phase, to events
stretch      the first event on steps, located on a partial step
joined       the record of all stretches as one trajectory
chosen, grid outputs that are kept, ends of steps
progress     where a motion is, and its record; saved and put back
course       from phase to phase
whole, stepwise  a run of `simulate`; a `Simulation`
"""
