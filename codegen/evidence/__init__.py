"""What executes, counts or measures the printed text, so that what is said of it has been seen."""
