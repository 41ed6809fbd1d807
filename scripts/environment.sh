# Sourced by run, scripts/test and scripts/tool: makes .venv once with the pinned versions of requirements.lock, all that
# fitball imports and what builds it; the last two add requirements-dev.lock. For the first two the built package is
# installed in it anew whenever its sources change. Needs nothing but a Python of version 3.11 or newer; uv is used where
# it is on PATH. Sets `root` and `venv`. What is not imported is not compiled, a quarter of the way to a first report.

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

tools() {
    cksum <"$root/requirements-dev.lock"
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

has_tools() {
    made_from tools "$(tools)"
}

# An editable install has no folder of the package here, and is no built one.
has_package() {
    ls "$venv"/lib/python*/site-packages/fitball/__init__.py >/dev/null 2>&1 && made_from sources "$(sources)"
}

# From version 22.3 on pip installs for another Python.
has_pip_for_others() {
    "$1" -c 'import pip, sys; sys.exit(int(pip.__version__.split(".")[0]) < 23)' 2>/dev/null
}

# Installs in the environment, by uv or by the pip of the Python that was found. Where neither can, the environment gets
# a pip of its own, which takes some seconds.
fetch() {
    if command -v uv >/dev/null 2>&1 &&
        uv pip install --quiet --python "$venv/bin/python" --no-deps "$@" 2>"$venv/uv.log"; then
        return
    fi
    if "$venv/bin/python" -c 'import pip' 2>/dev/null; then
        set -- "$venv/bin/python" -m pip install "$@"
    elif python=$(find_python) && has_pip_for_others "$python"; then
        set -- "$python" -m pip --python "$venv/bin/python" install "$@"
    else
        "$venv/bin/python" -m ensurepip >"$venv/pip.log" 2>&1 || { cat "$venv/pip.log" >&2; return 1; }
        set -- "$venv/bin/python" -m pip install "$@"
    fi
    "$@" --quiet --no-input --disable-pip-version-check --no-compile --no-deps 2>"$venv/pip.log" ||
        { cat "$venv/pip.log" >&2; return 1; }
}

# Extras are added by .venv/bin/pip, which is that of the Python that was found.
offer_pip() {
    if [ ! -e "$venv/bin/pip" ] && has_pip_for_others "$1"; then
        printf '#!/bin/sh\nexec "%s" -m pip --python "%s" "$@"\n' "$(command -v "$1")" "$venv/bin/python" >"$venv/bin/pip"
        chmod +x "$venv/bin/pip"
    fi
}

fetch_pinned() {
    fetch --requirement "$root/$1" || fail "fitball: the pinned packages could not be installed; the lines above say why."
}

make_environment() {
    python=$(find_python) || exit 2
    printf 'fitball: making %s (once; about a minute) ...\n' "$venv" >&2
    "$python" -m venv --without-pip --clear "$venv" ||
        fail "fitball: '$python -m venv' failed; on Debian and Ubuntu install the package python3-venv."
    fetch_pinned requirements.lock
    offer_pip "$python"
    packages >"$venv/packages.stamp"
}

add_tools() {
    # What is pinned no more would stay.
    if [ -f "$venv/tools.stamp" ]; then make_environment; fi
    printf 'fitball: adding what tests need (once) ...\n' >&2
    fetch_pinned requirements-dev.lock
    tools >"$venv/tools.stamp"
}

install_package() {
    rm -f "$venv/sources.stamp"
    fetch --no-index --no-build-isolation --force-reinstall "$root" ||
        fail "fitball: the package could not be built; the lines above say why."
    sources >"$venv/sources.stamp"
}

# Of two calls at once the second waits for the first.
lock() {
    if command -v flock >/dev/null 2>&1; then
        exec 9>"$root/.venv.lock"
        flock 9
    fi
}

# What `run` needs.
ensure_package() {
    has_packages && has_package && return
    lock
    has_packages || make_environment
    has_package || install_package
    exec 9>&-
}

# What developers need: the tools too.
ensure_tools() {
    has_packages && has_tools && return
    lock
    has_packages || make_environment
    has_tools || add_tools
    exec 9>&-
}
