"""The tests, in folders that mirror the rooms of what they test."""
