#!/usr/bin/env bash
# Sets up the TORCS car racing simulator for dpsearch; see usage below. Nothing is done twice.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
cache=${XDG_CACHE_HOME:-$HOME/.cache}/dpsearch/torcs
packages=(torcs g++ xz-utils)

usage() {
  cat <<END
Sets up TORCS for the environment dpsearch/TORCS-v0, on Debian or Ubuntu:

  1. installs the packages ${packages[*]} where they are missing (as root, or with sudo);
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

install_packages() {
  local missing=() package
  for package in "${packages[@]}"; do
    case $package in
      g++ | xz-utils) command -v "${package%-utils}" >/dev/null || missing+=("$package") ;;
      *) installed "$package" || missing+=("$package") ;;
    esac
  done
  ((${#missing[@]})) || return 0
  local as_root=()
  if ((EUID != 0)); then
    command -v sudo >/dev/null ||
      fail "the packages ${missing[*]} are missing. Ask an administrator for: apt-get install ${missing[*]}"
    as_root=(sudo)
  fi
  echo "build_torcs: installing ${missing[*]}"
  "${as_root[@]}" apt-get -q update || fail "apt-get update failed"
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q install -y --no-install-recommends "${missing[@]}" ||
    fail "apt-get could not install ${missing[*]}"
}

# The source package, by lists of our own: the system's need not have sources, and are not touched.
fetch_headers() {
  echo "build_torcs: fetching the interface headers from the source package"
  local work list
  work=$(mktemp -d "$cache/download.XXXXXX")
  trap 'rm -rf "$work"' RETURN EXIT
  mkdir -p "$work/lists/partial" "$work/sources"
  for list in /etc/apt/sources.list /etc/apt/sources.list.d/*.list /etc/apt/sources.list.d/*.sources; do
    [[ -f $list ]] && sed -E 's/^deb /deb-src /; s/^Types:.*/Types: deb-src/' "$list" >"$work/sources/${list##*/}"
  done
  local apt=(
    apt-get -q -o Debug::NoLocking=1
    -o Dir::Etc::SourceList=/dev/null -o Dir::Etc::SourceParts="$work/sources"
    -o Dir::State::Lists="$work/lists" -o Dir::Cache::pkgcache= -o Dir::Cache::srcpkgcache=
  )
  ((EUID != 0)) || apt+=(-o APT::Sandbox::User=root) # else apt warns that its own user cannot write here
  "${apt[@]}" update || true                        # a list without source packages is no harm: the next command tells
  (cd "$work" && "${apt[@]}" source --download-only torcs) || fail "apt-get could not fetch the source package of torcs"
  tar -xJf "$work"/torcs_*.orig.tar.xz -C "$work" --strip-components=1 --wildcards \
    '*/src/interfaces/*.h' '*/src/libs/tgf/tgf.h' '*/src/libs/robottools/robottools.h' '*/src/libs/math/*.h' \
    '*/src/linux/osspec.h' || fail "the source package of torcs is not laid out as expected"
  mkdir -p "$work/include/tmath" "$work/include/plib"
  cp "$work"/src/interfaces/*.h "$work"/src/libs/{tgf/tgf,robottools/robottools}.h "$work"/src/linux/osspec.h \
    "$work/include"
  cp "$work"/src/libs/math/*.h "$work/include/tmath"
  cp "$here/robot/sg.h" "$work/include/plib/sg.h"
  rm -rf "$cache/include"
  mv "$work/include" "$cache/include"
}

build_robot() {
  echo "build_torcs: compiling the robot"
  local so
  so=$(mktemp "$cache/lockstep.XXXXXX")
  # -ffp-contract=off: no fused multiplications, so that another compiler's robot computes the same numbers
  g++ -std=c++17 -O2 -Wall -Wextra -Wno-unused-parameter -ffp-contract=off -fPIC -shared \
    -isystem "$cache/include" "$here/robot/lockstep.cpp" -o "$so" || {
    rm -f "$so"
    fail "g++ could not compile $here/robot/lockstep.cpp"
  }
  chmod 755 "$so"
  mv "$so" "$cache/lockstep.so" # at once: a TORCS that is starting finds either the old or the new one
  sources >"$cache/lockstep.sources"
}

# What the robot is compiled from, to see when it is out of date.
sources() { cat "$here"/robot/*.{cpp,hpp,h} | sha256sum; }

if (($#)); then
  usage
  [[ $1 == --help || $1 == -h ]] && exit 0
  exit 2
fi
[[ $(uname -s) == Linux ]] && command -v apt-get >/dev/null ||
  fail "this sets up TORCS on Debian and Ubuntu only"

mkdir -p "$cache"
done_something=
if ! installed torcs || ! command -v g++ >/dev/null || ! command -v xz >/dev/null; then
  install_packages
  done_something=1
fi
if [[ ! -f $cache/include/plib/sg.h ]]; then
  fetch_headers
  done_something=1
fi
if [[ ! -f $cache/lockstep.so || $(sources) != "$(cat "$cache/lockstep.sources" 2>/dev/null)" ]]; then
  build_robot
  done_something=1
fi
echo "build_torcs: TORCS is ready${done_something:+, dpsearch/TORCS-v0 can be made}"
