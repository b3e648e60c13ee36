#!/bin/sh
# Makes .venv/ros, where the tests run the node of docs/examples/ros2: a Python with rclpy, and colcon to build it.
# The wheels of ROS start every Python beside them anew, with their libraries; so they have an environment of their own.
set -eu

folder=.venv/ros
wanted=tests/support/ros2/requirements.txt
cmp -s "$wanted" "$folder/installed" && exit 0
if [ "$(uname -sm)" != "Linux x86_64" ]; then
    echo "There are no wheels of rclpy for this machine: the tests of the ROS node are left out." >&2
    exit 0
fi
echo "The tests of the ROS node need rclpy: setting up $folder ..."
log=$(mktemp)
trap 'rm -f "$log"' EXIT
rm -rf "$folder"
if ! { .venv/bin/python -m venv "$folder" && "$folder/bin/python" -m pip install -qq --disable-pip-version-check \
        -c constraints.txt -r "$wanted" -e . ; } >"$log" 2>&1; then
    tail -5 "$log" >&2
    echo "Installing rclpy failed: the tests of the ROS node are left out." >&2
    exit 0
fi
cp "$wanted" "$folder/installed"
echo "Set up."
