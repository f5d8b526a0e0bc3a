"""A store of calibrations over time, in any database that SQLAlchemy speaks to."""
