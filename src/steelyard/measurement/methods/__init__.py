"""Methods from positions to motion, and smoothers of efforts."""
