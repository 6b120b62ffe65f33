#!/bin/sh
# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
#
# Usage: setup.sh [ENVIRONMENT [EXTRAS]]
# Make a virtual environment (.venv) and install the package with extras (bags,plots,test,docs) into it;
# return at once if that is already done. ROS 2 is the sourced one, or else the wheels on PyPI of
# ROS_DISTRO, for which there has to be a file tools/ROS_DISTRO.txt. The other libraries are the newest, or those of tools/VERSIONS.txt.
set -eu
cd "$(dirname "$0")/.."
python=${PYTHON:-python3}
name=${1:-.venv}
extras=${2:-bags,plots,test,docs}
venv=$PWD/$name
distro=${ROS_DISTRO:-jazzy}
wheels=tools/$distro.txt
versions=${VERSIONS:+tools/$VERSIONS.txt}
export PIP_DISABLE_PIP_VERSION_CHECK=1

fail() {
    echo "linkage_vibration: $*" >&2
    exit 1
}

apt() {
    if [ "$(id -u)" = 0 ]; then sudo=; else sudo='sudo '; fi
    echo "${sudo}apt-get update && ${sudo}apt-get install -y $*"
}

# Look at the machine; Python starts only once for all its facts.
command -v "$python" > /dev/null ||
    fail "$python was not found; run: $(apt g++ python3 python3-venv python3-dev)"
facts=$("$python" - 2> /dev/null << 'END'
import importlib.util, os, platform, sys, sysconfig
rclpy = importlib.util.find_spec("rclpy") if os.environ.get("AMENT_PREFIX_PATH") else None
print("minor=%d" % (sys.version_info[1] if sys.version_info[0] == 3 else 0))
print("base='%s'" % sys.base_prefix)
print("machine=%s" % platform.machine())
print("pip=%d" % (importlib.util.find_spec("ensurepip") is not None))
print("headers=%d" % os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))
print("rclpy='%s'" % (rclpy.origin if rclpy else ""))
END
) || fail "$python does not work as Python 3; name another one: make PYTHON=python3.12"
eval "$facts"

[ "$minor" -ge 10 ] ||
    fail "Python 3.10 or later is needed and $python is 3.$minor; name another one: make PYTHON=python3.12"
missing=
[ "$pip" = 1 ] || missing="$missing python3.$minor-venv"
[ "$headers" = 1 ] || missing="$missing python3.$minor-dev"
command -v ${CXX:-c++} > /dev/null || missing="$missing g++"
if [ -n "${AMENT_PREFIX_PATH:-}" ]; then
    command -v cmake > /dev/null || missing="$missing cmake"
    [ -n "$rclpy" ] ||
        fail "a ROS 2 is sourced, but $python cannot import its rclpy; run: make PYTHON=/usr/bin/python3"
    wheels=
elif [ ! -f "$wheels" ] && [ "$distro" = lyrical ]; then
    fail "PyPI has no wheels of ROS 2 Lyrical yet; source an installed Lyrical" \
        "(. /opt/ros/lyrical/setup.sh), or run: make ROS_DISTRO=jazzy (or kilted)"
elif [ ! -f "$wheels" ]; then
    fail "the wheels of ROS_DISTRO=$distro cannot be used; run: make ROS_DISTRO=jazzy (or kilted)"
elif ! grep -q "^# For .*3\.$minor.* on $machine\.$" "$wheels"; then
    fail "this is Python 3.$minor on $machine, but the wheels of ROS 2 $distro are" \
        "$(sed -n 's/^# For \(.*\)\.$/for \1/p' "$wheels");" \
        "source a ROS 2 first, or name another Python: make PYTHON=python3.12"
fi
[ -z "$versions" ] || [ -f "$versions" ] ||
    fail "VERSIONS=$VERSIONS cannot be used; run: make test VERSIONS=ubuntu-24.04"
[ -z "$missing" ] || fail "packages are missing:$missing; run: $(apt $missing)"

# Compare with what .venv was created for and from. The package itself is installed editable, so its
# files are always current.
environment="$venv 3.$minor $base ${rclpy:-$distro} $extras${VERSIONS:+ $VERSIONS}"
sources=$(find package.xml setup.py tools/setup.sh $wheels $versions linkage_vibration_interfaces \
    -type f | sort | xargs cksum)
if [ "$(cat "$venv/environment" 2> /dev/null)" != "$environment" ]; then
    rm -rf "$venv"
elif [ "$(cat "$venv/sources" 2> /dev/null)" = "$sources" ]; then
    exit 0
fi

if [ ! -d "$venv" ]; then
    echo "Making $name with Python 3.$minor"
    "$python" -m venv ${rclpy:+--system-site-packages} "$venv"
    echo "$environment" > "$venv/environment"
    if [ -n "$rclpy" ]; then
        # Put .venv on top of the sourced ROS 2, as its own set-up files do.
        cat >> "$venv/bin/activate" << END
export AMENT_PREFIX_PATH="$venv:\$AMENT_PREFIX_PATH"
export LD_LIBRARY_PATH="$venv/lib:\${LD_LIBRARY_PATH:-}"
END
    fi
fi

# setuptools writes the metadata of the package here, since two environments may be made at once.
metadata=$venv/metadata.cfg
printf '[egg_info]\negg_base = %s\n' "$venv" > "$metadata"
if [ -z "$rclpy" ]; then
    echo "Installing ROS 2 $distro from PyPI and linkage_vibration into $name (once, some minutes)"
    # Python compiles only the modules that are imported, so that takes less time than all of them.
    {
        DIST_EXTRA_CONFIG=$metadata "$venv/bin/pip" install -qq --no-compile \
            ${versions:+-c "$versions"} -r "$wheels" --editable ".[$extras]" &&
            "$venv/bin/pip" install -qq --no-deps --no-build-isolation ./linkage_vibration_interfaces
    } || fail "pip could not install everything; see its messages above"
else
    echo "Building linkage_vibration_interfaces for the sourced ROS 2 (${rclpy%/rclpy/*})"
    log=$venv/interfaces.log
    {
        CMAKE_PREFIX_PATH="$AMENT_PREFIX_PATH:${CMAKE_PREFIX_PATH:-}" \
            cmake -S linkage_vibration_interfaces -B "$venv/interfaces" -DBUILD_TESTING=OFF \
            -DCMAKE_INSTALL_PREFIX="$venv" -DPython3_EXECUTABLE="$venv/bin/python" &&
            cmake --build "$venv/interfaces" --parallel 2 --target install
    } > "$log" 2>&1 || fail "the build of linkage_vibration_interfaces failed; see $log"
    echo "Installing linkage_vibration into $name"
    # Keep the NumPy that this ROS 2 was compiled with.
    "$venv/bin/python" -c 'import numpy; print("numpy==" + numpy.__version__)' > "$venv/numpy.txt"
    DIST_EXTRA_CONFIG=$metadata "$venv/bin/pip" install -qq --constraint "$venv/numpy.txt" \
        ${versions:+-c "$versions"} --editable ".[$extras]" ||
        fail "pip could not install everything; see its messages above"
fi
# An editable install lacks what `ros2 run` and `ros2 launch` look for.
share=$venv/share/linkage_vibration
mkdir -p "$share" "$venv/share/ament_index/resource_index/packages" "$venv/lib/linkage_vibration"
ln -sfn "$PWD/resource/linkage_vibration" "$venv/share/ament_index/resource_index/packages/"
ln -sfn "$PWD/package.xml" "$PWD/config" "$PWD/launch" "$share/"
ln -sfn "$venv/bin/linkage_vibration_node" "$venv/bin/linkage-vibration" "$venv/lib/linkage_vibration/"
echo "$sources" > "$venv/sources"
