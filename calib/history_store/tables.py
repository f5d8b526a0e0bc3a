"""Tables of the store, as they are in its newest version."""

import sqlalchemy as sa

metadata = sa.MetaData()
VERSION_TABLE = "boxcal_version"
"""Where Alembic keeps which version a store is of."""

robots = sa.Table(
    "boxcal_robot",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("name", sa.String(200), nullable=False, unique=True),
)

NUMBERS = (
    *("fu_px", "fv_px", "cu_px", "cv_px", "kr"),
    *("r_right_m", "r_left_m", "separation_m"),
    *("qx", "qy", "qz", "qw"),
    *("x_m", "y_m", "z_m"),
)
"""Columns of values: camera, wheels, orientation and place of the camera in the body."""

sessions = sa.Table(
    "boxcal_session",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("robot_id", sa.Integer, sa.ForeignKey("boxcal_robot.id"), nullable=False),
    sa.Column("drive", sa.String(64), nullable=False),
    sa.Column("t_ns", sa.BigInteger, nullable=False),
    sa.Column("dated_by", sa.String(12), nullable=False),
    sa.Column("calibrated", sa.String(40), nullable=False),
    sa.Column("version", sa.String(40), nullable=False),
    sa.Column("verdict", sa.String(12), nullable=False),
    sa.Column("hardware", sa.String(200), nullable=False),
    sa.Column("target", sa.String(64), nullable=False),
    sa.Column("camera_kind", sa.String(20), nullable=False),
    sa.Column("image_width", sa.Integer, nullable=False),
    sa.Column("image_height", sa.Integer, nullable=False),
    *(sa.Column(name, sa.Double, nullable=False) for name in NUMBERS),
    sa.Column("covariance", sa.LargeBinary, nullable=False),
    sa.Column("notes", sa.Text, nullable=False),
    sa.UniqueConstraint("robot_id", "drive", name="boxcal_one_session_a_drive"),
    sa.Index("boxcal_session_by_time", "robot_id", "t_ns"),
)
"""One row a drive of a robot; ``covariance`` holds the lower triangle of the 14 x 14 matrix, by rows, as little-endian
doubles."""
