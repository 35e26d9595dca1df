"""The drive files that come with the project, and how any drive file is read."""
