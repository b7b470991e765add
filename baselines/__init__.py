"""The papers' trackers and their rivals, one file each; none knows another."""
