"""The reference: the article's equations, and other people's solutions."""
