"""Stops, dry friction and locks: a run through phases of smooth motion.

rows             r(q) of each part, as rows of velocities
admissible       admissible velocities and accelerations at an instant, without a choice of y
driven           joints that move as prescribed, in these
quadratic_programs  forces within bounds, of a few unknowns
impact           impulses: Newton's restitution
bearings         dry friction as a share of reactions
sliding          the same while joints slip, where it acts on its reactions
decision         Gauss's principle at rest: what is held, slips, leaves
machine          the mechanism of a phase, in which what is held is one more closure
phase_run        steps of a phase that go on from each other, in one run
partial_steps    single steps of a phase, to events
polynomial_zeros, watch  events on a stretch, and how well what is held is held
first_event      the first event on steps, located on a partial step
at_rest          a phase in which nothing can move
grid             ends of steps, and which outputs are kept
record           the record of all stretches as one trajectory
progress         where a motion is, and its record; copied and put back
course           from phase to phase; round_cusp: round the cusps of a mode
run_phases, phased_simulation  a run of `simulate`; a `Simulation`
transitions, links, saltation, chain, gradient  derivatives through all of these
"""
