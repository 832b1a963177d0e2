from setuptools import setup

NAME = "markergen_ros"

setup(
    name=NAME,
    version="1.0.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/markers_launch.py"]),
    ],
    install_requires=["setuptools", "markergen-detect"],
    license="MIT",
    entry_points={"console_scripts": ["detect = markergen_ros.node:main"]},
)
