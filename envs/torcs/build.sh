#!/usr/bin/env bash
# Sets up the TORCS car racing simulator for dpsearch; see usage below. Nothing is done twice.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
cache=${XDG_CACHE_HOME:-$HOME/.cache}/dpsearch/torcs
# Named after what it is compiled from, as installation.py has it too: each version of dpsearch finds its own.
robot=$cache/lockstep-$(cat "$here"/robot/*.{cpp,hpp} "$here/robot/plib/sg.h" | sha256sum | cut -c 1-16).so

usage() {
  cat <<END
Sets up TORCS for the environment dpsearch/TORCS-v0, on Debian or Ubuntu:

  1. installs the packages torcs, g++ and xz-utils where they are missing (as root, or with sudo);
  2. fetches TORCS' interface headers from the distribution's source package (394 MB, not kept);
  3. compiles the robot that lets dpsearch drive.

What 2 and 3 make goes to $cache
and needs no rights. A second call finds everything in place.

usage: build_torcs.sh [--help]
END
}

fail() {
  echo "build_torcs: $*" >&2
  exit 1
}

installed() { dpkg-query --show --showformat='${db:Status-Status}' "$1" 2>/dev/null | grep --quiet '^installed$'; }

# Those of the packages that are not there; a compiler and xz may have come otherwise.
missing_packages() {
  installed torcs || echo torcs
  command -v g++ >/dev/null || echo g++
  command -v xz >/dev/null || echo xz-utils
}

install_packages() {
  local as_root=()
  if ((EUID != 0)); then
    command -v sudo >/dev/null || fail "ask an administrator for: apt-get install --no-install-recommends $*"
    as_root=(sudo)
  fi
  echo "build_torcs: installing $*"
  "${as_root[@]}" apt-get -q update || fail "apt-get update failed"
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q install -y --no-install-recommends "$@" ||
    fail "apt-get could not install $*"
}

# The source package, by lists of our own: the system's need not have sources, and are not touched.
fetch_headers() (
  echo "build_torcs: fetching the interface headers from the source package"
  work=$(mktemp -d "$cache/download.XXXXXX")
  trap 'rm -rf "$work"' EXIT
  mkdir -p "$work/lists/partial" "$work/sources"
  for list in /etc/apt/sources.list /etc/apt/sources.list.d/*.list /etc/apt/sources.list.d/*.sources; do
    if [[ -f $list ]]; then
      sed -E 's/^deb /deb-src /; s/^Types:.*/Types: deb-src/' "$list" >"$work/sources/${list##*/}"
    fi
  done
  apt=(
    apt-get -q -o Debug::NoLocking=1
    -o Dir::Etc::SourceList=/dev/null -o Dir::Etc::SourceParts="$work/sources"
    -o Dir::State::Lists="$work/lists" -o Dir::Cache::pkgcache= -o Dir::Cache::srcpkgcache=
  )
  if ((EUID == 0)); then # else apt works as a user who may not write here
    apt+=(-o APT::Sandbox::User=root)
  fi
  "${apt[@]}" update || true # a list without source packages does no harm, and the next command tells
  (cd "$work" && "${apt[@]}" source --download-only torcs) || fail "apt-get could not fetch the source package of torcs"
  tar -xJf "$work"/torcs_*.orig.tar.xz -C "$work" --strip-components=1 --wildcards \
    '*/src/interfaces/*.h' '*/src/libs/tgf/tgf.h' '*/src/libs/robottools/robottools.h' '*/src/libs/math/*.h' \
    '*/src/linux/osspec.h' || fail "the source package of torcs is not laid out as expected"
  mkdir -p "$work/include/tmath"
  cp "$work"/src/interfaces/*.h "$work"/src/libs/{tgf/tgf,robottools/robottools}.h "$work"/src/linux/osspec.h \
    "$work/include"
  cp "$work"/src/libs/math/*.h "$work/include/tmath"
  rm -rf "$cache/include"
  mv "$work/include" "$cache/include"
)

build_robot() {
  echo "build_torcs: compiling the robot"
  local so
  so=$(mktemp "$cache/lockstep.XXXXXX")
  # -ffp-contract=off: no fused multiplications, so that another compiler's robot computes the same numbers
  g++ -std=c++17 -O2 -Wall -Wextra -Wno-unused-parameter -ffp-contract=off -fPIC -shared \
    -I "$here/robot" -isystem "$cache/include" "$here/robot/lockstep.cpp" -o "$so" || {
    rm -f "$so"
    fail "g++ could not compile $here/robot/lockstep.cpp"
  }
  chmod 755 "$so"
  mv "$so" "$robot"
}

if (($#)); then
  usage
  [[ $1 == --help || $1 == -h ]] && exit 0
  exit 2
fi
command -v apt-get >/dev/null || fail "this sets up TORCS on Debian and Ubuntu only"

mkdir -p "$cache"
verb="is"
mapfile -t missing < <(missing_packages)
if ((${#missing[@]})); then
  install_packages "${missing[@]}"
  verb="is now"
fi
if [[ ! -f $cache/include/robot.h ]]; then
  fetch_headers
  verb="is now"
fi
if [[ ! -f $robot ]]; then
  build_robot
  verb="is now"
fi
echo "build_torcs: TORCS $verb ready for dpsearch/TORCS-v0"
