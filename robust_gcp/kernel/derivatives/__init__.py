"""The kernel's derivatives, of accelerations and of steps."""
