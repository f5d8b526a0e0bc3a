"""Results in the formats of others: what drops into ROS, Kalibr, spreadsheets and viewers."""
