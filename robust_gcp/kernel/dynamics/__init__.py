"""What acts in the kernel, and what is measured along motions."""
