"""What a robot knows and the graph it plans on: belief, frontiers, viewpoints, utility and beacons, all incremental."""
