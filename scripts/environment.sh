# Sourced by scripts/fitball and scripts/test: makes .venv once, with the pinned versions, keeps it current, and has the
# kernels compiled in it.
# Needs nothing but a Python of version 3.11 or newer. Sets `root` and `venv`.

root=$(CDPATH= cd -- "$(dirname -- "$0")/.." && pwd)
venv="$root/.venv"

fail() {
    printf '%s\n' "$*" >&2
    exit 2
}

find_python() {
    for candidate in "${FITBALL_PYTHON:-}" python3.13 python3.12 python3.11 python3 python; do
        [ -n "$candidate" ] || continue
        command -v "$candidate" >/dev/null 2>&1 || continue
        if "$candidate" -c 'import sys; sys.exit(not sys.version_info >= (3, 11))' 2>/dev/null; then
            printf '%s\n' "$candidate"
            return
        fi
    done
    fail "fitball needs Python 3.11 or newer: none was found on PATH." \
        "Install one, or name it: FITBALL_PYTHON=/path/to/python3 $0"
}

# What the environment was made from; one process, no Python.
fingerprint() {
    cat "$root/pyproject.toml" "$root/requirements.lock" | cksum
}

# The same pinned packages as pip's, in a tenth of the time. It fails where only pip knows the way to them: uv reads
# none of pip's settings.
make_with_uv() {
    command -v uv >/dev/null 2>&1 || return
    printf 'fitball: making %s with uv (once; some seconds) ...\n' "$venv" >&2
    uv venv --quiet --clear --python "$python" "$venv" || return
    set -- uv pip install --quiet --python "$venv/bin/python" --no-deps
    "$@" --requirement "$root/requirements.lock" && "$@" --no-build-isolation --editable "$root"
}

make_with_pip() {
    printf 'fitball: making %s with pip (once; about a minute) ...\n' "$venv" >&2
    "$python" -m venv --clear "$venv" ||
        fail "fitball: '$python -m venv' failed; on Debian and Ubuntu install the package python3-venv."
    set -- "$venv/bin/python" -m pip install --quiet --no-input --disable-pip-version-check --no-deps
    "$@" --requirement "$root/requirements.lock" ||
        fail "fitball: the pinned packages could not be installed; the lines above say why."
    "$@" --no-build-isolation --editable "$root" ||
        fail "fitball: the project itself could not be installed; the lines above say why."
}

compile_kernels() {
    [ -z "${FITBALL_NO_COMPILE:-}" ] || return 0
    printf 'fitball: compiling its kernels on two cores (once; some ten seconds; FITBALL_NO_COMPILE=1 leaves it to the first fit) ...\n' >&2
    "$venv/bin/python" "$root/scripts/compile_kernels.py" ||
        printf 'fitball: that failed, see above; the first fit tries again.\n' >&2
}

build_environment() {
    python=$(find_python) || exit 2
    rm -f "$venv/fitball.stamp"
    make_with_uv || make_with_pip
    fingerprint >"$venv/fitball.stamp.new" && mv "$venv/fitball.stamp.new" "$venv/fitball.stamp"
    compile_kernels
}

current() {
    [ -f "$venv/fitball.stamp" ] && [ "$(cat "$venv/fitball.stamp")" = "$(fingerprint)" ]
}

ensure_environment() {
    current && return
    # Two first calls at once: the second waits for the first.
    if command -v flock >/dev/null 2>&1; then
        exec 9>"$root/.venv.lock"
        flock 9
        current || build_environment
        exec 9>&-
    else
        build_environment
    fi
}
