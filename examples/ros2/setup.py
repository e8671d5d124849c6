from glob import glob

from setuptools import setup

NAME = "stream_sfm_ros"

setup(
    name=NAME,
    version="1.0.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.py")),
    ],
    install_requires=["stream-sfm"],
    entry_points={"console_scripts": [f"odometry = {NAME}.node:main"]},
)
