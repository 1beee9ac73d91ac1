"""Python package of the node, for colcon (ament_python)."""

from setuptools import setup

NAME = "bowstring_follower"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["setuptools", "bowstring"],
    zip_safe=True,
    maintainer="The Bowstring authors",
    maintainer_email="maintainers@example.org",
    description="Follows targets of the tip of a tendon-driven continuum robot by physics.",
    license="MIT",
    entry_points={"console_scripts": [f"follower = {NAME}.node:main"]},
)
