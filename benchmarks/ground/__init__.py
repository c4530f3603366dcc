"""Structures on the ground: what honeycombs do to a landing, and rolling by rest lengths."""
