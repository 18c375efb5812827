"""Recordings with a known truth: what their files hold, and what is true of them."""
