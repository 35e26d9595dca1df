"""What tables, figures and pages of all subjects share."""
