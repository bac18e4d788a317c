"""The host's half of training: settings, folders, checkpoints, the loop and what it reports."""
