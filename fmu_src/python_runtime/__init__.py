"""The core as a slave of pythonfmu.  Packed into FMUs beside a copy of the core; not imported from the source tree."""
