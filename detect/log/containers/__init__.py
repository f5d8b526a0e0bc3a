"""The kinds of recording, a file each: MCAP, ROS 2 bag folders, sqlite3, ROS 1 bags, packed files, plain folders."""
