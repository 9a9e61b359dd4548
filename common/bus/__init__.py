"""The Zenoh bus: sessions, delivery of experience, weights, presence, statistics and control."""
