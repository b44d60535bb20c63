"""What is told at each time: motions of driven joints, controls, torques held over steps."""
