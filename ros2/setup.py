"""The ROS 2 package: its nodes are those of the Python package `hdplanner`, which pip installs."""

from pathlib import Path

from setuptools import setup

NAME = "hdplanner_ros"
FOLDERS = ("launch", "config", "rviz", "foxglove")

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *((f"share/{NAME}/{folder}", sorted(map(str, Path(folder).iterdir()))) for folder in FOLDERS),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    license="Apache-2.0",
    entry_points={"console_scripts": [f"bridge = {NAME}.nodes:bridge", f"relay = {NAME}.nodes:relay"]},
)
