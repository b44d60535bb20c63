"""Studies: the paper's figures, and what they are made with. Matplotlib is imported when drawing."""
