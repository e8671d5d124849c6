"""A ROS 2 node around stream_sfm."""
