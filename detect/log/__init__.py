"""Reading a robot's log: messages, topics, encoders and camera frames."""
