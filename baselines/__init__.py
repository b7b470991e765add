"""The papers' trackers and their rivals, one file each; none imports another."""
