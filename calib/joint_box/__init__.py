"""Joint solution of many robots that drove around one box: its true shape, and what that makes of each robot."""
