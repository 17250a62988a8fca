"""What a job is, without storage: its states and transitions, its warnings, its piece of the video."""
