"""Where methods fail: the studies of docs/stability.md."""
