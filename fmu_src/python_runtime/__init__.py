"""The core as a slave of pythonfmu.  Packed into FMUs beside a copy of the core; not for import from the source tree."""
