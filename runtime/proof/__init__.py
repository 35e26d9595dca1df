"""The chain of proof: a second opinion written by hand, and the comparison with what was generated."""
