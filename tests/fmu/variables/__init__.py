"""The table of variables, and modelDescription.xml."""
