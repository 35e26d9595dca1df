"""The common parts of tables, figures and pages of all subjects."""
