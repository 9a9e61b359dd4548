"""The relay: joins a robot's DDS network and the Zenoh network of the bridge, by rclpy."""
