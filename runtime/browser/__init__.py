"""A filter in the browser: the generated C as WebAssembly, in one page that needs no server."""
