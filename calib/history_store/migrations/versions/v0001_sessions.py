"""Robots and sessions.

Kept as it was written: later changes of the tables are migrations of their own.
"""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

_NUMBERS = (
    *("fu_px", "fv_px", "cu_px", "cv_px", "kr", "r_right_m", "r_left_m", "separation_m"),
    *("qx", "qy", "qz", "qw", "x_m", "y_m", "z_m"),
)


def upgrade() -> None:
    """Make the tables."""
    op.create_table(
        "boxcal_robot",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("name", sa.String(200), nullable=False, unique=True),
    )
    op.create_table(
        "boxcal_session",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("robot_id", sa.Integer, sa.ForeignKey("boxcal_robot.id"), nullable=False),
        sa.Column("drive", sa.String(64), nullable=False),
        sa.Column("t_ns", sa.BigInteger, nullable=False),
        *(
            sa.Column(name, sa.String(length), nullable=False)
            for name, length in (
                *(("dated_by", 12), ("calibrated", 40), ("version", 40), ("verdict", 12)),
                *(("hardware", 200), ("target", 64), ("camera_kind", 20)),
            )
        ),
        sa.Column("image_width", sa.Integer, nullable=False),
        sa.Column("image_height", sa.Integer, nullable=False),
        *(sa.Column(name, sa.Double, nullable=False) for name in _NUMBERS),
        sa.Column("covariance", sa.LargeBinary, nullable=False),
        sa.Column("notes", sa.Text, nullable=False),
        sa.UniqueConstraint("robot_id", "drive", name="boxcal_one_session_a_drive"),
    )
    op.create_index("boxcal_session_by_time", "boxcal_session", ["robot_id", "t_ns"])


def downgrade() -> None:
    """Drop them, with all that they hold."""
    op.drop_index("boxcal_session_by_time", "boxcal_session")
    op.drop_table("boxcal_session")
    op.drop_table("boxcal_robot")
