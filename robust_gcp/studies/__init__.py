"""Studies, the paper's figures first, and how they are drawn."""
