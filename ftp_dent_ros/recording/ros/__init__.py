"""The end of recording that speaks ROS: topics into a bag, a bag onto topics."""
