"""Films and recordings: frames with their own stamps, the ball in them, bounces by their sound."""
