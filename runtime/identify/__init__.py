"""Motor data from recordings: maximum likelihood of the innovations of the drive's own symbolic model."""
