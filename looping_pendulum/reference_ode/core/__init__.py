"""The only solver: equations and rules traced into WebAssembly, and carried out by a driver that is compiled once.

`trace` runs `Equations` and `rules` on symbols (`expressions`) and takes derivatives by reverse sweeps (`gradients`); `wasm`
writes the graphs as a module for exactly the effects that act. `driver.c`, compiled to `driver.wasm` by `build`, carries out
any such model; `host` runs both in wasmtime, and the live page in the browser. So a run has the same bits everywhere.
"""
