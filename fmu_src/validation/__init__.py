"""FMUs from outside: what they are run under, the reference under the same inputs, the comparison, the report."""
