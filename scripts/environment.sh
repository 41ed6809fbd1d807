# Sourced by run, scripts/test and scripts/tool: makes .venv once with the pinned versions, and for the first two installs
# the built package in it anew whenever its sources change. Needs nothing but a Python of version 3.11 or newer. Sets
# `root` and `venv`. What is not imported is not compiled, a quarter of the way to a first report.

root=$(CDPATH= cd -- "$(dirname -- "${environment:-$0}")/.." && pwd)
venv="$root/.venv"

fail() {
    printf '%s\n' "$*" >&2
    exit 2
}

find_python() {
    for candidate in "${FITBALL_PYTHON:-}" python3.13 python3.12 python3.11 python3 python; do
        [ -n "$candidate" ] && command -v "$candidate" >/dev/null 2>&1 || continue
        if "$candidate" -c 'import sys; sys.exit(not sys.version_info >= (3, 11))' 2>/dev/null; then
            printf '%s\n' "$candidate"
            return
        fi
    done
    fail "fitball needs Python 3.11 or newer: none was found on PATH." \
        "Install one, or name it: FITBALL_PYTHON=/path/to/python3 $0"
}

# What the environment and the package in it were made from.
packages() {
    cksum <"$root/requirements.lock"
}

sources() {
    (cd "$root" && find fitball datasets pyproject.toml README.md -type f ! -name '*.pyc' -exec cksum {} + | sort | cksum)
}

made_from() {
    [ -f "$venv/$1.stamp" ] && [ "$(cat "$venv/$1.stamp")" = "$2" ]
}

has_packages() {
    made_from packages "$(packages)"
}

# An editable install has no folder of the package here, and is no built one.
has_package() {
    ls "$venv"/lib/python*/site-packages/fitball/__init__.py >/dev/null 2>&1 && made_from sources "$(sources)"
}

make_environment() {
    python=$(find_python) || exit 2
    printf 'fitball: making %s (once; about a minute) ...\n' "$venv" >&2
    "$python" -m venv --clear "$venv" ||
        fail "fitball: '$python -m venv' failed; on Debian and Ubuntu install the package python3-venv."
    "$venv/bin/python" -m pip install --quiet --no-input --disable-pip-version-check --no-deps --no-compile \
        --requirement "$root/requirements.lock" 2>"$venv/pip.log" ||
        { cat "$venv/pip.log" >&2; fail "fitball: the pinned packages could not be installed; the lines above say why."; }
    packages >"$venv/packages.stamp"
}

install_package() {
    rm -f "$venv/sources.stamp"
    wheel=$(mktemp -d)
    "$venv/bin/python" -m pip wheel --quiet --no-input --disable-pip-version-check --no-deps --no-build-isolation \
        --no-index --wheel-dir "$wheel" "$root" &&
        "$venv/bin/python" -m pip install --quiet --no-input --disable-pip-version-check --no-deps --no-index \
            --force-reinstall "$wheel"/*.whl || fail "fitball: the package could not be built; the lines above say why."
    rm -rf "$wheel"
    sources >"$venv/sources.stamp"
}

# Of two calls at once the second waits for the first.
lock() {
    if command -v flock >/dev/null 2>&1; then
        exec 9>"$root/.venv.lock"
        flock 9
    fi
}

ensure_packages() {
    has_packages && return
    lock
    has_packages || make_environment
    exec 9>&-
}

ensure_environment() {
    has_packages && has_package && return
    lock
    has_packages || make_environment
    has_package || install_package
    exec 9>&-
}
