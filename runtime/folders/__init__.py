"""From the word DRIVE to a generated folder: write it, find it, is it current, and the drive it states."""
