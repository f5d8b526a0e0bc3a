"""Changes of the store from version to version, as Alembic runs them."""
