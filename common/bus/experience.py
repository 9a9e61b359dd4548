"""Delivery of experience, both halves: `ExperienceSender` in actors, `ExperienceServer` in the learner."""

from common.bus.receiver import ExperienceServer
from common.bus.seen import SeenSet
from common.bus.sender import ExperienceSender

__all__ = ["ExperienceSender", "ExperienceServer", "SeenSet"]
