"""The application: plans rounds, flies them, gates the learning by the radio, and logs it all."""
