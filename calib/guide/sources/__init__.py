"""Messages of a robot as they come: from a Foxglove or rosbridge server, or from a recording that grows."""
