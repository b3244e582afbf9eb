#!/usr/bin/env bash
# Installs the Debian packages of a set of packages.apt that are missing. Usage: packages.sh SET
set -euo pipefail
cd "$(dirname "$0")"
missing=()
while read -r set package; do
  [ "$set" = "$1" ] || continue
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
done < packages.apt
[ ${#missing[@]} -gt 0 ] || exit 0

install="apt-get -o DPkg::Lock::Timeout=300 install -y --no-install-recommends ${missing[*]}"
if [ "$(id -u)" = 0 ]; then
  sudo=""
elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
  sudo="sudo"
else
  echo "packages are missing and this user cannot install them; as root run: apt-get update && $install" >&2
  exit 2
fi
echo "Installing ${missing[*]} …"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
export DEBIAN_FRONTEND=noninteractive
if ! { $sudo apt-get -o DPkg::Lock::Timeout=300 update && $sudo $install; } >"$log" 2>&1 </dev/null; then
  tail -20 "$log" >&2
  echo "installing packages failed; as root run: apt-get update && $install" >&2
  exit 2
fi
