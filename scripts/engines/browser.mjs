// Node as a browser, as far as PhysX asks: a package that is built for pages alone.
import { readFileSync } from "node:fs";
const { node, ...others } = process.versions;
Object.defineProperty(process, "versions", { value: others });
globalThis.window = globalThis;
globalThis.fetch = async (url) => readFileSync(new URL(url));
WebAssembly.instantiateStreaming = async (bytes, imports) =>
    WebAssembly.instantiate(await bytes, imports);
