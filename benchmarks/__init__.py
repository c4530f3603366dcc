"""What this project measures of itself and of others, and the pages that it writes in docs/: python -m benchmarks.SUBJECT.NAME"""
