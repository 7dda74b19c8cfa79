# packages.sh: how tools/setup and tools/compare-vtk install Debian packages. To be sourced; `fail` is the caller's.

installed() {
    [ "$(dpkg-query -W -f '${db:Status-Status}' "$1" 2>/dev/null)" = installed ]
}

as_root() {
    if [ "$(id -u)" = 0 ]; then
        "$@"
    elif command -v sudo >/dev/null; then
        sudo "$@"
    else
        fail "root is needed for: $* (run this script as root, or install sudo)"
    fi
}

# install_packages NAME PACKAGE...: those that are missing; NAME says who installs.
install_packages() {
    local name=$1 missing=() package
    shift
    for package in "$@"; do
        installed "$package" || missing+=("$package")
    done
    if [ ${#missing[@]} = 0 ]; then
        echo "$name: all packages are installed"
        return
    fi
    echo "$name: installing ${missing[*]}"
    local install=(env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends)
    # Lists may be absent or old: they are fetched once it is known that they are needed.
    as_root "${install[@]}" "${missing[@]}" || {
        as_root apt-get update
        as_root "${install[@]}" "${missing[@]}"
    }
}

# system_id: "debian" on Debian.
system_id() {
    # shellcheck disable=SC1091 # of this machine
    (. /etc/os-release 2>/dev/null && echo "${ID-}") || true
}
