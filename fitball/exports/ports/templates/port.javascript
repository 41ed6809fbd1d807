/*
@head@
 *
 * Self-test: node bounce.js
 * For a page and for node; all names are those of the object Bounce.
 * rebound, rebound_3d and step take a further argument, an object that they returned before: they write into it and
 * return it, so that nothing is allocated. It may be the flight that a step begins with.
 *
@licence@
 */
const Bounce = (function () {
    "use strict";

    const offered = { warn: console.warn };

    @structs@

    @constants@

    @functions@

    Object.assign(offered, { rebound, rebound_3d, step, self_test });
    offered.@name@ = LEVELS_[@place@];
    return offered;
})();
if (typeof module !== "undefined" && module.exports) {
    module.exports = Bounce;
    if (require.main === module) {
        const worst = Bounce.self_test(), passed = worst <= @tolerance@;
        console.log(`@impacts@ golden impacts, largest relative difference ${worst.toExponential(1)}: ${passed ? "passed" : "FAILED"}`);
        process.exitCode = passed ? 0 : 1;
    }
}
