"""The package tidemap_ros, as colcon builds it."""

from setuptools import setup

NAME = "tidemap_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/tidemap.launch.xml"]),
        (f"share/{NAME}/config", ["config/tidemap.yaml"]),
    ],
    # And `tidemap`, the client, which comes from pip.
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="The Tidemap developers",
    maintainer_email="developers@tidemap.invalid",
    description="Tidemap beside Nav2: scans in through an outbox, the predicted map out on a latched topic.",
    license="BSD-3-Clause",
    entry_points={"console_scripts": [f"tidemap = {NAME}.node:main"]},
)
