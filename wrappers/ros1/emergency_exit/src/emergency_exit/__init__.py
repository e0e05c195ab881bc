"""Emergency Exit for ROS: the world's rules and the logs of its agents."""
