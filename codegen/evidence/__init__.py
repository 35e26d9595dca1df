"""Evidence on the printed text: it is executed, counted and measured here."""
