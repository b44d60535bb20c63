"""Drawing: motions, mechanisms and configuration spaces."""
