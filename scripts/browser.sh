# Sourced by .ci/run: puts a headless browser, and what runs the ports, beside the tests that want them, from the
# packages of the system.

have_browser() {
    [ -n "${FITBALL_BROWSER:-}" ] && return
    for name in chromium chromium-browser google-chrome google-chrome-stable chrome; do
        command -v "$name" >/dev/null 2>&1 && return
    done
    return 1
}

# Installs chromium where it is missing and can be had; says plainly when it cannot, and never fails: without a browser
# those tests are skipped. At most three minutes, whatever the mirror does.
ensure_browser() {
    have_browser && return
    if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null 2>&1; then
        printf '%s\n' "No browser, and none can be installed here (not root, or no apt-get): its tests are skipped." >&2
        return
    fi
    export DEBIAN_FRONTEND=noninteractive
    if timeout 60 apt-get -qq update && timeout 120 apt-get -qq install -y --no-install-recommends chromium; then
        printf '%s\n' "Chromium installed for the tests of the pages." >&2
    else
        printf '%s\n' "Chromium could not be installed (the lines above say why): the browser tests are skipped." >&2
    fi
}

# The same for what runs the ports in C# (Mono) and JavaScript.
ensure_interpreters() {
    wanted=
    command -v node >/dev/null 2>&1 || wanted="$wanted nodejs"
    { command -v mcs && command -v mono; } >/dev/null 2>&1 || wanted="$wanted mono-mcs mono-runtime"
    [ -z "$wanted" ] && return
    if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null 2>&1; then
        printf '%s\n' "Not here, and not to be installed (not root, or no apt-get):$wanted. Their tests are skipped." >&2
        return
    fi
    export DEBIAN_FRONTEND=noninteractive
    timeout 60 apt-get -qq update || true
    # One package that is not to be had shall not keep the others away.
    for name in $wanted; do
        timeout 90 apt-get -qq install -y --no-install-recommends "$name" ||
            printf '%s\n' "$name could not be installed (the lines above say why): its tests are skipped." >&2
    done
}
